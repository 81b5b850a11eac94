"""The front of the compiled twin of what `radiosity` works out for every pair of surfaces, `_radiosity.h`."""

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float32
from cadtof_cli.resolver.two_path.kernel import extension

Complex64 = NDArray[np.complex64]


def compiled_form_factors(
    over: Float32, facing: Float32, square: Float32, area: Float32, /, *, rad_per_m: float, kernel: str
) -> tuple[Float32, Float32]:
    """Return form factors and phases, (onto, sources) each, with the bits that `radiosity._form_factors` gives them.

    Args:
        over: how far the sources lie over the planes of those that are lit, (onto, sources) as all of these; taken over.
        facing: how far those lie over the planes of the sources.
        square: squared distances; taken over.
        area: of the sources, (sources,).
        rad_per_m: phase of a way.
        kernel: of `available_kernels`, but `numpy`.
    """
    extension().form_factors(kernel, rad_per_m, facing, area, over, square)
    return over, square


def compiled_kernel(
    form: Float32, albedo: Float32, cos: Float32, sin: Float32, /, *, kernel: str
) -> tuple[Complex64, Complex64]:
    """Return what `radiosity._kernel` does, with the same bits, from form factors and the rotors of the way."""
    matrix, turn = np.empty(form.shape, np.complex64), np.empty(form.shape, np.complex64)
    extension().light_kernel(kernel, form, albedo, cos, sin, matrix, turn)
    return matrix, turn
