"""Two paths of any phasors, by numpy or by the compiled kernel, for stages other than the solver."""

import numpy as np

from cadtof_cli.arrays import Complex
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel, contiguous, extension
from cadtof_cli.resolver.two_path.closed_form import TwoPaths, fundamental_frame, two_paths


def decomposed(p1: Complex, p2: Complex, /) -> TwoPaths:
    """Return the two paths of phasors, complex128 (n,) each; NaN in gives NaN out, without a warning.

    All kernels give the same bits.
    """
    kernel = chosen_kernel()
    if kernel == NUMPY:
        with np.errstate(all="ignore"):
            return two_paths(fundamental_frame(p1, p2))
    # as many as `DECOMPOSED_PLANES` in `_kernel_answers.h`
    planes = np.empty((9, p1.size))
    extension().decompose(kernel, *contiguous(p1, p2), planes)
    cos_mean, sin_mean, cos_half, sin_half, single = planes[2:7]
    return TwoPaths(planes[:2], cos_mean, sin_mean, cos_half, sin_half, single > 0.0, planes[7:])
