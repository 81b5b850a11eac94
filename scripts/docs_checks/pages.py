"""Split pages of the documentation into sections, prose without code, and commands with their output."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_FENCE = re.compile(r"(?ms)^```(\w*)[^\n]*\n(.*?)^```$")
_INDENTED = re.compile(r"(?m)(?:^ {4}[^\n]*\n(?:[ \t]*\n(?= {4}))*)+")

SLOW = "<!-- slow -->"
"""Stands before a block whose commands `scripts/check_docs` runs only with --full."""


@dataclass(frozen=True)
class Section:
    """A heading of a page, and the text below it up to the next heading."""

    page: Path
    heading: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.name}: “{self.heading}”"

    @property
    def prose(self) -> str:
        """The text without code, comments and pictures."""
        text = re.sub(r"(?s)<!--.*?-->", "", self.text)
        text = _INDENTED.sub("", _FENCE.sub("", text))
        text = re.sub(r"(?s)\$\$.*?\$\$|\$[^$\n]+\$", "", text)
        return re.sub(r"`[^`\n]*`|!?\[[^\]]*\]\([^)]*\)|doi:\S+|https?://\S+", "", text)


@dataclass(frozen=True)
class Command:
    """A command on a page, and the output that the page shows.

    `slow`: `scripts/check_docs` runs it only with --full.
    """

    words: str
    printed: str
    slow: bool


def sections(page: Path, /) -> Iterator[Section]:
    """Yield the sections of a page. Text above the first heading is left out."""
    text = page.read_text(encoding="utf-8")
    kept = _FENCE.sub(lambda match: re.sub(r"(?m)^#", "\\\\#", match.group(0)), text)
    for part in re.split(r"(?m)^(?=#{1,4} )", kept):
        heading, _, rest = part.partition("\n")
        if heading.startswith("#"):
            yield Section(page, heading.lstrip("# "), rest)


def commands(page: Path, /) -> Iterator[Command]:
    """Yield the commands of a page in their order: the lines of its code blocks that begin with `$`."""
    text = page.read_text(encoding="utf-8")
    blocks = [(match.start(), match.group(2)) for match in _FENCE.finditer(text)]
    bare = _FENCE.sub(lambda match: re.sub(r"[^\n]", "x", match.group(0)), text)
    blocks += [(match.start(), re.sub(r"(?m)^ {4}", "", match.group(0))) for match in _INDENTED.finditer(bare)]
    for start, block in sorted(blocks):
        slow = text[:start].rstrip().endswith(SLOW)
        for part in re.split(r"(?m)^\$ ", block)[1:]:
            words, _, printed = part.partition("\n")
            yield Command(words.strip(), printed, slow)
