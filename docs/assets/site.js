// Wide code and tables can be scrolled with the keyboard. For screen readers the search has a name, and buttons of code
// and parts of the table of contents are no landmarks.
function reachable() {
  for (const box of document.querySelectorAll("pre > code, .md-typeset__scrollwrap")) {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}

addEventListener("load", () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  reachable();
});
addEventListener("resize", reachable);

function plain() {
  const places = "nav.md-code__nav:not([role]), .md-nav--secondary nav:not([role])";
  for (const place of document.querySelectorAll(places)) {
    place.setAttribute("role", "none");
    place.removeAttribute("aria-label");
  }
}
new MutationObserver(plain).observe(document.documentElement, { childList: true, subtree: true });
plain();
