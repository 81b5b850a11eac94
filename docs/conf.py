"""Sphinx: how `scripts/docs` turns these pages into a site."""

import html
import re
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert
from sphinx.util import logging

_log = logging.getLogger(__name__)

project = "cadtof"
author = "The cadtof developers"
copyright = "The cadtof developers, MIT licence"

extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
exclude_patterns = ["conf.py"]

html_theme = "furo"
html_title = "cadtof"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_math_renderer = "mathml"
html_show_sourcelink = False
smartquotes = False
highlight_language = "text"
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "github-dark"


def setup(app: Any) -> None:
    """Write equations as MathML, which browsers draw by themselves: no script, no network."""

    def inline(translator: Any, node: Any) -> None:
        translator.body.append(_mathml(node.astext()))
        raise SkipNode

    def block(translator: Any, node: Any) -> None:
        translator.body.append(f'<div class="math">{_mathml(node.astext(), display="block")}</div>')
        raise SkipNode

    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    # after the theme has made its sidebar
    app.connect("html-page-context", _for_keys_and_screen_readers, priority=900)


LONGEST_LINE = 80
"""About the length of a line of code that a page of usual width shows; a block with a longer one scrolls."""


def _for_keys_and_screen_readers(_app: Any, _page: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
    """Give headings of the contents a level, and let the Tab key reach blocks of code that scroll."""
    for part in {"body", "furo_navigation_tree"} & context.keys():
        levelled = context[part].replace('role="heading">', 'role="heading" aria-level="2">')
        context[part] = re.sub("<pre>(.*?)</pre>", _scrollable, levelled, flags=re.DOTALL)


def _scrollable(block: re.Match[str]) -> str:
    lines = html.unescape(re.sub("<[^>]*>", "", block[1])).splitlines()
    return (
        block[0].replace("<pre>", '<pre tabindex="0">') if max(map(len, lines), default=0) > LONGEST_LINE else block[0]
    )


def _mathml(latex: str, **more: Any) -> str:
    converted: str = convert(latex, **more)
    if "\\" in converted:
        _log.warning("an equation has a command that MathML is not made of: %s", latex)
    return converted
