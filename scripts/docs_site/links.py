"""Check the links of a built site: every file and anchor exists, and nothing is loaded from the network."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}

_IN_STYLES = re.compile(r"url\(\s*['\"]?(https?:)?//|@import\s+['\"]?https?:")


class _Page(HTMLParser):
    """The anchors, links and loaded files of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note the anchor and the link of a tag."""
        values = {name: value for name, value in attrs if value is not None}
        self.anchors.update(values[name] for name in ("id", "name") if name in values)
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag in _LOADED and _LOADED[tag] in values:
            self.loaded.append(values[_LOADED[tag]])


def broken_links(site: Path, /) -> Iterator[str]:
    """Yield the problems with the links of a site."""
    pages: dict[Path, _Page] = {}
    for file in sorted(site.rglob("*.html")):
        pages[file] = _Page()
        pages[file].feed(file.read_text(encoding="utf-8"))
    for file, page in pages.items():
        place = file.relative_to(site)
        for target in page.loaded:
            if urlsplit(target).netloc:
                yield f"{place}: loads {target}, and a page must need no network"
        for target in (*page.links, *page.loaded):
            split = urlsplit(target)
            if split.scheme or split.netloc:
                continue
            there = (file.parent / unquote(split.path)).resolve() if split.path else file
            if not there.exists():
                yield f"{place}: {target} leads nowhere"
            elif split.fragment and there in pages and unquote(split.fragment) not in pages[there].anchors:
                yield f"{place}: {target} has no such anchor"
    for style in sorted(site.rglob("*.css")):
        if _IN_STYLES.search(style.read_text(encoding="utf-8")):
            yield f"{style.relative_to(site)}: loads from the network"
