// What scrolls sideways is reached by the keyboard; the theme makes some of it after the page is there.
const reachable = () => {
  for (const element of document.querySelectorAll("pre > code, .md-typeset__scrollwrap")) element.tabIndex = 0;
};
addEventListener("load", () => {
  reachable();
  new MutationObserver(reachable).observe(document.body, { childList: true, subtree: true });
});
