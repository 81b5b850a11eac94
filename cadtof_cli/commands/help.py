"""Help: headings of options, examples at its end, and narrow terminals, where two columns would leave no room for words.

tests/cli/test_examples.py runs all examples, line by line, beside sample_data.
"""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import click

NARROW = 60
"""Columns of a terminal below which what an option does stands beneath its name, not beside it."""

_LEAST = 20
"""Columns that are taken for granted."""


class _Formatter(click.HelpFormatter):
    """Writes no line that is wider than the terminal; click takes 50 columns for granted."""

    def __init__(self, indent_increment: int = 2, width: int | None = None, max_width: int | None = None) -> None:
        import shutil

        columns = shutil.get_terminal_size().columns
        self._narrow = width is None and columns < NARROW
        super().__init__(indent_increment, max(columns - 1, _LEAST) if self._narrow else width, max_width)

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        """Write names and what they mean: beneath each other where there is no room beside each other."""
        if not self._narrow:
            super().write_dl(rows, col_max, col_spacing)
            return
        for name, meaning in rows:
            self.write_text(name)
            with self.indentation(), self.indentation():
                self.write_text(meaning)


class HelpContext(click.Context):
    """The context of a command whose help fits narrow terminals."""

    formatter_class = _Formatter


class SectionedCommand(click.Command):
    """A command whose help shows some options under headings of their own.

    Args:
        headings: names of parameters by the heading that their options stand under; the others stand under "Options".
    """

    context_class = HelpContext

    def __init__(self, *args: Any, headings: Mapping[str, Collection[str]], **more: Any) -> None:
        super().__init__(*args, **more)
        self._headings = headings

    def sections(self, params: Iterable[click.Parameter], /) -> dict[str, list[click.Option]]:
        """Return the options among some parameters by their headings, in the order of these."""
        found: dict[str, list[click.Option]] = {title: [] for title in ("Options", *self._headings)}
        for param in params:
            # arguments are described above the options; the newest click lists them here too, without help
            if isinstance(param, click.Option):
                own = (title for title, names in self._headings.items() if param.name in names)
                found[next(own, "Options")].append(param)
        return {title: options for title, options in found.items() if options}

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options below their headings."""
        for title, options in self.sections(self.get_params(ctx)).items():
            with formatter.section(title):
                formatter.write_dl([record for one in options if (record := one.get_help_record(ctx))])


def example(*lines: str) -> str:
    """Return the end of a help text: commands that work as they stand where sample_data lies, in an empty folder otherwise.

    Args:
        lines: each begins with `cadtof`; where the last needs files that are not in sample_data, those before it make them.
    """
    # \b keeps click from filling the lines
    return "\n".join(("\b", "Example:" if len(lines) == 1 else "Examples:", *(f"  {line}" for line in lines)))


def example_lines(epilog: str | None, /) -> tuple[str, ...]:
    """Return the commands in the end of a help text; nothing where it shows none."""
    return tuple(line.strip() for line in (epilog or "").splitlines() if line.startswith("  cadtof "))
