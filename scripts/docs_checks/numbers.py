"""Check the sources of numbers: every section with measured numbers names the script or test that makes them."""

import re
from collections.abc import Iterator
from pathlib import Path

from docs_checks.pages import Section, commands, sections

_MEASURED = re.compile(
    r"(?<![\w.])\d*\.\d+(?![\w.]*\.\d)|(?<![\w.])\d+(?:\.\d+)? ?(?:%|×|cm|mm|ms|µs|min\b|s\b|frames/s|MB|GB)"
)
"""Numbers that were measured or chosen: decimals, and numbers with a unit."""

REASON = re.compile(r"<!-- numbers: (.+?) -->", re.DOTALL)
"""A comment, not visible on the page, that says why no script makes a section's numbers: chosen, defined, or from
the paper."""

_WHOLE_PAGE = re.compile(r"\b(?:made|written) by\s`scripts/\w+[^`]*`", re.IGNORECASE)
"""The phrase by which a page says that a script has written it, numbers included."""

_PLACE = re.compile(r"`(?:python |pytest |[A-Z_]+=\S+ )*((?:scripts|tests)/[\w./]+)")


def unsourced(page: Path, root: Path, /) -> Iterator[str]:
    """Yield the sections of a page with numbers of unknown origin, and named places that are not in the repository."""
    whole = any(_WHOLE_PAGE.search(section.text) for section in sections(page))
    for section in sections(page):
        for place in _PLACE.findall(section.text):
            if not (root / place).exists():
                yield f"{section}: {place} is not there"
        measured = _MEASURED.findall(section.prose)
        if measured and not whole and not has_source(section):
            shown = ", ".join(dict.fromkeys(number.strip() for number in measured[:5]))
            yield f"{section} has numbers ({shown}) and says neither which script or test makes them nor why none does"


def has_source(section: Section, /) -> bool:
    """Return whether a section names the source of its numbers: a script, a test, commands that are run, or a reason."""
    if _PLACE.search(section.text) or REASON.search(section.text):
        return True
    return bool(re.search(r"(?m)^(?: {4})?\$ cadtof |^>>> |`time cadtof ", section.text))


def stale_options(page: Path, known: frozenset[str], /) -> Iterator[str]:
    """Yield the options in the code of a page that are not known."""
    text = page.read_text(encoding="utf-8")
    code = "\n".join((*re.findall(r"`([^`\n]*--[^`\n]*)`", text), *(one.words for one in commands(page))))
    for option in dict.fromkeys(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", code)):
        if option not in known:
            yield f"{page.name}: no command or script has the option {option}"
