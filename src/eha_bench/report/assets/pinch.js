"use strict";
// Fingers on charts: one moves the cursor, two zoom and pan, a double tap shows the whole.
// A figure gives `range`, `setRange`, `remember`, `point` and `showWhole`.
const pinch = (() => {
  const CLOSEST = 24; // pixels between two fingers: closer ones tell no zoom
  const TAP = 300; // ms between the two taps of a double one, and how long one may last
  const STILL = 10; // pixels that a tap may wander

  function attach(figure, element) {
    const fingers = new Map();
    let held = null; // the instants under the two fingers, which stay under them
    let tapped = -Infinity;

    const area = (event) => event.target.closest?.(".u-over")?.getBoundingClientRect();
    const instant = (x, box) => {
      const [min, max] = figure.range;
      return min + ((x - box.left) / box.width) * (max - min);
    };
    const pair = () => [...fingers.values()].map((finger) => finger.x);

    element.addEventListener("pointerdown", (event) => {
      const box = event.pointerType === "touch" ? area(event) : undefined;
      if (!box || fingers.size === 2) return;
      fingers.set(event.pointerId, { x: event.clientX, from: event.clientX, since: event.timeStamp, box });
      held = fingers.size === 2 ? pair().map((x) => instant(x, box)) : null;
      if (fingers.size === 1) figure.point(instant(event.clientX, box));
    });

    element.addEventListener("pointermove", (event) => {
      const finger = fingers.get(event.pointerId);
      if (!finger) return;
      finger.x = event.clientX;
      const { box } = finger;
      if (fingers.size === 1) {
        figure.point(instant(finger.x, box));
        return;
      }
      const [a, b] = pair();
      if (Math.abs(b - a) < CLOSEST || held[0] === held[1]) return;
      const span = ((held[1] - held[0]) * box.width) / (b - a);
      const start = held[0] - ((a - box.left) / box.width) * span;
      if (span > 0) figure.setRange(start, start + span);
    });

    const lifted = (event) => {
      const finger = fingers.get(event.pointerId);
      if (!finger) return;
      fingers.delete(event.pointerId);
      if (held) {
        held = null;
        fingers.clear();
        figure.remember();
        return;
      }
      const tap = event.type === "pointerup" && event.timeStamp - finger.since < TAP && Math.abs(finger.x - finger.from) < STILL;
      if (tap && event.timeStamp - tapped < TAP) figure.showWhole();
      tapped = tap ? event.timeStamp : -Infinity;
    };
    element.addEventListener("pointerup", lifted);
    element.addEventListener("pointercancel", lifted);
  }

  return { attach };
})();
