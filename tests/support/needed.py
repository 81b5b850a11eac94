"""Python packages that some tests need: a missing one skips the test, but fails it under CI."""

import importlib
import os
from typing import Any

import pytest


def needed_module(name: str) -> Any:
    """Return a module, or skip the test that asks for it where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        if os.environ.get("CI") == "true":
            pytest.fail(f"{name} is not installed, and CI must have it")
        pytest.skip(f"{name} is not installed")
