"""The compiled search, where it was built."""

import importlib
from types import ModuleType

import pytest

from tests.support.needed import miss


@pytest.fixture(scope="session")
def search() -> ModuleType:
    """Return the extension module; where it was not built its tests are skipped, but fail under CI, which has a compiler."""
    try:
        return importlib.import_module("cadtof_cli.resolver.likelihood._search")
    except ImportError:
        miss("the search was not built: no C compiler when cadtof was installed")
