"""Run the commands of a page in an empty folder with sample_data, and compare their output with the page."""

import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from docs_checks.pages import commands
from docs_checks.printed import differences


def check_commands(page: Path, root: Path, folder: Path, /, *, slow: bool) -> Iterator[str]:
    """Run the commands of a page in a folder, and yield the differences between their output and the page.

    Args:
        page: the page.
        root: root of the repository; its sample_data is linked into the folder.
        folder: the folder in which the commands run.
        slow: whether all commands run; if not, blocks below a mark `SLOW` are left out.
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
    """Run `cadtof` in a folder; return its exit status and its output, stdout and stderr together as on a terminal."""
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
