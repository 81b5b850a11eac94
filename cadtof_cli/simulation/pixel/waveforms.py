"""Fourier series of the voltages that a pixel samples, and of their products, for means and covariances."""

import math
from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.capture.metadata import Waveform

LARGEST_ORDER = 4096
"""Last order of the series of a triangle if no pulse width ends it earlier; the terms beyond add up to less than 1e-4."""

_NEGLIGIBLE_EXPONENT = 8.9
"""exp(−8.9²/2) is below the rounding of 1.0, so orders k with k·ω·s above 8.9 contribute nothing."""

Real = TypeVar("Real", Float, Float32)

Series = Iterator[tuple[int, complex]]
"""Pairs (k, coefficient) of a function of the phase. The term is coefficient · m_k, and coefficient · conj(m_|k|) for k < 0."""


def highest_order(harmonics: tuple[int, ...], waveform: Waveform, spread_rad: float) -> int:
    """Return the highest moment order k that means and covariances of these harmonics depend on.

    `spread_rad` is the standard deviation of the arrival times as a phase of the fundamental. Orders that this spread reduces to
    less than rounding errors are left out.
    """
    if waveform == "sine":
        return 2 * max(harmonics)
    needed = _NEGLIGIBLE_EXPONENT / spread_rad if spread_rad > 0 else math.inf
    return max(2 * max(harmonics), math.ceil(min(needed, LARGEST_ORDER)))


def phasor_series(waveform: Waveform, largest: int) -> Series:
    """Yield the series of SC1 + i·SC2 in units of A.

    It is exp(iθ) for a sine, and (8/π²) (exp(iθ) + exp(−3iθ)/9 + exp(5iθ)/25 + exp(−7iθ)/49 + …) for a triangle.
    """
    yield 1, 1.0 if waveform == "sine" else 8.0 / math.pi**2
    if waveform == "triangle":
        for n in range(3, largest + 1, 2):
            yield (n if n % 4 == 1 else -n), 8.0 / (math.pi * n) ** 2


def square_series(waveform: Waveform, largest: int) -> Series:
    """Yield the series of SC1² without its mean over a period: coefficients of cos(2jθ), with orders 2j.

    In the series of SC2², each coefficient has the factor (−1)^j. cos² θ = 1/2 + cos(2θ)/2. The square of a triangle is
    1/3 + (4/π²) Σ_j cos(2jθ)/j².
    """
    if waveform == "sine":
        yield 2, 0.5
        return
    for j in range(1, largest // 2 + 1):
        yield 2 * j, 4.0 / (math.pi * j) ** 2


def product_series(waveform: Waveform, largest: int) -> Series:
    """Yield the series of SC1·SC2: coefficients of sin(2jθ), with orders 2j.

    cos θ sin θ = sin(2θ)/2. For triangles it is (8/π³) Σ_{odd j} sin(2jθ)/j³.
    """
    if waveform == "sine":
        yield 2, 0.5
        return
    for j in range(1, largest // 2 + 1, 2):
        yield 2 * j, 8.0 / (math.pi * j) ** 3


def mean_square(waveform: Waveform) -> float:
    """Return the mean of SC1² over a period, in units of A²."""
    return 1.0 / 2.0 if waveform == "sine" else 1.0 / 3.0


def triangle(phases_rad: Real, /) -> Real:
    """Return the triangle wave with the zeros and peaks of a cosine at the given phases; the array of phases is overwritten."""
    turns = np.multiply(phases_rad, 2.0 / math.pi, out=phases_rad)
    np.remainder(turns, 4.0, out=turns)
    np.subtract(turns, 2.0, out=turns)
    np.abs(turns, out=turns)
    return np.subtract(turns, 1.0, out=turns)


def sampled_pair(waveform: Waveform, phases_rad: Real, /) -> tuple[Real, Real]:
    """Return the samples of SC1 and SC2 in units of A at phases of the harmonic, (n,); the array of phases is overwritten."""
    if waveform == "sine":
        return np.cos(phases_rad), np.sin(phases_rad, out=phases_rad)
    first = triangle(phases_rad.copy())
    return first, triangle(np.add(phases_rad, 1.5 * math.pi, out=phases_rad))
