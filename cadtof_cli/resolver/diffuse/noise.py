"""Noise of the data ln|p_h/p_1| and arg p_h − h·arg p_1, which all contain the noise of p_1, and of ln|p_1| and arg p_1.

Also the χ² that noise leaves.
"""

from collections.abc import Mapping

from cadtof_cli.arrays import Values

Entry = tuple[int, int]
"""Row and column of a covariance, row ≥ column."""


def noise_covariance(relative: list[Values], /, *, harmonics: tuple[int, ...]) -> Mapping[Entry, Values]:
    """Return the entries that are not 0 of the lower triangle, in the order of `tail.free_of_direct`.

    Args:
        relative: σ²/|p_h|² of every harmonic: the variance of ln|p_h| and of arg p_h.
        harmonics: numbers of the harmonics.
    """
    first, count = relative[0], len(harmonics) - 1
    size, phase = 2 * count, 2 * count + 1
    covariance: dict[Entry, Values] = {(size, size): first, (phase, phase): first}
    for i in range(count):
        h = harmonics[i + 1]
        for j in range(i + 1):
            covariance[i, j] = first
            covariance[count + i, count + j] = first * (h * harmonics[j + 1])
        covariance[i, i] = first + relative[i + 1]
        covariance[count + i, count + i] = first * (h * h) + relative[i + 1]
        covariance[size, i] = -first
        covariance[phase, count + i] = first * -h
    return covariance


def median_of_noise(numbers: int, /) -> float:
    """Return the median χ² of so many independent normal numbers, by the approximation of Wilson and Hilferty."""
    return numbers * (1.0 - 2.0 / (9.0 * numbers)) ** 3
