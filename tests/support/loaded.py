"""Modules that a script loads, found in a new process."""

import subprocess
import sys

from tests.support.run_cadtof import ENVIRONMENT

_NAMES = "\nimport sys\nprint()\nprint(*sys.modules)"

COMMAND_LINE = """
from cadtof_cli.cli import main
try:
    main()
except SystemExit as ended:
    assert not ended.code
"""
"""A script that runs the command line with its arguments."""


def loaded_modules(script: str, *arguments: str) -> set[str]:
    """Return the names of all modules that are loaded after a script has run in a new process."""
    done = subprocess.run(
        [sys.executable, "-c", script + _NAMES, *arguments],
        env=ENVIRONMENT, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    return set(done.stdout.splitlines()[-1].split())
