"use strict";
// Draws the runs' charts over their static plots: one uPlot a panel, made when it is scrolled to and
// given up when it is far away. A run's panels share zoom, cursor and link.
(() => {
  const root = document.documentElement.classList;
  if (typeof uPlot === "undefined" || !root.contains("charted")) {
    root.remove("charted");
    return;
  }

  const ROLES = { level: "muted", band: "good", limit: "limit", safety: "safety", measured: "text", unscored: "muted" };
  const MOST_AT_ONCE = 120; // panels: more would take memory that nobody looks at
  const DASHES = { level: [1, 3], limit: [7, 3], safety: [7, 3, 1, 3], measured: [1, 3] };
  const { MINUS, make, button } = drawing;

  let shades = {};
  const readShades = () => {
    const style = getComputedStyle(document.documentElement);
    const names = ["text", "muted", "axis", "grid", "paper", "good", "limit", "safety", "reference", "blue", "vermilion", "green", "purple", "sky", "orange"];
    shades = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  };

  const text = (value, decimals) => {
    const written = value.toFixed(Math.min(20, Math.max(0, decimals)));
    return (Number(written) === 0 ? written.replace("-", "") : written).replace("-", MINUS);
  };
  const decimalsFor = (span) => (span > 0 ? Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(span)))) : 3);
  // Digits after the point that every multiple of a step needs: 2.5 -> 1, 0.02 -> 2.
  const digits = (step) => {
    let places = 0;
    const whole = (scaled) => Math.abs(scaled - Math.round(scaled)) <= 1e-6 * scaled;
    while (places < 12 && !whole(Math.abs(step) * 10 ** places)) places++;
    return places;
  };

  class Panel {
    constructor(figure, data, last) {
      this.figure = figure;
      this.data = data;
      this.last = last;
      this.plot = null;
      this.wanted = false;
      this.shown = data.traces.map(() => true);
      const toggles = make("div", "toggles");
      this.outputs = data.traces.map((trace, i) => {
        const several = data.traces.length > 1;
        const { item, output } = drawing.entry("button", trace);
        item.type = "button";
        item.setAttribute("aria-pressed", "true");
        item.setAttribute("aria-label", several ? `${data.heading}: ${trace.label}` : trace.label);
        item.addEventListener("click", () => {
          this.shown[i] = !this.shown[i];
          item.setAttribute("aria-pressed", String(this.shown[i]));
          if (this.plot) this.plot.setSeries(i + 1, { show: this.shown[i] });
        });
        toggles.append(item);
        return output;
      });
      ({ element: this.element, canvas: this.canvas } = drawing.body(data, toggles));
    }

    async draw() {
      this.wanted = true;
      if (this.plot || this.drawing || !drawing.visible(this.canvas)) return;
      this.drawing = true;
      try {
        const { time, full } = await this.figure.clock();
        const curves = await Promise.all(
          this.data.traces.map(async (trace) => unpack.curve(await this.figure.packed(trace.curve), trace.middle, trace.step)),
        );
        if (!this.wanted) return;
        this.full = full;
        this.canvas.replaceChildren();
        this.plot = new uPlot(this.options(), [time, ...curves], this.canvas);
        const [min, max] = this.figure.range;
        this.plot.setScale("x", { min, max });
        this.canvas.dataset.drawn = "";
        if (performance.getEntriesByName("eha-first-chart").length === 0) performance.mark("eha-first-chart");
      } finally {
        this.drawing = false;
      }
    }

    giveUp() {
      this.wanted = false;
      if (!this.plot) return;
      this.plot.destroy();
      this.plot = null;
      delete this.canvas.dataset.drawn;
    }

    options() {
      const scaled = (factor) => (u, splits, _axis, _space, step) => {
        const decimals = digits(step * factor);
        return splits.map((value) => text(value * factor, decimals));
      };
      const { factor, timeUnit } = this.figure;
      return {
        ...drawing.options(this.canvas, shades, `time / ${timeUnit}`, this.last, { values: scaled(factor) }, { values: scaled(1) }),
        scales: { x: { time: false }, y: { range: (u, low, high) => this.heights(low, high) } },
        series: [
          {},
          ...this.data.traces.map((trace, i) => ({
            label: trace.label, show: this.shown[i], stroke: shades[trace.colour], width: 1.5,
            dash: trace.dashed ? [6, 3] : undefined, points: { show: false },
          })),
        ],
        hooks: {
          drawClear: [(u) => this.bands(u)],
          draw: [(u) => this.lines(u)],
          setScale: [(u, key) => key === "x" && this.figure.zoomed(u.scales.x.min, u.scales.x.max)],
          setCursor: [(u) => this.figure.pointed(this, u)],
        },
      };
    }

    heights(low, high) {
      if (low == null || high == null) return [0, 1];
      const reach = 0.6 * Math.max(high - low, this.data.leastSpan);
      const [start, stop] = this.figure.range;
      for (const mark of this.data.marks) {
        if (mark.value === undefined || mark.role === "safety") continue;
        if ((mark.time ?? mark.stop) < start || (mark.time ?? mark.start) > stop) continue;
        if (mark.value < low && mark.value > low - reach) low = mark.value;
        if (mark.value > high && mark.value < high + reach) high = mark.value;
      }
      const lacking = Math.max(0, (this.data.leastSpan || (low === high ? 1 : 0)) - (high - low)) / 2;
      const pad = 0.07 * (high - low) + lacking;
      return [low - pad, high + pad];
    }

    // The area between two curves.
    difference(u) {
      const { ctx, data } = u;
      const [one, other] = this.data.band.map((place) => data[place + 1]);
      drawing.clipped(u, (_ctx, _box, x, y) => {
        ctx.globalAlpha = 0.22;
        ctx.fillStyle = shades.muted;
        const from = Math.max(0, u.valToIdx(u.scales.x.min) - 1), to = Math.min(data[0].length - 1, u.valToIdx(u.scales.x.max) + 1);
        ctx.beginPath();
        for (let i = from; i <= to; i++) if (one[i] != null) ctx.lineTo(x(data[0][i]), y(one[i]));
        for (let i = to; i >= from; i--) if (other[i] != null) ctx.lineTo(x(data[0][i]), y(other[i]));
        ctx.fill();
      });
    }

    bands(u) {
      if (this.data.band.length === 2) this.difference(u);
      drawing.clipped(u, (ctx, box, x, y) => {
        for (const mark of this.data.marks) {
          if (mark.kind !== "TimeBand" && mark.kind !== "ValueBand") continue;
          const left = x(mark.start), width = x(mark.stop) - left;
          const top = mark.kind === "TimeBand" ? box.top : y(mark.high);
          const height = mark.kind === "TimeBand" ? box.height : Math.max(1, y(mark.low) - top);
          ctx.globalAlpha = mark.kind === "TimeBand" ? 0.1 : 0.18;
          ctx.fillStyle = shades[ROLES[mark.role]];
          ctx.fillRect(left, top, width, height);
        }
      });
    }

    lines(u) {
      drawing.clipped(u, (ctx, box, x, y, dpr) => {
        const taken = [];
        drawing.font(ctx, dpr);
        ctx.textBaseline = "bottom";
        ctx.textAlign = "left";
        for (const mark of this.data.marks) {
          const shade = shades[ROLES[mark.role] ?? "text"];
          ctx.lineWidth = dpr;
          ctx.strokeStyle = shade;
          ctx.setLineDash((DASHES[mark.role] ?? []).map((length) => length * dpr));
          ctx.beginPath();
          if (mark.kind === "LevelLine") {
            ctx.moveTo(x(mark.start), y(mark.value));
            ctx.lineTo(x(mark.stop), y(mark.value));
            ctx.stroke();
            const inside = y(mark.value) > box.top && y(mark.value) < box.top + box.height &&
              x(mark.start) < box.left + box.width && x(mark.stop) > box.left;
            const right = Math.min(x(mark.stop), box.left + box.width) - 3 * dpr;
            if (inside) this.label(u, taken, mark.label, shade, [[right, y(mark.value) - dpr, "right"]], dpr);
          } else if (mark.kind === "TimeLine") {
            ctx.moveTo(x(mark.time), box.top);
            ctx.lineTo(x(mark.time), box.top + box.height);
            ctx.stroke();
            const bottom = box.top + box.height - 2 * dpr;
            if (x(mark.time) > box.left && x(mark.time) < box.left + box.width) this.label(u, taken, mark.label, shade, [[x(mark.time) + 3 * dpr, bottom, "left"]], dpr);
          } else if (mark.kind === "Tube") {
            this.tube(u, mark, x, y);
            if (x(mark.start) < box.left + box.width && x(mark.stop) > box.left) {
              this.label(u, taken, mark.label, shade, [[Math.min(x(mark.stop), box.left + box.width) - 3 * dpr, box.top + 16 * dpr, "right"]], dpr);
            }
          } else if (mark.kind === "Point") {
            ctx.setLineDash([]);
            ctx.lineWidth = 1.5 * dpr;
            ctx.fillStyle = shades.paper;
            ctx.arc(x(mark.time), y(mark.value), 3.5 * dpr, 0, 2 * Math.PI);
            ctx.fill();
            ctx.stroke();
            const [px, py, gap, line] = [x(mark.time), y(mark.value), 7 * dpr, 14 * dpr];
            const places = [[px + gap, py + line, "left"], [px + gap, py - 2 * dpr, "left"], [px - gap, py - 2 * dpr, "right"], [px - gap, py + line, "right"]];
            if (px > box.left && px < box.left + box.width) this.label(u, taken, mark.label, shades.text, places, dpr);
          }
        }
      });
    }

    // Lines at a distance from the reference, as the reference is drawn.
    tube(u, mark, x, y) {
      const { ctx } = u;
      const place = this.data.traces.findIndex((trace) => trace.channel === "reference") + 1;
      if (place === 0) return;
      const [time, reference] = [u.data[0], u.data[place]];
      const [min, max] = this.figure.range;
      const from = Math.max(0, u.valToIdx(min) - 1), to = Math.min(time.length - 1, u.valToIdx(max) + 1);
      for (const side of [mark.low, mark.high]) {
        ctx.beginPath();
        for (let i = from; i <= to; i++) {
          if (reference[i] == null || time[i] < mark.start || time[i] > mark.stop) continue;
          ctx.lineTo(x(time[i]), y(reference[i] + side));
        }
        ctx.stroke();
      }
    }

    // Writes a label at the first free place, rather not over a curve; not at all where none is free.
    label(u, taken, words, shade, places, dpr) {
      if (!words) return;
      const { ctx, bbox } = u;
      const width = ctx.measureText(words).width, height = 14 * dpr;
      const boxes = places.flatMap(([x, y, align]) => {
        const left = Math.min(Math.max(align === "left" ? x : x - width, bbox.left + 2), bbox.left + bbox.width - width - 2);
        const rows = places.length > 1 ? [0] : [0, 1.1, -1, 1.6, -1.5, 2.2, -2, 2.7, -2.5, 3.2, -3];
        return rows.map((row) => ({ left, right: left + width, top: y + row * height - height, bottom: y + row * height }));
      });
      const free = boxes.filter((box) => box.top >= bbox.top && box.bottom <= bbox.top + bbox.height &&
        !taken.some((other) => box.left < other.right && box.right > other.left && box.bottom > other.top && box.top < other.bottom));
      const box = free.find((candidate) => !this.covers(u, candidate)) ?? free[0];
      if (!box) return;
      taken.push(box);
      drawing.write(ctx, words, box.left, box.bottom, shade, shades.paper, dpr);
    }

    covers(u, box) {
      for (const mark of this.data.marks) {
        if (mark.kind !== "LevelLine") continue;
        const y = u.valToPos(mark.value, "y", true);
        if (y > box.top && y < box.bottom) return true;
      }
      const from = u.posToIdx(box.left, true), to = u.posToIdx(box.right, true);
      const step = Math.max(1, Math.floor((to - from) / 80));
      for (let i = from; i <= to; i += step) {
        for (let s = 1; s < u.data.length; s++) {
          if (!this.shown[s - 1] || u.data[s][i] == null) continue;
          const y = u.valToPos(u.data[s][i], "y", true);
          if (y >= box.top - 2 && y <= box.bottom + 2) return true;
        }
      }
      return false;
    }

    // What the traces read at an index of the clock: a value, or a range where an envelope is drawn.
    read(index) {
      const decimals = this.plot ? decimalsFor(this.plot.scales.y.max - this.plot.scales.y.min) : 3;
      return this.data.traces.map((_, i) => {
        if (!this.plot || index == null) return "";
        const values = this.plot.data[i + 1];
        if (values[index] == null) return "\u2013";
        const one = text(values[index], decimals);
        if (this.full[index] === 1) return one;
        const first = this.full[index] === 2 ? index - 1 : index;
        const low = text(values[first], decimals), high = text(values[first + 1], decimals);
        return low === high ? low : `${low} \u2026 ${high}`;
      });
    }

    show(index) {
      this.read(index).forEach((words, i) => { this.outputs[i].textContent = words; });
    }
  }

  class Figure {
    constructor(element) {
      this.element = element;
      this.scene = JSON.parse(element.querySelector("script.scene").textContent);
      this.range = [this.scene.start, this.scene.stop];
      const short = this.scene.stop - this.scene.start <= 2;
      this.factor = short ? 1000 : 1;
      this.timeUnit = short ? "ms" : "s";
      this.at = null;
      this.build();
    }

    build() {
      this.when = make("span", "when");
      this.link = make("a", "permalink", "Link to this view");
      const tools = [
        this.when,
        button("\u2190", "Earlier", () => this.pan(-0.25)),
        button("\u2192", "Later", () => this.pan(0.25)),
        button("+", "Zoom in", () => this.zoom(0.5)),
        button(MINUS, "Zoom out", () => this.zoom(2)),
        button("Whole", "Show the whole run", () => this.showWhole()),
        button("PNG", "PNG: save the charts as a picture", () => exporting.picture(this.element, this.panels, shades)),
        button("CSV", "CSV: save the curves as a table", () => exporting.table(this.element, this)),
        this.link,
      ];
      const ends = [this.scene.panels.findLastIndex((data) => !data.quiet), this.scene.panels.length - 1];
      this.panels = this.scene.panels.map((data, i) => new Panel(this, data, ends.includes(i)));
      const hint = `Drag to zoom, double-click for the whole run; on a touch screen, pinch and double-tap. With the charts in focus: arrow keys move the cursor, + and ${MINUS} zoom, 0 shows the whole run.`;
      const { charts, spoken } = drawing.frame(this.element, tools, this.panels, hint, figures.length > 0);
      this.spoken = spoken;
      charts.addEventListener("keydown", (event) => this.key(event));
      charts.addEventListener("pointerleave", (event) => { if (event.pointerType !== "touch") this.point(null); });
      pinch.attach(this, charts);
      this.element.prepend(charts);
      this.charts = charts;
      this.relink();
    }

    // A curve as it stands in the page; those at its end may still be on their way.
    async packed(number) {
      const id = `${this.element.dataset.key}-curve-${number}`;
      if (!document.getElementById(id) && document.readyState === "loading") {
        await new Promise((done) => document.addEventListener("DOMContentLoaded", done, { once: true }));
      }
      return document.getElementById(id).textContent;
    }

    // One clock for all panels; forgotten when none is drawn.
    clock() {
      this.unpacked ??= unpack.clock(this.scene.clock);
      return this.unpacked;
    }

    tidy() {
      if (!this.panels.some((panel) => panel.wanted)) this.unpacked = undefined;
    }

    setRange(min, max) {
      const { start, stop } = this.scene;
      const least = (stop - start) * 1e-5;
      min = Math.max(start, min);
      max = Math.min(stop, max);
      if (!(max - min > least)) return;
      this.range = [min, max];
      for (const { plot } of this.panels) {
        if (plot && (plot.scales.x.min !== min || plot.scales.x.max !== max)) plot.setScale("x", { min, max });
      }
      this.relink();
    }

    zoomed(min, max) {
      const tiny = 1e-9 * (this.scene.stop - this.scene.start);
      if (min == null || (Math.abs(min - this.range[0]) <= tiny && Math.abs(max - this.range[1]) <= tiny)) return;
      this.setRange(min, max);
      this.remember();
    }

    zoom(factor) {
      const [min, max] = this.range;
      const middle = this.at !== null && this.at >= min && this.at <= max ? this.at : (min + max) / 2;
      this.setRange(middle - (middle - min) * factor, middle + (max - middle) * factor);
      this.remember();
    }

    showWhole() {
      this.setRange(this.scene.start, this.scene.stop);
      this.remember();
    }

    pan(share) {
      const [min, max] = this.range;
      const wished = share * (max - min);
      const step = Math.max(this.scene.start - min, Math.min(this.scene.stop - max, wished));
      this.setRange(min + step, max + step);
      this.remember();
    }

    get whole() {
      return this.range[0] <= this.scene.start && this.range[1] >= this.scene.stop;
    }

    hash() {
      const { trial, repeat, repeats } = this.element.dataset;
      const parts = [`trial=${encodeURIComponent(trial)}`];
      if (Number(repeats) > 1) parts.push(`repeat=${repeat}`);
      if (!this.whole) parts.push(`t=${this.range.map((t) => String(Number(t.toPrecision(6)))).join("..")}`);
      return `#${parts.join("&")}`;
    }

    relink() {
      this.link.href = this.hash();
    }

    remember() {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => {
        try {
          history.replaceState(null, "", this.hash());
        } catch {
          // the address stays as it is; the link next to the charts is right
        }
      }, 150);
    }

    pointed(panel, u) {
      if (this.pointing) return;
      const inside = u.cursor.left >= 0 && u.cursor.idx != null;
      this.point(inside ? u.posToVal(u.cursor.left, "x") : null, panel);
    }

    point(time, source) {
      this.pointing = true;
      this.at = time;
      drawing.point(this.panels, source, time);
      for (const panel of this.panels) {
        if (panel.plot) panel.show(time === null ? null : panel.plot.posToIdx(panel.plot.valToPos(time, "x")));
      }
      this.when.textContent = time === null ? "" : `t = ${text(time * this.factor, decimalsFor((this.range[1] - this.range[0]) * this.factor))} ${this.timeUnit}`;
      this.pointing = false;
    }

    speak() {
      const drawn = this.panels.filter((panel) => panel.plot);
      const words = drawn.flatMap((panel) => panel.data.traces.map((trace, i) =>
        `${panel.data.heading}${panel.data.traces.length > 1 ? ` ${trace.label}` : ""} ${panel.outputs[i].textContent} ${panel.data.unit}`));
      this.spoken.textContent = `${this.when.textContent}: ${words.join(", ")}`;
    }

    key(event) {
      const [min, max] = this.range;
      const step = (event.shiftKey ? 0.1 : 0.01) * (max - min);
      const move = (by) => {
        const from = this.at ?? (min + max) / 2;
        this.point(Math.min(max, Math.max(min, from + by)));
        this.speak();
      };
      drawing.press(event, {
        ArrowLeft: () => move(-step), ArrowRight: () => move(step),
        "+": () => this.zoom(0.5), "=": () => this.zoom(0.5),
        "-": () => this.zoom(2), [MINUS]: () => this.zoom(2),
        0: () => this.showWhole(),
        Escape: () => this.point(null),
      });
    }
  }

  const figures = [];
  try {
    readShades();
    for (const element of document.querySelectorAll(".with-charts")) figures.push(new Figure(element));
  } catch (error) {
    root.remove("charted");
    throw error;
  }
  if (figures.length === 0) return;

  const panels = new Map(figures.flatMap((figure) => figure.panels.map((panel) => [panel.element, panel])));
  const shown = () => [...panels.values()].filter((panel) => drawing.visible(panel.canvas));
  const watcher = new IntersectionObserver((entries) => {
    const few = shown().length <= MOST_AT_ONCE;
    for (const { target, isIntersecting } of entries) {
      const panel = panels.get(target);
      if (isIntersecting) panel.draw();
      else if (!few || !drawing.visible(panel.canvas)) panel.giveUp();
      panel.figure.tidy();
    }
  }, { rootMargin: "600px 0px" });
  for (const element of panels.keys()) watcher.observe(element);

  // What is open is drawn where nobody scrolls, too (a picture of the whole page), in idle time.
  const idle = window.requestIdleCallback ?? ((work) => setTimeout(work, 20));
  const drawRest = async (deadline) => {
    for (const panel of shown().slice(0, MOST_AT_ONCE)) {
      if (panel.plot) continue;
      await panel.draw();
      if (deadline && deadline.timeRemaining() < 2) {
        idle(drawRest);
        return;
      }
    }
  };
  addEventListener("load", () => idle(drawRest));
  addEventListener("toggle", () => {
    // The watcher says nothing of what was closed out of its sight.
    for (const panel of panels.values()) {
      if (!panel.plot || drawing.visible(panel.canvas)) continue;
      panel.giveUp();
      panel.figure.tidy();
    }
    idle(drawRest);
  }, true);

  drawing.follow(figures);

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    readShades();
    for (const panel of panels.values()) {
      if (!panel.plot) continue;
      panel.giveUp();
      panel.draw();
    }
  });

  // #trial=<id>&repeat=<n>&t=<from>..<to> opens a trial, one of its repeats, a stretch of time in s.
  function open() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const trial = asked.get("trial");
    if (trial === null) return;
    const repeat = asked.get("repeat");
    const own = figures.filter((figure) => figure.element.dataset.trial === trial);
    const figure = own.find((candidate) => repeat === null || candidate.element.dataset.repeat === repeat) ?? own[0];
    const section = document.getElementById(`trial=${encodeURIComponent(trial)}`) ?? figure?.element;
    const details = figure?.element.closest("details");
    for (let fold = details; fold; fold = fold.parentElement.closest("details")) fold.open = true;
    const range = /^(-?[\d.]+(?:e-?\d+)?)\.\.(-?[\d.]+(?:e-?\d+)?)$/i.exec(asked.get("t") ?? "");
    if (figure && range) figure.setRange(Number(range[1]), Number(range[2]));
    (range ? figure?.element : details ?? section)?.scrollIntoView();
  }
  addEventListener("hashchange", open);
  open();
})();
