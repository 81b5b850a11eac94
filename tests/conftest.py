"""Other people's programs, where they are installed."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

Tool = Callable[..., str]


@pytest.fixture
def tool() -> Tool:
    """Return a function that runs a program and returns what it prints; a missing one skips the test, but fails it under CI."""

    def run(*command: str | Path) -> str:
        program = shutil.which(command[0])
        if program is None:
            if os.environ.get("CI") == "true":
                pytest.fail(f"{command[0]} is not installed, and CI must have it")
            pytest.skip(f"{command[0]} is not installed")
        done = subprocess.run([program, *command[1:]], capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
