"""Which kernels can run here: the compiled one, a function for each kind of processor, and numpy. All give the same bits.

The extension module holds the compiled twins of `two_path/`, `response/` and `diffuse/`. It is built where a C compiler is at
hand when cadtof is installed. Where none is, numpy does the same operations.
"""

import os
from functools import cache, lru_cache
from types import ModuleType

from cadtof_cli.errors import SettingsError

NUMPY = "numpy"

CHOICE = "CADTOF_KERNEL"
"""Environment variable that names what runs, of `available_kernels`; without it the first of them does."""


@cache
def extension() -> ModuleType:
    """Return the extension module.

    Raises:
        ValueError: it was not built.
    """
    try:
        from cadtof_cli.resolver.two_path import _kernel
    except ImportError as error:
        raise ValueError("the compiled kernel was not built") from error
    return _kernel


def available_kernels() -> tuple[str, ...]:
    """Return the names of what can run here, the fastest first: instruction sets of the compiled kernel, then `numpy`."""
    try:
        return (*extension().levels(), NUMPY)
    except ValueError:
        return (NUMPY,)


@lru_cache(maxsize=1)
def chosen_kernel() -> str:
    """Return the name of what runs here.

    Raises:
        SettingsError: the environment asks for what this machine has not.
    """
    available, asked = available_kernels(), os.environ.get(CHOICE)
    if asked and asked not in available:
        raise SettingsError(f"{CHOICE}: found {asked!r}, expected one of {', '.join(available)}")
    return asked or available[0]


def numpy_note() -> str:
    """Return what a user should know where numpy runs: that it is slower than need be, and why it does."""
    why = f"{CHOICE} asks for it" if len(available_kernels()) > 1 else "cadtof was installed without a C compiler"
    return f"two paths are resolved by numpy, not by the compiled kernel: the same maps, but slower ({why})"
