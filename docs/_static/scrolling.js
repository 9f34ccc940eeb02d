// Parts that scroll sideways are stops of the keyboard, in browsers that do not see to it themselves.
const PARTS = "article pre, article .formula, article .table-wrapper, article p:has(> img)";

function markScrolling() {
  for (const part of document.querySelectorAll(PARTS)) {
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
    else part.removeAttribute("tabindex");
  }
}

document.fonts.ready.then(markScrolling);
addEventListener("load", markScrolling);
addEventListener("resize", markScrolling);
