"use strict";
// What stays in sight of a page of trials: which of them are shown, and which are open.
(() => {
  const bar = document.querySelector(".contents .filter");
  if (!bar) return;
  bar.hidden = false;
  const trials = [...document.querySelectorAll("details.trial")];
  const buttons = [...bar.querySelectorAll("[data-show]")];
  const jump = bar.querySelector("select");

  const show = (wanted) => {
    for (const trial of trials) trial.hidden = !wanted(trial);
  };
  const press = (group) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.show === group));
  };
  for (const button of buttons) {
    button.addEventListener("click", () => {
      const group = button.dataset.show;
      press(group);
      jump.value = "";
      show((trial) => group === "all" || trial.dataset.group === group);
    });
  }
  jump.addEventListener("change", () => {
    press(jump.value ? "" : "all");
    show((trial) => !jump.value || trial.id === jump.value);
    const chosen = trials.find((trial) => trial.id === jump.value);
    if (chosen) chosen.open = true;
  });
  for (const button of bar.querySelectorAll("[data-fold]")) {
    button.addEventListener("click", () => {
      for (const trial of trials) if (!trial.hidden) trial.open = button.dataset.fold === "open";
    });
  }

  // A link to a trial that is folded or left out by the filter opens it.
  const follow = () => {
    const named = document.getElementById(location.hash.slice(1)) ?? document.getElementById(`trial=${encodeURIComponent(new URLSearchParams(location.hash.slice(1)).get("trial") ?? "")}`);
    const trial = named?.closest("details.trial");
    if (!trial) return;
    if (trial.hidden) buttons[0].click();
    for (let fold = named.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
  };
  addEventListener("hashchange", follow);
  follow();
})();
