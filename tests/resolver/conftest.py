"""The extension modules, if they were built."""

import importlib
from types import ModuleType

import pytest

from tests.support.needed import miss


def _extension(name: str) -> ModuleType:
    """Return an extension module; without it the test is skipped, or fails under CI, which has a compiler."""
    try:
        return importlib.import_module(f"cadtof_cli.resolver.{name}")
    except ImportError:
        miss(f"{name} was not built: no C compiler when cadtof was installed")


@pytest.fixture(scope="session")
def compiled() -> ModuleType:
    return _extension("two_path._kernel")


@pytest.fixture(scope="session")
def search() -> ModuleType:
    return _extension("likelihood._likelihood")
