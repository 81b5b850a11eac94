"""Packages and programs that some tests need: a missing one skips the test, but fails it under CI."""

import importlib
import os
import shutil
from typing import Any, NoReturn

import pytest


def needed_module(name: str) -> Any:
    """Return a module; if it is not installed, skip the test that asks for it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        miss(f"{name} is not installed")


def needed_program(name: str) -> str:
    """Return the path of a program; if it is not installed, skip the test that asks for it."""
    return shutil.which(name) or miss(f"{name} is not installed")


def miss(what: str) -> NoReturn:
    """Skip a test because something is missing; under CI, which must have everything, let it fail."""
    if os.environ.get("CI") == "true":
        pytest.fail(f"{what}, and CI must have it")
    pytest.skip(what)
