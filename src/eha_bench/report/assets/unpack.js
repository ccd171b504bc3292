"use strict";
// Unpacks what report/packing.py packed: base64, deflate, byte planes, differences.
const unpack = (() => {
  async function planes(base64, width) {
    const squeezed = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const stream = new Blob([squeezed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    return { bytes, count: bytes.length / width };
  }

  // Values in display units; null where nothing was measured, for uPlot draws a gap there.
  async function curve(base64, middle, step) {
    const { bytes, count } = await planes(base64, 2);
    const values = new Float64Array(count);
    let level = 0;
    let gaps = false;
    for (let i = 0; i < count; i++) {
      level = ((level + (bytes[i] | (bytes[count + i] << 8))) << 16) >> 16;
      values[i] = level === -32768 ? NaN : middle + step * level;
      gaps ||= level === -32768;
    }
    return gaps ? Array.from(values, (v) => (Number.isNaN(v) ? null : v)) : values;
  }

  async function clock(entries) {
    const total = entries.reduce((sum, entry) => sum + entry.n, 0);
    const time = new Float64Array(total);
    // 1: a sample; 0 and 2: the smallest and largest value of a stretch
    const full = new Uint8Array(total);
    let at = 0;
    for (const entry of entries) {
      if (entry.packed === undefined) {
        for (let i = 0; i < entry.n; i++) time[at + i] = entry.start + i * entry.period;
      } else {
        const { bytes, count } = await planes(entry.packed, 4);
        let ticks = 0;
        for (let i = 0; i < count; i++) {
          ticks += bytes[i] + bytes[count + i] * 256 + bytes[2 * count + i] * 65536 + bytes[3 * count + i] * 16777216;
          time[at + i] = entry.start + (ticks / 0xffffffff) * entry.span;
        }
      }
      for (let i = 0; i < entry.n; i++) full[at + i] = entry.envelope ? 2 * (i % 2) : 1;
      at += entry.n;
    }
    return { time, full };
  }

  return { curve, clock };
})();
