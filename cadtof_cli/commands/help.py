"""What all commands share: a note on options that are given twice, and the layout of help, with options under headings,
examples at the end, and one column instead of two on narrow terminals.

tests/cli/test_examples.py runs all examples, line by line, in a folder that holds sample_data.
"""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import click

from cadtof_cli.commands.terminal import note

NARROW = 60
"""On terminals with fewer columns, the description of an option stands under its name instead of beside it."""

_LEAST_COLUMNS = 20
"""Width in columns that every terminal is assumed to have."""

_UNBROKEN_HYPHEN = "\u2011"
"""Stands for a hyphen while lines are broken, because lines are broken after a hyphen."""


class _Formatter(click.HelpFormatter):
    """Writes no line that is wider than the terminal. Click itself assumes that a terminal has at least 50 columns."""

    def __init__(self, indent_increment: int = 2, width: int | None = None, max_width: int | None = None) -> None:
        import shutil

        columns = shutil.get_terminal_size().columns
        self._narrow = width is None and columns < NARROW
        super().__init__(indent_increment, max(columns - 1, _LEAST_COLUMNS) if self._narrow else width, max_width)

    def write_text(self, text: str) -> None:
        """Write a text. No line ends within a name that has a hyphen, such as an option, so that it can be copied."""
        begin = len(self.buffer)
        super().write_text(text.replace("-", _UNBROKEN_HYPHEN))
        self.buffer[begin:] = [one.replace(_UNBROKEN_HYPHEN, "-") for one in self.buffer[begin:]]

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        """Write names and their meanings: side by side, or on a narrow terminal each meaning under its name."""
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


class Command(click.Command):
    """A command that says which options were given several times, as only the last value counts."""

    context_class = HelpContext

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments into the parameters of the context, and return what is left of them."""
        _, _, given = self.make_parser(ctx).parse_args(list(args))
        left = super().parse_args(ctx, args)
        for option in dict.fromkeys(given):
            # a switch that is typed twice does what it says, unless it was turned off in between
            takes_one = isinstance(option, click.Option) and not option.multiple
            if (
                takes_one
                and given.count(option) > 1
                and (option.secondary_opts or not getattr(option, "is_flag", False))
            ):
                note(f"{option.opts[-1]}: given {given.count(option)} times; only the last one has an effect")
        return left


class SectionedCommand(Command):
    """A command whose help shows some options under headings of their own, and all others under "Options".

    `headings` gives, for each heading, the names of the parameters whose options stand under it.
    """

    def __init__(self, *args: Any, headings: Mapping[str, Collection[str]], **more: Any) -> None:
        super().__init__(*args, **more)
        self._headings = headings

    def sections(self, params: Iterable[click.Parameter], /) -> dict[str, list[click.Option]]:
        """Return the options among `params` by their heading, in the order of the headings."""
        found: dict[str, list[click.Option]] = {title: [] for title in ("Options", *self._headings)}
        for param in params:
            # arguments are described above the options; the newest click includes them in `params`, without help
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
    """Return the end of a help text: commands that work as printed, in a folder that holds nothing but sample_data.

    Each begins with `cadtof`. If the last one needs files that are not in sample_data, those before it make these files.
    """
    # \b keeps click from joining the lines into a paragraph
    return "\n".join(("\b", "Example:" if len(lines) == 1 else "Examples:", *(f"  {line}" for line in lines)))


def example_lines(epilog: str | None, /) -> tuple[str, ...]:
    """Return the commands at the end of a help text; an empty tuple if it shows none."""
    return tuple(line.strip() for line in (epilog or "").splitlines() if line.startswith("  cadtof "))
