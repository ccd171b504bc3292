"use strict";
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
