"""What screen readers need of a page; where one lacks it, the build of the site warns, and so ends."""

from html.parser import HTMLParser
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.typing import ExtensionMetadata

_LOGGER = logging.getLogger(__name__)

# A cell and a link are named by their text, or by what a picture in them says.
_NAMED = {"a": "link without a name", "th": "header of a table without a text"}


class _Page(HTMLParser):
    """Gather what is missing in a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.missing: list[str] = []
        self.ids: set[str] = set()
        self.titles = 0
        self.asides: list[str] = []
        self._list_begins = False
        self._named: list[tuple[str, str, list[str]]] = []  # tag, where, its texts
        self.feed(text)
        if self.titles != 1:
            self.missing.append(f"{self.titles} headings of level 1")
        if len(set(self.asides)) < len(self.asides):
            self.missing.append("asides without names of their own")

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.titles += tag == "h1"
        if self._list_begins and tag != "dt":
            self.missing.append("list of definitions without a term")
        self._list_begins = tag == "dl"
        if tag == "aside":
            self.asides.append(found.get("aria-label", ""))
        if found.get("role") == "heading" and "aria-level" not in found:
            self.missing.append("heading without a level")
        if tag == "img" and "alt" not in found:
            self.missing.append(f"picture {found.get('src')} without a text")
        if name := found.get("id"):
            if name in self.ids:
                self.missing.append(f"id {name} twice")
            self.ids.add(name)
        for _, _, texts in self._named:
            texts += [found.get(key, "") for key in ("alt", "aria-label", "title")]
        if tag in _NAMED and (tag == "th" or "href" in found):
            own = [found.get(key, "") for key in ("aria-label", "title")]
            self._named.append((tag, found.get("href", ""), own))

    def handle_data(self, data: str) -> None:
        for _, _, texts in self._named:
            texts.append(data)

    def handle_endtag(self, tag: str) -> None:
        if self._named and self._named[-1][0] == tag:
            _, where, texts = self._named.pop()
            if not "".join(texts).strip():
                self.missing.append(f"{_NAMED[tag]} {where}".strip())


def missing(text: str) -> list[str]:
    """List what a page lacks for those who do not see it."""
    return _Page(text).missing


def _check(app: Sphinx, error: Exception | None) -> None:
    if error or app.builder.name != "html":
        return
    for page in sorted(Path(app.outdir).rglob("*.html")):
        if page.parent.name == "_static":
            continue  # a page of its own, which the tests of the live page open
        for what in missing(page.read_text(encoding="utf-8")):
            _LOGGER.warning("%s: %s", page.relative_to(app.outdir), what)


def setup(app: Sphinx) -> ExtensionMetadata:
    """Check all pages when they are written."""
    app.connect("build-finished", _check)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
