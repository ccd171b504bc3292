"use strict";
// Where charts can be drawn the static plots need no layout; charts.js takes the mark back if it fails.
if (typeof DecompressionStream !== "undefined") document.documentElement.classList.add("charted");
// uPlot asks Intl for navigator.language when it loads; some browsers report one that Intl refuses.
(() => {
  try {
    new Intl.NumberFormat(navigator.language);
  } catch {
    const Real = Intl.NumberFormat;
    Intl.NumberFormat = function (_, options) {
      return new Real("en", options);
    };
    Intl.NumberFormat.prototype = Real.prototype;
    Intl.NumberFormat.supportedLocalesOf = Real.supportedLocalesOf;
    try {
      Object.defineProperty(navigator, "language", { value: "en", configurable: true });
    } catch {
      // it stays as it is; nothing else asks
    }
  }
})();
