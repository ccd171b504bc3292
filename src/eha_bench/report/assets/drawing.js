"use strict";
// What every chart has in common: its frame, its axes, and the elements around it.
const drawing = (() => {
  const FONT = '11px system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", "DejaVu Sans", sans-serif';
  const MINUS = "\u2212";

  const make = (tag, className, content) => {
    const element = document.createElement(tag);
    if (className) element.className = className;
    if (content !== undefined) element.textContent = content;
    return element;
  };

  const button = (label, name, action) => {
    const element = make("button", "tool", label);
    element.type = "button";
    element.setAttribute("aria-label", name);
    element.title = name;
    element.addEventListener("click", action);
    return element;
  };

  // A focusable group around a figure's panels: the tools above, how to use it and what is read out
  // below (to the eye once a page), a line for the cursor's place.
  const frame = (element, tools, panels, words, said = false) => {
    const charts = make("div", "charts");
    charts.tabIndex = 0;
    charts.setAttribute("role", "group");
    charts.setAttribute("aria-label", element.dataset.label);
    const bar = make("div", "tools");
    bar.append(...tools);
    const hint = make("p", said ? "for-readers" : "hint", words);
    hint.id = `${element.dataset.key}-hint`;
    charts.setAttribute("aria-describedby", hint.id);
    const spoken = make("p", "for-readers");
    spoken.setAttribute("role", "status");
    const telling = panels.filter((item) => !item.data.quiet);
    const quiet = panels.filter((item) => item.data.quiet);
    charts.append(bar, ...telling.map((item) => item.element));
    if (quiet.length) {
      const fold = make("details", "quiet");
      fold.append(make("summary", "", `Almost constant: ${quiet.map((item) => item.data.heading).join(", ")}`), ...quiet.map((item) => item.element));
      charts.append(fold);
    }
    charts.append(hint, spoken);
    return { charts, spoken };
  };

  // A panel's own elements: its name, a legend, the place that is drawn on.
  const body = (data, legend) => {
    const element = make("div", "panel");
    const head = make("div", "panel-head");
    head.append(make("p", "panel-name", data.unit ? `${data.heading} / ${data.unit}` : data.heading), legend);
    const canvas = make("div", "canvas");
    element.append(head, canvas);
    return { element, canvas };
  };

  // What a legend says of a curve: its line, its name, what it reads at the cursor.
  const entry = (tag, curve) => {
    const item = make(tag, "toggle");
    const swatch = make("span", curve.dashed ? "swatch dashed" : "swatch");
    swatch.style.color = `var(--${curve.colour})`;
    const output = make("span", "reading");
    item.append(swatch, make("span", "", curve.label), output);
    return { item, output };
  };

  // uPlot's options that no chart has otherwise; the last panel of a figure names what runs along.
  const options = (canvas, shades, label, last, below, left) => {
    const axis = {
      stroke: shades.muted, font: FONT,
      grid: { stroke: shades.grid, width: 1 },
      ticks: { stroke: shades.axis, width: 1, size: 4 },
    };
    const named = last
      ? { label, labelFont: FONT, labelSize: 18, labelGap: 0, size: 24, gap: 3 }
      : { size: 20, gap: 3 };
    return {
      width: Math.max(50, canvas.clientWidth),
      height: Math.max(40, canvas.clientHeight),
      padding: [6, 8, 0, 0],
      legend: { show: false },
      cursor: { y: false, drag: { x: true, y: false, dist: 4 }, points: { size: 6 } },
      axes: [{ ...axis, ...below, ...named }, { ...axis, size: 56, gap: 4, space: 28, ticks: { show: false }, ...left }],
    };
  };

  // Paints within the axes; `paint` gets the places of values on the canvas.
  const clipped = (u, paint) => {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    paint(ctx, bbox, (value) => u.valToPos(value, "x", true), (value) => u.valToPos(value, "y", true), devicePixelRatio || 1);
    ctx.restore();
  };

  const font = (ctx, dpr) => {
    ctx.font = FONT.replace("11px", `${11 * dpr}px`);
  };

  // Words with a rim of paper, to be read over curves.
  const write = (ctx, words, x, y, shade, paper, dpr) => {
    ctx.setLineDash([]);
    ctx.lineWidth = 3 * dpr;
    ctx.strokeStyle = paper;
    ctx.strokeText(words, x, y);
    ctx.fillStyle = shade;
    ctx.fillText(words, x, y);
  };

  // Puts the cursor of every plot but the one it came from on a value of x, or takes it away.
  const point = (panels, source, x) => {
    for (const item of panels) {
      if (!item.plot || item === source) continue;
      item.plot.setCursor({ left: x === null ? -10 : item.plot.valToPos(x, "x"), top: x === null ? -10 : 10 }, false);
    }
  };

  // Whether an element is laid out, and not in a fold that is closed.
  const visible = (element) => element.clientWidth > 0 && (element.checkVisibility?.() ?? true);

  // Does what a key stands for; other keys are left to the browser.
  const press = (event, actions) => {
    const action = event.ctrlKey || event.altKey || event.metaKey ? undefined : actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  };

  // Plots follow the width of their places.
  const follow = (figures) => {
    const sizes = new ResizeObserver(() => {
      for (const figure of figures) {
        for (const { plot, canvas } of figure.panels) {
          if (plot && canvas.clientWidth && canvas.clientWidth !== plot.width) {
            plot.setSize({ width: canvas.clientWidth, height: canvas.clientHeight });
          }
        }
      }
    });
    for (const figure of figures) sizes.observe(figure.charts);
  };

  return { MINUS, make, button, frame, body, entry, options, clipped, font, write, point, press, follow, visible };
})();
