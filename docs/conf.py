"""Sphinx: how `scripts/docs` turns these pages into a site."""

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
pygments_style = "friendly"
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


def _mathml(latex: str, **more: Any) -> str:
    converted: str = convert(latex, **more)
    if "\\" in converted:
        _log.warning("an equation has a command that MathML is not made of: %s", latex)
    return converted
