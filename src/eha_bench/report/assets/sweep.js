"use strict";
// Draws a sweep's heat map, parallel coordinates and Pareto front over their static pictures: what
// is on the axes can be chosen, and a drag along an axis leaves only the points within.
document.addEventListener("DOMContentLoaded", () => {
  const source = document.getElementById("sweep-data");
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const { make, button } = drawing;
  // a phone shows a narrower picture with letters of the same size, and nothing to scroll
  const WIDTH = Math.min(920, Math.max(340, Math.round(document.getElementById("main").clientWidth - 32)));
  const SPACE = "http://www.w3.org/2000/svg", FULL = 0.4, BINS = 12, LINES = 2000, ROWS = 50;
  const count = data.points.length, brushes = new Map();
  const axes = [...data.factors, data.margins[0], ...data.axes.map((place) => data.margins[place])];
  const format = (axis, value) => (axis.words.length ? axis.words[Math.round(value)] : String(Number(value.toPrecision(4)))).replace(/^-/, drawing.MINUS);
  const rounded = (axis, value) => (axis.words.length ? format(axis, value) : format(axis, Number(value.toPrecision(3))));
  const fixed = (value) => (value > 0 ? "+" : "") + value.toFixed(3).replace(/^-/, drawing.MINUS);
  const scaled = (axis, value) => (axis.log ? Math.log(value) : value);
  const range = (axis) => {
    const found = axis.values.filter((value) => value !== null).map((value) => scaled(axis, value));
    const low = found.reduce((a, b) => Math.min(a, b), Infinity), high = found.reduce((a, b) => Math.max(a, b), -Infinity);
    return Number.isFinite(low) ? [low, high] : [0, 1];
  };
  const share = (axis, value) => {
    const [low, high] = (axis.range ??= range(axis));
    return (scaled(axis, value) - low) / (high - low || 1);
  };
  const inside = (place) => {
    for (const [axis, [low, high]] of brushes) {
      const value = axis.values[place];
      if (value === null || share(axis, value) < low - 1e-9 || share(axis, value) > high + 1e-9) return false;
    }
    return true;
  };
  const svg = (tag, attributes, words) => {
    const element = document.createElementNS(SPACE, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    if (words !== undefined) element.textContent = words;
    return element;
  };
  const text = (x, y, words, anchor) => svg("text", { x, y, "text-anchor": anchor, fill: "var(--muted)" }, words);
  const stage = (height, label) => svg("svg", { viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "font-size": 12, "aria-label": label });
  const choice = (name, items, chosen, changed) => {
    const label = make("label", "jump", `${name} `), select = make("select");
    items.forEach((item, place) => {
      const option = make("option", "", item.label);
      option.value = place;
      option.selected = place === chosen;
      select.append(option);
    });
    select.addEventListener("change", () => changed(Number(select.value)));
    label.append(select);
    return label;
  };
  const bins = (axis) => {
    const levels = [...new Set(axis.values)].sort((a, b) => a - b);
    if (levels.length <= BINS) return { of: (value) => levels.indexOf(value), names: levels.map((value) => format(axis, value)) };
    const [low, high] = (axis.range ??= range(axis));
    const back = (value) => format(axis, axis.log ? Math.exp(value) : value);
    return {
      of: (value) => Math.min(Math.floor(share(axis, value) * BINS), BINS - 1),
      names: Array.from({ length: BINS }, (_, k) => back(low + ((high - low) * (k + 0.5)) / BINS)),
    };
  };
  const parts = [];

  const heat = document.getElementById("sweep-heat");
  if (heat) {
    const moving = data.factors.filter((axis) => new Set(axis.values).size > 1);
    const chosen = { x: 0, y: 1, of: 0 };
    const tools = make("div", "tools"), canvas = make("div");
    const pick = (key) => (place) => { chosen[key] = place; draw(); };
    tools.append(choice("across", moving, 0, pick("x")), choice("up", moving, 1, pick("y")), choice("margin of", data.margins, 0, pick("of")));
    const draw = () => {
      const x = moving[chosen.x], y = moving[chosen.y], of = data.margins[chosen.of];
      const across = bins(x), up = bins(y), best = new Map();
      for (let place = 0; place < count; place++) {
        const margin = of.values[place];
        if (margin === null || !inside(place)) continue;
        const cell = across.of(x.values[place]) + BINS * 1000 * up.of(y.values[place]);
        if (!(best.get(cell) >= margin)) best.set(cell, margin);
      }
      const left = 92, top = 8, bottom = 40, height = top + bottom + Math.max(24 * up.names.length, 120);
      const wide = (WIDTH - left - 8) / across.names.length, tall = (height - top - bottom) / up.names.length;
      const picture = stage(height, `Largest margin of ${of.label} over ${x.label} and ${y.label}`);
      up.names.forEach((name, row) => {
        const at = height - bottom - tall * (row + 1);
        picture.append(text(left - 6, at + tall / 2 + 4, name, "end"));
        across.names.forEach((other, column) => {
          const margin = best.get(column + BINS * 1000 * row), known = margin !== undefined;
          const cell = svg("rect", {
            x: left + wide * column, y: at, width: wide - 1, height: tall - 1,
            fill: !known ? "var(--grid)" : margin >= 0 ? "var(--blue)" : "var(--vermilion)",
            "fill-opacity": !known ? 1 : Math.min(1, 0.2 + (0.8 * Math.abs(margin)) / FULL),
          });
          cell.append(svg("title", {}, `${other}, ${name}: ${known ? fixed(margin) : "no point"}`));
          picture.append(cell);
        });
      });
      across.names.forEach((name, column) => picture.append(text(left + wide * (column + 0.5), height - bottom + 16, name, "middle")));
      picture.append(text((left + WIDTH) / 2, height - 6, x.label, "middle"));
      canvas.replaceChildren(picture);
    };
    heat.classList.add("fitted");
    heat.replaceChildren(tools, canvas);
    parts.push(draw);
  }

  const parallel = document.getElementById("sweep-parallel");
  if (parallel) {
    const tools = make("div", "tools"), canvas = make("div");
    tools.append(make("span", "hint", "Drag along an axis to keep the points within."), button("All points", "Show all points again", () => { brushes.clear(); redraw(); }));
    const lines = WIDTH < 600 ? axes.length : 2;  // of labels, which must not meet
    const top = 26 + 16 * lines, height = top + 276, bottom = 24, side = 60, gap = (WIDTH - 2 * side) / Math.max(1, axes.length - 1), inner = height - top - bottom;
    const stride = Math.max(1, Math.ceil(count / LINES));
    // an outer label starts or ends at the picture's edge: centred it would be cut off
    const label = (axis, k, x) => {
      const [at, anchor] = k === 0 ? [4, "start"] : k === axes.length - 1 ? [WIDTH - 4, "end"] : [x, "middle"];
      return text(at, 12 + 16 * (k % lines), axis.label, anchor);
    };
    const draw = () => {
      const picture = stage(height, "Every point over all factors and margins");
      for (const pass of [0, 1]) {
        for (let place = 0; place < count; place += stride) {
          if (data.passed[place] !== pass) continue;
          const steps = axes.flatMap((axis, k) => (axis.values[place] === null ? [] : [`${side + gap * k} ${(top + inner * (1 - share(axis, axis.values[place]))).toFixed(1)}`]));
          const shown = inside(place);
          picture.append(svg("path", { d: `M${steps.join("L")}`, fill: "none", stroke: !shown ? "var(--grid)" : pass ? "var(--blue)" : "var(--vermilion)", "stroke-opacity": !shown ? 0.5 : pass ? 0.8 : 0.35 }));
        }
      }
      axes.forEach((axis, k) => {
        const x = side + gap * k, [low, high] = (axis.range ??= range(axis)), ends = [low, high].map((value) => rounded(axis, axis.log ? Math.exp(value) : value));
        picture.append(svg("path", { d: `M${x} ${top}V${height - bottom}`, stroke: "var(--axis)" }), label(axis, k, x), text(x, height - 8, ends[0], "middle"), text(x, top - 5, ends[1], "middle"));
        const brush = brushes.get(axis);
        if (brush) picture.append(svg("rect", { x: x - 7, width: 14, y: top + inner * (1 - brush[1]), height: Math.max(2, inner * (brush[1] - brush[0])), fill: "var(--accent)", "fill-opacity": 0.35 }));
        const handle = svg("rect", { x: x - 12, y: top, width: 24, height: inner, fill: "transparent", cursor: "ns-resize" });
        handle.addEventListener("pointerdown", (event) => {
          event.preventDefault();
          const at = (one) => {
            const box = picture.getBoundingClientRect();
            const found = 1 - (((one.clientY - box.top) / box.height) * height - top) / inner;
            return found < 0.02 ? 0 : found > 0.98 ? 1 : found;  // a pointer hardly meets the very end
          };
          const start = at(event);
          const end = (one) => {
            const stop = at(one);
            if (Math.abs(stop - start) < 0.02) brushes.delete(axis);
            else brushes.set(axis, [Math.min(start, stop), Math.max(start, stop)]);
            redraw();
          };
          window.addEventListener("pointerup", end, { once: true });
        });
        picture.append(handle);
      });
      canvas.replaceChildren(picture);
    };
    parallel.classList.add("fitted");
    parallel.replaceChildren(tools, canvas);
    parts.push(draw);
  }

  const pareto = document.getElementById("sweep-pareto");
  if (pareto) {
    const chosen = { x: data.pareto[0], y: data.pareto[1] };
    const tools = make("div", "tools"), canvas = make("div");
    const pick = (key) => (place) => { chosen[key] = place; draw(); };
    tools.append(choice("across", data.margins, chosen.x, pick("x")), choice("up", data.margins, chosen.y, pick("y")));
    const draw = () => {
      const x = data.margins[chosen.x], y = data.margins[chosen.y], height = 336, left = 70, top = 28, bottom = 44;
      const picture = stage(height, `${x.label} against ${y.label}`);
      const at = (place) => [left + (WIDTH - 20 - left) * share(x, x.values[place]), height - bottom - (height - bottom - top) * share(y, y.values[place])];
      const places = data.points.map((_, place) => place).filter((place) => x.values[place] !== null && y.values[place] !== null && inside(place));
      for (const place of places) {
        const [across, up] = at(place), dot = svg("circle", { cx: across, cy: up, r: 3.5, fill: data.passed[place] ? "var(--blue)" : "var(--vermilion)", "fill-opacity": 0.6 });
        dot.append(svg("title", {}, `point ${data.points[place]}: ${x.values[place]}, ${y.values[place]}`));
        picture.append(dot);
      }
      let most = -Infinity;
      const front = places.toSorted((a, b) => x.values[b] - x.values[a] || y.values[b] - y.values[a]).filter((place) => y.values[place] > most && ((most = y.values[place]), true));
      if (front.length) picture.append(svg("path", { d: `M${front.map((place) => at(place).join(" ")).join("L")}`, fill: "none", stroke: "var(--text)", "stroke-width": 1.5 }));
      const [xs, ys] = [x, y].map((axis) => (axis.range ??= range(axis)));
      picture.append(svg("path", { d: `M${left - 8} ${top}V${height - bottom + 8}H${WIDTH - 12}`, fill: "none", stroke: "var(--axis)" }), text(left, height - bottom + 24, fixed(xs[0]), "middle"), text(WIDTH - 20, height - bottom + 24, fixed(xs[1]), "end"), text(left - 14, height - bottom + 4, fixed(ys[0]), "end"), text(left - 14, top + 8, fixed(ys[1]), "end"), text((left + WIDTH) / 2, height - 8, `margin of ${x.label}`, "middle"), text(4, 12, `margin of ${y.label}`, "start"));
      canvas.replaceChildren(picture);
    };
    pareto.classList.add("fitted");
    pareto.replaceChildren(tools, canvas);
    parts.push(draw);
  }

  // The table: the best of the points that are left.
  const body = document.querySelector("#sweep-points tbody");
  const caption = document.getElementById("sweep-count"), first = caption.cloneNode(true);
  const rows = [...body.children];
  const list = () => {
    if (!brushes.size) {
      caption.replaceChildren(...first.cloneNode(true).childNodes);
      body.replaceChildren(...rows);
      return;
    }
    const least = data.margins[0].values, value = (place) => least[place] ?? -Infinity;
    const kept = data.points.map((_, place) => place).filter(inside).sort((a, b) => data.passed[b] - data.passed[a] || value(b) - value(a));
    caption.textContent = `${kept.length} of ${count} points within, ${kept.filter((place) => data.passed[place]).length} of them pass.`;
    body.replaceChildren(...kept.slice(0, ROWS).map((place) => {
      const known = rows.find((row) => Number(row.dataset.point) === data.points[place]);
      if (known) return known;
      const row = make("tr", data.passed[place] ? "passed" : "failed"), head = make("th");
      const link = data.reports[data.points[place]];
      if (link) { const anchor = make("a", "", data.points[place]); anchor.href = link; head.append(anchor); } else head.textContent = data.points[place];
      const cell = (look, words, label) => { const made = make("td", look, words); if (label) made.dataset.label = label; return made; };
      row.append(head, ...data.factors.map((axis) => cell("num", format(axis, axis.values[place]), axis.name)));
      row.append(cell("num margin", least[place] === null ? "\u2013" : fixed(least[place]), "Least margin"));
      const lowest = data.margins.slice(1).reduce((found, margin) => (margin.values[place] !== null && (found === null || margin.values[place] < found.values[place]) ? margin : found), null);
      row.append(cell("", lowest ? lowest.label : "", "Least of"), cell("verdict-cell", data.passed[place] ? "\u2713 passed" : "\u2715 failed"));
      return row;
    }));
  };
  const redraw = () => { for (const draw of parts) draw(); list(); };
  redraw();
});
