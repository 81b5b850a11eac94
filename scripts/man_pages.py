"""Write a man page of every command, from its help by click-man: `python scripts/man_pages.py FOLDER`.

setup.py puts the pages into wheels. This module adds what click-man leaves out: headings among the options, the example
at the end, paragraphs that are not refilled, and escapes for text that roff would take for its own.
"""

import argparse
import re
from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path

import click
from click_man.man import ManPage

from cadtof_cli import __version__
from cadtof_cli.cli import COMMANDS, cli
from cadtof_cli.commands.help import SectionedCommand, example_lines

_NO_DATE = ""
"""Pages have no date, so that the same source gives the same pages."""


def main() -> None:
    """Write the pages into the folder of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the pages; created if it does not exist")
    write_man_pages(parser.parse_args().folder)


def write_man_pages(folder: Path, /) -> list[Path]:
    """Write a page for every command into a folder, which is created if it does not exist, and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for context in contexts():
        written.append(folder / f"{context.command_path.replace(' ', '-')}.1")
        written[-1].write_text(man_page(context), encoding="utf-8")
    return written


def contexts() -> Iterator[click.Context]:
    """Yield a context for every command: the program, its commands, and the commands of its groups."""
    program = click.Context(cli, info_name="cadtof")
    yield program
    waiting = [(program, name, command) for name, command in commands_of(program)]
    while waiting:
        parent, name, command = waiting.pop(0)
        here = click.Context(command, info_name=name, parent=parent)
        yield here
        waiting += [(here, inner, below) for inner, below in commands_of(here)]


def commands_of(context: click.Context, /) -> Iterator[tuple[str, click.Command]]:
    """Yield the commands of a group with their names; none if the command is no group."""
    if isinstance(context.command, click.Group):
        for name in context.command.list_commands(context):
            command = context.command.get_command(context, name)
            assert command is not None
            yield name, command


def man_page(context: click.Context, /) -> str:
    """Return the page of one command, for `man`."""
    command, name = context.command, context.command_path
    page = ManPage(name)
    page.version, page.date = __version__, _NO_DATE
    help_text = cleandoc(command.help or "")
    # `apropos` shows this text after the name of the page, without a full stop
    page.short_help = COMMANDS.get(name.partition(" ")[2], command.short_help or help_text.partition("\n")[0]).rstrip(
        "."
    )
    page.description = _described(help_text)
    page.synopsis = " ".join(command.collect_usage_pieces(context))
    page.options = _options(context)
    page.commands = [
        (below, COMMANDS.get(below) or one.get_short_help_str(limit=100)) for below, one in commands_of(context)
    ]
    # the page of a command in a group is named with a hyphen: GROUP-COMMAND
    text = str(page).replace(f"See \\fB{name}-", f"See \\fB{name.replace(' ', '-')}-")
    return f"{text}{_example(example_lines(command.epilog))}{_see_also(context)}"


def option_sections(command: click.Command, /) -> dict[str, list[click.Option]]:
    """Return the options of a command, by the headings in its help."""
    if isinstance(command, SectionedCommand):
        return command.sections(command.params)
    options = [param for param in command.params if isinstance(param, click.Option)]
    return {"Options": options} if options else {}


def _options(context: click.Context) -> list[tuple[str, str]]:
    """Return the options with their help. click-man knows no headings, so a heading ends the help of the option before it."""
    found: list[tuple[str, str]] = []
    for title, options in option_sections(context.command).items():
        if found:
            option, about = found[-1]
            found[-1] = option, f"{about}\n.SS {title}"
        records = filter(None, (one.get_help_record(context) for one in options))
        found += [(option, _filled(about)) for option, about in records]
    return found


def _described(help_text: str) -> str:
    """Return paragraphs as roff; paragraphs that click does not refill keep their lines."""
    return "\n.PP\n".join(
        f".nf\n{_lines(part.removeprefix(chr(8)).lstrip())}\n.fi" if part.startswith("\b") else _lines(part)
        for part in re.split(r"\n\s*\n", help_text)
    )


def _lines(text: str) -> str:
    r"""Return text in which roff finds no request at the start of a line, and no escape."""
    return "\n".join(re.sub(r"^([.'])", r"\\&\1", line.replace("\\", r"\e")) for line in text.splitlines())


def _filled(text: str) -> str:
    return _lines(" ".join(text.split()))


def _example(lines: tuple[str, ...]) -> str:
    return f".SH EXAMPLES\n.nf\n{_lines(chr(10).join(lines)).replace('-', chr(92) + '-')}\n.fi\n" if lines else ""


def _see_also(context: click.Context) -> str:
    if context.parent is None:
        return ""
    return f".SH SEE ALSO\n.BR {context.parent.command_path.replace(' ', chr(92) + '-')} (1)\n"


if __name__ == "__main__":
    main()
