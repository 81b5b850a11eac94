"""Write a page for every command from its help."""

import re
from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path

import click
from man_pages import commands_of, contexts, option_sections

from cadtof_cli.cli import COMMANDS
from cadtof_cli.commands.help import example_lines


def write_command_pages(folder: Path, /) -> list[str]:
    """Write the pages into a folder, and return their names in the order of `cadtof --help`."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for context in contexts():
        if context.parent is not None:
            names.append(context.command_path.replace(" ", "-"))
            (folder / f"{names[-1]}.md").write_text(_page(context), encoding="utf-8")
    (folder / "index.md").write_text(_index(names), encoding="utf-8")
    return names


def _index(names: list[str]) -> str:
    rows = [f"| [`cadtof {name}`](cadtof-{name}.md) | {_plain(about)} |" for name, about in COMMANDS.items()]
    listed = "\n".join(names)
    return f"""# Commands

| command | what it does |
|---|---|
{chr(10).join(rows)}

`cadtof --debug COMMAND …` shows the traceback of an error. Every page here is what `--help` says. Files and layers are in
[What comes out](../capture.md#what-comes-out).

```{{toctree}}
:hidden:
{listed}
```
"""


def _page(context: click.Context) -> str:
    command = context.command
    parts = [f"# {context.command_path}", _description(cleandoc(command.help or ""))]
    parts.append(f"```text\n{context.command_path} {' '.join(command.collect_usage_pieces(context))}\n```")
    if isinstance(command, click.Group):
        parts.append(_steps(context))
    for title, options in option_sections(command).items():
        parts += [f"## {title}", *_options(context, options)]
    lines = example_lines(command.epilog)
    parts += ["## Example" if len(lines) == 1 else "## Examples", f"```text\n{chr(10).join(lines)}\n```"]
    return "\n\n".join(parts) + "\n"


def _steps(context: click.Context) -> str:
    rows = []
    for name, below in commands_of(context):
        page = f"{context.command_path} {name}".replace(" ", "-")
        rows.append(f"| [`{context.command_path} {name}`]({page}.md) | {_plain(below.get_short_help_str(limit=200))} |")
    return "| step | what it does |\n|---|---|\n" + "\n".join(rows)


def _options(context: click.Context, options: list[click.Option]) -> Iterator[str]:
    for option in options:
        record = option.get_help_record(context)
        if record is not None:
            names, about = record
            yield f"`{names}`\n: {_plain(' '.join(about.split()))}"


def _description(help_text: str) -> str:
    """Return a help text as Markdown.

    Paragraphs that click does not refill become tables; they may begin with a heading line.
    """
    parts = []
    for part in re.split(r"\n\s*\n", help_text):
        if part.startswith("\b"):
            parts.append(_table(part.removeprefix("\b").strip("\n").splitlines()))
        else:
            parts.append(_plain(" ".join(part.split())))
    return "\n\n".join(parts)


def _table(lines: list[str]) -> str:
    """Return lines of two columns as a table; a line of one column before them is its heading."""
    heading = ""
    rows: list[list[str]] = []
    for line in lines:
        name, gap, meaning = line.strip().partition("  ")
        if gap:
            rows.append([name, meaning.strip()])
        elif rows:
            rows[-1][1] += f" {name}"
        else:
            heading = _plain(name.removesuffix(":"))
    assert rows, lines
    cells = "\n".join(f"| {_plain(name)} | {_plain(meaning)} |" for name, meaning in rows)
    return f"| {heading} | |\n|---|---|\n{cells}"


def _plain(text: str) -> str:
    """Return text with all signs escaped that mean something to Markdown. `code` stays, and options become code."""
    pieces = "`".join(
        piece if number % 2 else re.sub(r"(?<![\w-])--[a-z][a-z0-9-]*", r"`\g<0>`", piece)
        for number, piece in enumerate(text.split("`"))
    ).split("`")
    pieces[::2] = [re.sub(r"([\\*_<>\[\]$|#{}~^])", r"\\\1", piece) for piece in pieces[::2]]
    return "`".join(pieces)
