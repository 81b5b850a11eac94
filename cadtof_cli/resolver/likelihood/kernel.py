"""The extension module with the compiled twins of this folder and of paper/, and what it has room for."""

from types import ModuleType

from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel

WHITE, WEIGHTED, RESPONSE = range(3)
"""Kinds of problems, numbered as in `enum kind` of `_levenberg_marquardt.h`."""

MOST_PATHS, MOST_ROWS, MOST_HARMONIC = 4, 8, 16
"""Largest sizes that the compiled search has room for; numpy solves larger problems."""


def compiled_search(harmonics: tuple[int, ...], /, *, paths: int) -> ModuleType | None:
    """Return the extension module, or None if numpy must do the work.

    Numpy must if it is the chosen kernel, or if the module has no room for these paths and harmonics.
    """
    if chosen_kernel() == NUMPY or not 0 < paths <= MOST_PATHS:
        return None
    if not (0 < len(harmonics) <= MOST_ROWS and max(harmonics) <= MOST_HARMONIC):
        return None
    try:
        from cadtof_cli.resolver.likelihood import _likelihood
    except ImportError:
        return None
    return _likelihood
