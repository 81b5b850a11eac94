"""The command line run in this process: exit status, stdout and stderr, as a shell would see them."""

import contextlib
import io
import sys
from dataclasses import dataclass
from unittest.mock import patch

from cadtof_cli.cli import main


@dataclass(frozen=True)
class Finished:
    """How a command ended."""

    status: int
    out: str
    err: str


def cadtof(*arguments: object) -> Finished:
    """Run `cadtof` with the arguments."""
    out, err = io.StringIO(), io.StringIO()
    status = 0
    argv = ["cadtof", *map(str, arguments)]
    with patch.object(sys, "argv", argv), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else 1
    return Finished(status, out.getvalue(), err.getvalue())
