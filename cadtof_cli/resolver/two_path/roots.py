"""Inverse square roots: the same bits from numpy here and from the kernel in C, on any machine, and faster than the processor's.

A processor rounds divisions and square roots correctly, which takes it ten times as long as products and sums, and those it does
of many pixels at a time. `_kernel_paths.h` holds the same operations in the same order.
"""

import numpy as np

from cadtof_cli.arrays import Float

START = np.uint64(0x5FE6EB50C7B537A9)
"""Less half of a number's bits, these are the bits of its inverse root within 3.5 %: the exponent is half, and negative."""

CUBIC = (1.876598, 1.2521, 0.375502)
"""k of y ← y·(k0 − q·(k1 − q·k2)) with q = x·y²: the cubic that leaves the least of any 3.5 %, which is 2.7e-5."""

LEAST = float(np.finfo(np.float64).tiny)
"""The least normal number."""


def rough_inverse_root(x: Float, /) -> Float:
    """Return 1/√x of float64 (n,) within 2.7e-5 of it; see `inverse_root`."""
    y = (START - (x.view(np.uint64) >> np.uint64(1))).view(np.float64)
    square = x * y * y
    return y * (CUBIC[0] - square * (CUBIC[1] - square * CUBIC[2]))


def inverse_root(x: Float, /) -> Float:
    """Return 1/√x of float64 (n,) within 3e-16 of it, where x is a normal number; infinity and NaN give NaN.

    The last step is y ← y·(1 − r)^(−1/2) with r = 1 − x·y², to the third power of r. Below `LEAST` it stays finite, less than
    1e155, so that x·(1/√x) is 0 where x is, and next to it, below 1e-153, where x is less than `LEAST`.
    """
    y = rough_inverse_root(x)
    rest = 1.0 - x * y * y
    return y + y * rest * (0.5 + rest * (0.375 + rest * 0.3125))


def inverse_root_or_none(x: Float, /) -> Float:
    """Return 1/√x of float64 (n,) as `inverse_root` does, but 0 where x is below `LEAST`: what has no length has no direction."""
    return np.where(x < LEAST, 0.0, inverse_root(x))
