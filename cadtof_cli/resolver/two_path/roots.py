"""Inverse square roots, faster than the processor's; numpy here and the kernel in C give the same bits on any machine.

A processor rounds divisions and square roots correctly, and this takes ten times as long as a product or a sum.
Products and sums also run on many pixels at a time. `_kernel_paths.h` has the same operations in the same order.
"""

import numpy as np

from cadtof_cli.arrays import Float

START = np.uint64(0x5FE6EB50C7B537A9)
"""START minus half of the bits of x gives the bits of 1/√x within 3.5 %, because the exponent is halved and negated."""

CUBIC = (1.876598, 1.2521, 0.375502)
"""k0, k1, k2 of y ← y·(k0 − q·(k1 − q·k2)) with q = x·y². Over all errors up to 3.5 % of the start, this cubic has the
smallest largest error, 2.7e-5."""

LEAST = float(np.finfo(np.float64).tiny)
"""The smallest normal number."""


def rough_inverse_root(x: Float, /) -> Float:
    """Return 1/√x of float64 (n,) with a relative error of 2.7e-5; see `inverse_root`."""
    y = (START - (x.view(np.uint64) >> np.uint64(1))).view(np.float64)
    square = x * y * y
    return y * (CUBIC[0] - square * (CUBIC[1] - square * CUBIC[2]))


def inverse_root(x: Float, /) -> Float:
    """Return 1/√x of float64 (n,) with a relative error of 3e-16 for normal numbers x; infinity and NaN give NaN.

    The last step is y ← y·(1 − r)^(−1/2) with r = 1 − x·y², expanded to the third power of r. If x is below `LEAST`,
    the result is finite and less than 1e155. So x·(1/√x) is 0 if x is 0, and below 1e-153 if x is below `LEAST`.
    """
    y = rough_inverse_root(x)
    rest = 1.0 - x * y * y
    return y + y * rest * (0.5 + rest * (0.375 + rest * 0.3125))


def inverse_root_or_none(x: Float, /) -> Float:
    """Return 1/√x of float64 (n,) as `inverse_root` does, but 0 if x is below `LEAST`, because 0 has no direction."""
    return np.where(x < LEAST, 0.0, inverse_root(x))
