"""Other people's programs, where they are installed."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.needed import miss
from tests.support.outside_tools import MAKERS, run_tool

Tool = Callable[..., str]


@pytest.fixture
def tool() -> Tool:
    """Return a function that runs a program and returns what it prints; a missing one skips the test, but fails it under CI."""

    def run(name: str, *arguments: str | Path) -> str:
        printed = run_tool(name, *arguments)
        if printed is None:
            miss(f"{name} of {MAKERS[name].name} is not installed")
        return printed

    return run
