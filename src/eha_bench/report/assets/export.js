"use strict";
// A figure's charts as a picture, and its curves as a table.
const exporting = (() => {
  const save = (blob, name) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  };

  const nameOf = (element, ending) => {
    const { trial, repeat, repeats } = element.dataset;
    const plain = `${trial}${Number(repeats) > 1 ? `-${repeat}` : ""}`.replace(/[^\w.-]+/g, "_");
    return `${plain}.${ending}`;
  };

  // The panels that are drawn, one below the other, each under its name.
  const picture = (element, panels, shades) => {
    const drawn = panels.filter((panel) => panel.plot);
    if (!drawn.length) return;
    const dpr = devicePixelRatio || 1;
    const head = 22 * dpr;
    const canvas = document.createElement("canvas");
    canvas.width = Math.max(...drawn.map((panel) => panel.plot.ctx.canvas.width));
    canvas.height = drawn.reduce((sum, panel) => sum + head + panel.plot.ctx.canvas.height, 0);
    const ctx = canvas.getContext("2d");
    ctx.fillStyle = shades.paper;
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    let top = 0;
    for (const panel of drawn) {
      drawing.font(ctx, dpr);
      ctx.fillStyle = shades.text;
      ctx.textBaseline = "middle";
      let left = 8 * dpr;
      const heading = panel.data.unit ? `${panel.data.heading} / ${panel.data.unit}` : panel.data.heading;
      ctx.fillText(heading, left, top + head / 2);
      left += ctx.measureText(heading).width + 16 * dpr;
      for (const trace of panel.data.traces) {
        ctx.strokeStyle = ctx.fillStyle = shades[trace.colour];
        ctx.lineWidth = 2 * dpr;
        ctx.setLineDash(trace.dashed ? [4 * dpr, 3 * dpr] : []);
        ctx.beginPath();
        ctx.moveTo(left, top + head / 2);
        ctx.lineTo(left + 16 * dpr, top + head / 2);
        ctx.stroke();
        ctx.setLineDash([]);
        ctx.fillText(trace.label, left + 20 * dpr, top + head / 2);
        left += 32 * dpr + ctx.measureText(trace.label).width;
      }
      ctx.drawImage(panel.plot.ctx.canvas, 0, top + head);
      top += head + panel.plot.ctx.canvas.height;
    }
    canvas.toBlob((blob) => save(blob, nameOf(element, "png")));
  };

  // Every curve of a figure over its clock, in the units of the page; a gap is an empty cell.
  const table = async (element, figure) => {
    const { time } = await figure.clock();
    const traces = figure.panels.flatMap((panel) => panel.data.traces.map((trace) => [panel.data, trace]));
    const curves = await Promise.all(traces.map(async ([, trace]) => unpack.curve(await figure.packed(trace.curve), trace.middle, trace.step)));
    const cell = (words) => (/[",\n]/.test(words) ? `"${words.replaceAll('"', '""')}"` : words);
    const named = traces.map(([data, trace]) => cell(data.unit ? `${trace.channel} / ${data.unit}` : trace.channel));
    const lines = [["time / s", ...named].join(",")];
    for (let i = 0; i < time.length; i++) {
      lines.push([Number(time[i].toPrecision(9)), ...curves.map((curve) => (curve[i] == null ? "" : Number(curve[i].toPrecision(7))))].join(","));
    }
    save(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }), nameOf(element, "csv"));
  };

  return { picture, table };
})();
