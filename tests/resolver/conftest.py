"""The compiled kernel, where it was built."""

import importlib
from types import ModuleType

import pytest

from tests.support.needed import miss


@pytest.fixture(scope="session")
def compiled() -> ModuleType:
    """Return the extension module; where it was not built its tests are skipped, but fail under CI, which has a compiler."""
    try:
        return importlib.import_module("cadtof_cli.resolver.two_path._kernel")
    except ImportError:
        miss("the kernel was not built: no C compiler when cadtof was installed")
