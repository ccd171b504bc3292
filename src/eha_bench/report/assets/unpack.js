"use strict";
// Unpacks what report/packing.py packed: base64, deflate, byte planes, differences.
const unpack = (() => {
  async function planes(base64, width) {
    const squeezed = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const { writable, readable } = new DecompressionStream("deflate");
    const writer = writable.getWriter();
    // closed once all is written: a browser under load took what it had for all there is;
    // what is wrong with the data is told where they are read
    writer.write(squeezed).then(() => writer.close()).catch(() => {});
    const bytes = await whole(readable.getReader());
    return { bytes, count: bytes.length / width };
  }

  // Not by way of a Blob and a Response: a browser under load fails to fetch what it holds itself.
  async function whole(reader) {
    const parts = [];
    for (let part = await reader.read(); !part.done; part = await reader.read()) parts.push(part.value);
    const bytes = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
    let at = 0;
    for (const part of parts) {
      bytes.set(part, at);
      at += part.length;
    }
    return bytes;
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
