"""The compiled search, where it was built."""

import importlib
import os
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def search() -> ModuleType:
    """Return the extension module; where it was not built its tests are skipped, but fail under CI, which has a compiler."""
    try:
        return importlib.import_module("cadtof_cli.resolver.likelihood._search")
    except ImportError:
        if os.environ.get("CI") == "true":
            pytest.fail("the search was not built, and CI must have it")
        pytest.skip("the search was not built: no C compiler when cadtof was installed")
