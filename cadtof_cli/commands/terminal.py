"""Lines for people and programs: nothing in them can steer a terminal, and what keeps them from being written is said."""

import os
import re
import sys

import click

from cadtof_cli.errors import OutputError

_STEERING = "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
"""Control characters but tab and new line, those that turn the direction of writing, and bytes of names that are no UTF-8."""


def shown(text: str, /) -> str:
    """Return a text with everything escaped in it that a terminal would obey instead of showing it."""
    return re.sub(_STEERING, lambda found: repr(found.group())[1:-1], text)


def tell(text: object, /, *, err: bool = False) -> None:
    """Write a line to stdout, or to stderr.

    Raises:
        OutputError: stdout cannot be written. Of stderr nobody would hear.
        BrokenPipeError: the reader of stdout has gone away.
    """
    try:
        click.echo(shown(str(text)), err=err)
    except BrokenPipeError:
        if not err:
            raise
    except OSError as error:
        if not err:
            raise OutputError(f"standard output: cannot be written: {error.strerror}") from error


def open_closed_streams() -> None:
    """Put something in the place of closed stdin, stdout and stderr, so that no file that is opened becomes one of them.

    Whatever is written to a closed stdout fails then; a closed stderr takes everything and shows nothing.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    sys.stdin = sys.stdin or os.fdopen(0, "r", encoding="utf-8", closefd=False)
    sys.stdout = sys.stdout or os.fdopen(1, "w", encoding="utf-8", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)
