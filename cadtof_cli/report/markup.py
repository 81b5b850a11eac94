"""Markup that no name can break. Texts are escaped when they become markup, and nowhere else."""

import html
from collections.abc import Iterable, Sequence

from cadtof_cli.units import printable


class Markup(str):
    """Text that is markup already, so that it is not escaped."""

    __slots__ = ()


EMPTY = Markup("")


def text(raw: object, /) -> Markup:
    """Return the markup that shows a text, whatever characters it has; markup is returned unchanged."""
    return raw if isinstance(raw, Markup) else Markup(html.escape(printable(str(raw))))


def joined(pieces: Iterable[Markup], /) -> Markup:
    """Return pieces of markup, joined in their order."""
    return Markup("".join(pieces))


def element(tag: str, /, *children: object, **attributes: object) -> Markup:
    """Return an element whose children are texts and markup.

    Attributes that are None or False are left out. In the name of an attribute, `_` stands for `-`; at its end, `_` is
    dropped.
    """
    written = ""
    for name, value in attributes.items():
        if value is not None and value is not False:
            shown = "" if value is True else f'="{text(str(value))}"'
            written += f" {name.rstrip('_').replace('_', '-')}{shown}"
    # HTML calls this element void: it has no children and no end tag
    if tag == "img":
        return Markup(f"<{tag}{written}>")
    return Markup(f"<{tag}{written}>{joined(map(text, children))}</{tag}>")


def table(
    head: Sequence[str],
    rows: Iterable[Sequence[object]],
    /,
    *,
    caption: str,
    numbers: Iterable[int] = (),
    folded: bool = False,
) -> Markup:
    """Return a table. If it is wider than the page, it scrolls on its own. The first column names the row.

    `numbers` are the places, above 0, of columns of numbers. If `folded`, only the caption is shown until the reader opens it.
    """
    kinds = ["number" if column in frozenset(numbers) else None for column in range(len(head))]
    titles = (element("th", title, scope="col", class_=kind) for title, kind in zip(head, kinds, strict=True))
    lines = (
        element(
            "tr",
            element("th", row[0], scope="row"),
            *(element("td", content, class_=kind) for content, kind in zip(row[1:], kinds[1:], strict=True)),
        )
        for row in rows
    )
    body = element("table", element("thead", element("tr", *titles)), element("tbody", *lines), aria_label=caption)
    # outside of the scrolling part, so that the caption stays in view
    title = element("h3", caption, class_="caption")
    scrolling = element("div", body, class_="wide", tabindex=0, role="region", aria_label=caption)
    return element("details", element("summary", title), scrolling) if folded else joined((title, scrolling))
