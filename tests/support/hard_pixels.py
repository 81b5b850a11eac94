"""Pairs of phasors on which arithmetic goes wrong first: degenerate, faint, huge, denormal, not finite, and plain random bits."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Pair = tuple[NDArray[np.complex128], NDArray[np.complex128]]

SPECIAL = np.array(
    [
        *(0.0, -0.0, 1.0, -1.0, 0.5, 3e-3, 1e-3, np.nan, -np.nan, np.inf, -np.inf, 5e-324, -5e-324, 2.2e-308),
        *(1e-160, 1e-154, 1e-140, 1e-70, 1e-60, 1e50, 1e62, 1e150, 1e154, 1e160, 1.7e308, -1.7e308),
    ]
)


def _rotor(phase: NDArray[np.float64]) -> NDArray[np.complex128]:
    return np.asarray(np.exp(1j * phase))


def _normal(rng: np.random.Generator, n: int) -> NDArray[np.complex128]:
    return np.asarray(rng.normal(size=n) + 1j * rng.normal(size=n))


def _complex(re: NDArray[np.float64], im: NDArray[np.float64]) -> NDArray[np.complex128]:
    both = np.empty(re.shape, np.complex128)
    both.real, both.imag = re, im
    return both


def close_paths(rng: np.random.Generator, n: int) -> Pair:
    """Two paths with b → 0 and x → y, down to the last digit of both."""
    a, b = rng.random(n), rng.random(n) * 10 ** rng.uniform(-18, 0, n)
    x = rng.uniform(0, 2 * np.pi, n)
    y = x + rng.uniform(-np.pi, np.pi, n) * 10 ** rng.uniform(-16, 0, n)
    return a * _rotor(x) + b * _rotor(y), a * _rotor(2 * x) + b * _rotor(2 * y)


def antipodal(rng: np.random.Generator, n: int) -> Pair:
    """Two paths half a turn apart, with p1 → 0."""
    a, x = rng.random(n), rng.uniform(0, 2 * np.pi, n)
    b = a * (1 + rng.uniform(-1, 1, n) * 10 ** rng.uniform(-17, 0, n))
    return (a - b) * _rotor(x), (a + b) * _rotor(2 * x)


def one_path_and_noise(rng: np.random.Generator, n: int) -> Pair:
    """One path, and deviations from it that are smaller or larger than noise."""
    a, x = rng.random(n), rng.uniform(0, 2 * np.pi, n)
    size = 10 ** rng.uniform(-17, -2, n)
    return a * _rotor(x) + size * _normal(rng, n), a * _rotor(2 * x) + size * _normal(rng, n)


def arbitrary(rng: np.random.Generator, n: int) -> Pair:
    """Any values of the size of phasors."""
    return _normal(rng, n), _normal(rng, n)


def faint(rng: np.random.Generator, n: int) -> Pair:
    """Values around the threshold of a signal."""
    first, second = (_normal(rng, n) * 10 ** rng.uniform(-6, -1, n) for _ in range(2))
    return first, second


def magnitudes(rng: np.random.Generator, n: int) -> Pair:
    """Values of any size that a float64 can have."""
    first, second = (_normal(rng, n) * 10.0 ** rng.uniform(-330, 307, n) for _ in range(2))
    return first, second


def special_values(rng: np.random.Generator, n: int) -> Pair:
    """Zeros of both signs, NaN, infinities, denormals, and values whose squares overflow or underflow."""
    first, second = (_complex(*SPECIAL[rng.integers(0, SPECIAL.size, (2, n))]) for _ in range(2))
    return first, second


def random_bits(rng: np.random.Generator, n: int) -> Pair:
    """Any 64 bits."""
    planes = rng.integers(0, 2**64, (4, n), dtype=np.uint64).view(np.float64)
    return _complex(planes[0], planes[1]), _complex(planes[2], planes[3])


HARD: dict[str, Callable[[np.random.Generator, int], Pair]] = {
    one.__name__: one
    for one in (
        close_paths,
        antipodal,
        one_path_and_noise,
        arbitrary,
        faint,
        magnitudes,
        special_values,
        random_bits,
    )
}
