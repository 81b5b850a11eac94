"""The compiled search, if it was built."""

import importlib
from types import ModuleType

import pytest

from tests.support.needed import miss


@pytest.fixture(scope="session")
def search() -> ModuleType:
    """Return the extension module; without it the test is skipped, or fails under CI, which has a compiler."""
    try:
        return importlib.import_module("cadtof_cli.resolver.likelihood._search")
    except ImportError:
        miss("the search was not built: no C compiler when cadtof was installed")
