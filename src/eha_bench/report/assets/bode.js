"use strict";
// Draws Bode plots over their static pictures: gain, phase and coherence share frequency and cursor.
(() => {
  if (typeof uPlot === "undefined") return;
  const { MINUS, make, button } = drawing;
  const shade = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const text = (value, decimals) => value.toFixed(decimals).replace("-", MINUS);

  class Panel {
    constructor(figure, data, last) {
      this.figure = figure;
      this.data = data;
      this.last = last;
      const readings = make("div", "toggles");
      this.outputs = data.curves.map((curve) => {
        const { item, output } = drawing.entry("span", curve);
        readings.append(item);
        return output;
      });
      ({ element: this.element, canvas: this.canvas } = drawing.body(data, readings));
    }

    draw() {
      if (this.plot) this.plot.destroy();
      this.canvas.replaceChildren();
      this.plot = new uPlot(this.options(), [this.figure.frequency, ...this.data.curves.map((curve) => curve.values)], this.canvas);
      this.canvas.dataset.drawn = "";
    }

    heights() {
      if (this.data.low !== null) return [this.data.low, this.data.high + 0.03 * (this.data.high - this.data.low)];
      const [min, max] = this.figure.range;
      const seen = this.data.curves.flatMap((curve) => curve.values.filter((value, i) =>
        value !== null && this.figure.frequency[i] >= min && this.figure.frequency[i] <= max));
      if (seen.length === 0) return [0, 1];
      const low = Math.min(...seen), high = Math.max(...seen), pad = 0.12 * Math.max(high - low, 1);
      return [low - pad, high + pad];
    }

    options() {
      const named = (_, splits) => splits.map((value) => (value === null ? "" : String(Number(value.toPrecision(3)))));
      // 1, 2 and 5 times the powers of ten
      const rounds = (_u, _axis, min, max) => {
        const found = [];
        for (let power = Math.floor(Math.log10(min)); 10 ** power <= max; power++) {
          for (const digit of [1, 2, 5]) {
            const value = Number(`${digit}e${power}`);
            if (value >= min && value <= max) found.push(value);
          }
        }
        return found;
      };
      const shades = Object.fromEntries(["muted", "grid", "axis"].map((name) => [name, shade(name)]));
      const below = { values: named, splits: rounds, filter: (_, splits) => splits };
      const left = { values: (_, splits) => splits.map((value) => String(value).replace("-", MINUS)) };
      return {
        ...drawing.options(this.canvas, shades, "frequency / Hz", this.last, below, left),
        scales: { x: { time: false, distr: 3, range: () => this.figure.range }, y: { range: () => this.heights() } },
        series: [
          {},
          ...this.data.curves.map((curve) => ({
            label: curve.label, stroke: shade(curve.colour), width: curve.rings ? 0 : 1.5, spanGaps: true,
            dash: curve.dashed ? [6, 3] : undefined,
            points: curve.rings
              ? { show: true, size: 7, stroke: shade(curve.colour), fill: shade("paper"), width: 1.5 }
              : { show: !curve.dashed, size: 5, stroke: shade(curve.colour), fill: shade(curve.colour) },
          })),
        ],
        hooks: {
          drawClear: [(u) => this.intervals(u)],
          draw: [(u) => this.marks(u)],
          setSelect: [(u) => this.figure.zoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"))],
          setCursor: [(u) => this.figure.pointed(this, u)],
        },
      };
    }

    intervals(u) {
      drawing.clipped(u, (ctx, box, x, y, dpr) => {
        ctx.globalAlpha = 0.35;
        ctx.lineWidth = 3 * dpr;
        for (const curve of this.data.curves) {
          ctx.strokeStyle = shade(curve.colour);
          this.figure.frequency.forEach((frequency, i) => {
            if (curve.high[i] === null) return;
            ctx.beginPath();
            ctx.moveTo(x(frequency), curve.low[i] === null ? box.top + box.height : y(curve.low[i]));
            ctx.lineTo(x(frequency), y(curve.high[i]));
            ctx.stroke();
          });
        }
      });
    }

    marks(u) {
      drawing.clipped(u, (ctx, box, x, y, dpr) => {
        drawing.font(ctx, dpr);
        let row = 1;
        for (const mark of this.data.marks) {
          const colour = shade(mark.role);
          ctx.strokeStyle = colour;
          ctx.lineWidth = dpr;
          ctx.setLineDash([dpr, 3 * dpr]);
          ctx.beginPath();
          let at, down, align;
          if (mark.level !== null) {
            [at, down, align] = [box.left + 4 * dpr, y(mark.level) - 3 * dpr, "left"];
            ctx.moveTo(box.left, y(mark.level));
            ctx.lineTo(box.left + box.width, y(mark.level));
          } else {
            const place = x(mark.frequency);
            align = place > box.left + box.width / 2 ? "right" : "left";
            [at, down] = [place + (align === "left" ? 4 : -4) * dpr, box.top + 13 * dpr * row++];
            ctx.moveTo(place, box.top);
            ctx.lineTo(place, box.top + box.height);
          }
          ctx.stroke();
          ctx.textAlign = align;
          drawing.write(ctx, mark.label, at, down, colour, shade("paper"), dpr);
        }
      });
    }

    show(index) {
      this.data.curves.forEach((curve, i) => {
        const value = index === null ? null : curve.values[index];
        this.outputs[i].textContent = value === null ? "" : text(value, this.data.unit === "dB" ? 2 : this.data.unit ? 1 : 3);
      });
    }
  }

  class Figure {
    constructor(element) {
      this.element = element;
      const data = JSON.parse(element.querySelector("script.bode").textContent);
      this.frequency = data.frequency;
      this.whole = [data.frequency[0] / 1.08, data.frequency.at(-1) * 1.08];
      this.range = this.whole;
      this.index = null;
      this.where = make("span", "when");
      const whole = button("Whole", "Whole: show all frequencies", () => this.zoom(...this.whole));
      this.panels = data.panels.map((panel, i) => new Panel(this, panel, i === data.panels.length - 1));
      const hint = "Drag to zoom, double-click for all frequencies. With the charts in focus: arrow keys move from point to point, 0 shows all.";
      const { charts, spoken } = drawing.frame(element, [this.where, whole], this.panels, hint);
      this.spoken = spoken;
      charts.addEventListener("keydown", (event) => this.key(event));
      charts.addEventListener("dblclick", () => this.zoom(...this.whole));
      charts.addEventListener("pointerleave", () => this.point(null));
      element.prepend(charts);
      this.charts = charts;
      element.classList.add("drawn");
    }

    draw() {
      for (const panel of this.panels) panel.draw();
    }

    zoom(min, max) {
      [min, max] = [Math.max(min, this.whole[0]), Math.min(max, this.whole[1])];
      if (!(max > min * 1.001)) return;
      this.range = [min, max];
      for (const { plot } of this.panels) {
        plot?.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        plot?.setScale("x", { min, max });
      }
    }

    pointed(panel, u) {
      if (this.pointing) return;
      this.point(u.cursor.left >= 0 && u.cursor.idx != null ? u.cursor.idx : null, panel);
    }

    point(index, source) {
      this.pointing = true;
      this.index = index;
      drawing.point(this.panels, source, index === null ? null : this.frequency[index]);
      for (const panel of this.panels) panel.show(index);
      this.where.textContent = index === null ? "" : `${Number(this.frequency[index].toPrecision(4))} Hz`;
      this.pointing = false;
    }

    key(event) {
      const move = (by) => {
        const from = this.index ?? (by > 0 ? -1 : this.frequency.length);
        this.point(Math.min(this.frequency.length - 1, Math.max(0, from + by)));
        this.spoken.textContent = `${this.where.textContent}: ${this.panels.flatMap((panel) => panel.data.curves.map((curve, i) =>
          (panel.outputs[i].textContent ? `${panel.data.heading} ${curve.label} ${panel.outputs[i].textContent} ${panel.data.unit}` : ""))).filter(Boolean).join(", ")}`;
      };
      drawing.press(event, { ArrowLeft: () => move(-1), ArrowRight: () => move(1), 0: () => this.zoom(...this.whole), Escape: () => this.point(null) });
    }
  }

  const figures = [];
  for (const element of document.querySelectorAll(".with-bode")) {
    try {
      figures.push(new Figure(element));
    } catch (error) {
      element.querySelector(".charts")?.remove();  // the static plot stays
      element.classList.remove("drawn");
      throw error;
    }
  }
  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const figure = figures.find((candidate) => candidate.charts === target);
      if (isIntersecting && !figure.seen) {
        figure.seen = true;
        figure.draw();
      }
    }
  }, { rootMargin: "600px 0px" });
  drawing.follow(figures);
  for (const figure of figures) watcher.observe(figure.charts);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const figure of figures) if (figure.seen) figure.draw();
  });
})();
