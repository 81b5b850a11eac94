"""Which kernels can run on this machine: numpy, and the compiled kernel, which holds one version per instruction set.

All kernels give the same bits. The extension module holds the compiled twins of `two_path/`, `response/` and
`diffuse/`. It is built when cadtof is installed, if a C compiler is available. Without it, numpy does the same
operations.
"""

import os
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.errors import SettingsError

NUMPY = "numpy"

MOST_HARMONICS = 8
"""Largest number of harmonics for which the compiled twins of `diffuse/` have room; numpy has no limit."""

CHOICE = "CADTOF_KERNEL"
"""Environment variable: the name of the kernel to run, one of `available_kernels`. Not set: the first of them runs."""


@cache
def extension() -> ModuleType:
    """Return the extension module.

    Raises:
        ValueError: it was not built, or cannot be loaded.
    """
    try:
        import cadtof_cli.resolver.two_path._kernel as kernel
    except ModuleNotFoundError as error:
        raise ValueError("cadtof was installed without a C compiler, or without Python's headers") from error
    except ImportError as error:
        raise ValueError(f"it cannot be loaded: {error}") from error
    return kernel


def available_kernels() -> tuple[str, ...]:
    """Return the names of the kernels that can run here, the fastest first: compiled instruction sets, then `numpy`."""
    try:
        return (*extension().levels(), NUMPY)
    except ValueError:
        return (NUMPY,)


@cache
def chosen_kernel() -> str:
    """Return the name of the kernel that runs in this process.

    Raises:
        SettingsError: the environment variable names a kernel that cannot run on this machine.
    """
    available, asked = available_kernels(), os.environ.get(CHOICE)
    if asked and asked not in available:
        raise SettingsError(f"{CHOICE}: found {asked!r}, expected one of {', '.join(available)}")
    return asked or available[0]


def is_compiled_for(harmonics: int, /) -> bool:
    """Return whether the chosen kernel has compiled twins of `diffuse/` for so many harmonics: numpy has none."""
    return chosen_kernel() != NUMPY and harmonics <= MOST_HARMONICS


def contiguous(*arrays: NDArray[Any] | None) -> list[NDArray[Any] | None]:
    """Return arrays as the extension takes them: contiguous in memory, and None for None."""
    return [None if array is None else np.ascontiguousarray(array) for array in arrays]


def numpy_note() -> str:
    """Return the note for a user when numpy runs: it is slower than the compiled kernel, and the reason why it runs."""
    why = f"{CHOICE} asks for it"
    try:
        extension()
    except ValueError as error:
        why = str(error)
    return f"two paths are resolved by numpy, not by the compiled kernel: the same maps, but slower ({why})"
