"""The commands of a page, run one after the other in an empty folder beside sample_data, and what they print."""

import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from docs_checks.pages import commands
from docs_checks.printed import differences


def check_commands(page: Path, root: Path, folder: Path, /, *, slow: bool) -> Iterator[str]:
    """Run the commands of a page in a folder, and yield how what they print differs from what the page says.

    Args:
        page: the page; blocks after a mark `slow` are left out where `slow` is not set.
        root: of the repository, whose sample_data is put beside the commands.
        folder: where they run.
        slow: whether all commands are run.
    """
    if not (folder / "sample_data").exists():
        (folder / "sample_data").symlink_to(root / "sample_data")
    for command in commands(page):
        if command.slow and not slow:
            continue
        program, *arguments = shlex.split(command.words, comments=True)
        if program != "cadtof":
            yield f"{page.name}: $ {command.words}: only `cadtof` is run here"
            continue
        status, printed = run(arguments, root, folder)
        if status:
            yield f"{page.name}: $ {command.words}: ends with status {status}: {printed.strip()}"
        elif command.printed.strip():
            yield from (f"{page.name}: $ {command.words}: {told}" for told in differences(command.printed, printed))


def run(arguments: list[str], root: Path, folder: Path, /) -> tuple[int, str]:
    """Run `cadtof` in a folder and return its exit status and what it prints, as a terminal shows it."""
    done = subprocess.run(
        [sys.executable, "-m", "cadtof_cli", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(root), "COLUMNS": "160", "NO_COLOR": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout
