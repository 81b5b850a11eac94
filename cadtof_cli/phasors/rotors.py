"""Unit complex numbers as pairs of real arrays, (cos, sin).

Numpy multiplies complex arrays with fused operations in some memory layouts and without in others; real arrays give the same
bits for any block of pixels.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from cadtof_cli.arrays import Float

Rotor: TypeAlias = tuple[Float, Float]
"""Real and imaginary part, of the same shape."""


def unit_rotor(re: Float, im: Float, /) -> tuple[Float, Rotor]:
    """Return modulus and direction of re + i·im; the direction of 0 is 1."""
    modulus = np.sqrt(re * re + im * im)
    scale = 1.0 / np.maximum(modulus, np.finfo(np.float64).tiny)
    return modulus, (re * scale + (modulus == 0.0), im * scale)


def product(a: Rotor, b: Rotor, /) -> Rotor:
    """Return a·b."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def powers(rotor: Rotor, exponents: Sequence[int], /) -> list[Rotor]:
    """Return rotor^h for rising exponents h ≥ 1, by repeated multiplication."""
    found: dict[int, Rotor] = {1: rotor}

    def power(h: int) -> Rotor:
        if h not in found:
            found[h] = product(power(h // 2), power(h - h // 2))
        return found[h]

    return [power(h) for h in exponents]
