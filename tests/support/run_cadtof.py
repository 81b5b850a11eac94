"""Runs the command line in this process or in a new one: exit status, stdout and stderr, as a shell would see them."""

import contextlib
import io
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import pytest

from cadtof_cli.cli import main

ROOT = Path(__file__).parents[2]

PROGRAM = (sys.executable, "-W", "error", "-m", "cadtof_cli")

ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"},
    "PYTHONPATH": str(ROOT),
}
"""Streams are buffered, as for users. With PYTHONUNBUFFERED, a developer's setting, nothing would be written at exit."""

_WITHOUT_PRIVILEGE = """
import ctypes, os, sys
CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH, PR_CAPBSET_DROP = 1, 2, 24
for capability in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
    if os.geteuid() == 0 and ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, capability, 0, 0, 0):
        sys.exit(77)
os.execv(sys.argv[1], sys.argv[1:])
"""

_WITH_SMALL_FILES = """
import os, resource, sys
# otherwise Python would keep bytecode files that the limit has cut off
os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
os.execv(sys.argv[2], sys.argv[2:])
"""


@dataclass(frozen=True)
class Finished:
    """How a command ended."""

    status: int
    out: str
    err: str


def cadtof(*arguments: object) -> Finished:
    """Run `cadtof` with the arguments in this process; with --jobs 1 it starts no other processes."""
    out, err = io.StringIO(), io.StringIO()
    status = 0
    argv = ["cadtof", *map(str, arguments)]
    with patch.object(sys, "argv", argv), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else 1
    return Finished(status, out.getvalue(), err.getvalue())


def program(*arguments: object, stdin: str = "", before: tuple[str, ...] = ()) -> Finished:
    """Run `cadtof` as a program; the words `before` precede it in the command, and a warning in it is an error."""
    command = [*before, *PROGRAM, *map(str, arguments)]
    done = subprocess.run(
        command, input=stdin, env=ENVIRONMENT, capture_output=True, text=True, timeout=120, check=False
    )
    return Finished(done.returncode, done.stdout, done.stderr)


def without_privilege(*arguments: object) -> Finished:
    """Run `cadtof` so that permissions of files hold for it, even if the tests run as root."""
    done = program(*arguments, before=(sys.executable, "-c", _WITHOUT_PRIVILEGE))
    if done.status == 77:
        pytest.skip("root cannot give up its privilege here")
    return done


def with_small_files(limit: int, *arguments: object) -> Finished:
    """Run `cadtof` so that no file may grow beyond `limit` bytes."""
    return program(*arguments, before=(sys.executable, "-c", _WITH_SMALL_FILES, str(limit)))
