"""What two true paths show and a tail does not, though any q_2 can be that of two paths.

A second path that comes by a mirror, a pane or the lens has the same share of the light all over the view, whatever its delay.
In a room, both follow from where a surface lies. And two paths foretell a third harmonic, which those of a tail miss.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.resolver.diffuse.light import PatchMeans
from cadtof_cli.resolver.diffuse.noise import noise_covariance
from cadtof_cli.resolver.diffuse.quantiles import median, quantiles
from cadtof_cli.resolver.diffuse.tail import wrapped
from cadtof_cli.resolver.two_path.decomposition import decomposed
from cadtof_cli.resolver.two_path.kernel import NUMPY

SAME_PER_NS = 0.05
"""Scatter of the logarithm of the second paths' share of light, for every ns that their delays scatter by, below which it is the
same share: rendered rooms have .09 and more, at any light; cards with one share less than .04, where it is seen well enough."""

WELL_KNOWN = 0.3
"""Largest standard deviation of that logarithm, by noise, in a patch that counts."""

LEAST_KNOWN = 64
"""Patches that must count: fewer do not tell how their shares scatter."""

CERTAINTY = 3.0
"""Standard deviations by which the scatter must be smaller."""

QUARTILES = 1.349
"""Distance of the quartiles of normal numbers, in standard deviations."""

UNSURE = 2.33
"""Relative standard deviation of the variance that the quartiles of n normal numbers tell, times √n."""

FORETOLD = 1.35
"""Median χ² of what further harmonics differ by from what two paths foretell, over that of noise, up to which there are two
paths: .8 to 1.1 on cards; 2.2 and more in rendered rooms."""

FORETOLD_SNR = 5.0
"""Median of |q_2 − 1| over its noise from which that tells two paths from a tail."""


@dataclass(frozen=True, eq=False)
class PatchData:
    """What n patches show: q_h, (H − 1, n), and σ²/|p_h|² of every harmonic, (H, n), so numbered."""

    ratios: Complex
    relative: Float
    harmonics: tuple[int, ...]

    @classmethod
    def of(cls, means: PatchMeans, lit: Bool, variances: Float, harmonics: tuple[int, ...], /) -> "PatchData":
        """Return those of the lit patches; `variances` are those of a channel of each harmonic."""
        ratios = means.ratios[:, lit]
        relative = variances[:, None] / (means.amplitude[lit] ** 2 * means.pixels[lit])
        with np.errstate(divide="ignore"):
            relative[1:] /= np.abs(ratios) ** 2
        return cls(ratios, relative, harmonics)

    def noise(self, first: int, second: int, /) -> Float:
        """Return the covariance of two ln|q_h|, and of their arg q_h, (2, n); which of the ratios they are is given."""
        entries = noise_covariance(list(self.relative), harmonics=self.harmonics)
        count = len(self.ratios)
        return np.stack([entries[first, second], entries[count + first, count + second]])


@dataclass(frozen=True, eq=False)
class SecondPaths:
    """The weaker paths of n patches: ln of their amplitude over the stronger ones', and how much later they come, rad, (n,) each.

    `slopes`, (2, 2, n), says how ln|q_2| and arg q_2 follow from the two.
    """

    strength: Float
    later_rad: Float
    slopes: Float

    @classmethod
    def of(cls, ratio: Complex, /, *, kernel: str = NUMPY) -> "SecondPaths":
        """Return those that q_2, (n,), is of; `kernel` is of `available_kernels`, all of which give the same bits."""
        paths = decomposed(np.ones_like(ratio), ratio, kernel=kernel)
        x, y = paths.phases()
        strength = -np.abs(np.log(paths.a / paths.b))
        later: Float = wrapped(np.where(paths.a >= paths.b, y - x, x - y))
        return cls(strength, later, _of_two_paths(strength, later, 2)[1])


def are_two_paths(data: PatchData, /, *, rad_per_ns: float, kernel: str = NUMPY) -> bool:
    """Return whether patches have two true paths each; ω of the fundamental is given in rad/ns."""
    with np.errstate(all="ignore"):
        # of one path alone, the other has no delay
        found = SecondPaths.of(data.ratios[0], kernel=kernel)
        return has_one_share(found, data, rad_per_ns=rad_per_ns) or foretells(found, data)


def has_one_share(found: SecondPaths, data: PatchData, /, *, rad_per_ns: float) -> bool:
    """Return whether second paths have the same share of the light at different delays."""
    by_data = _inverse(found.slopes)
    strength_noise, delay_noise = (by_data**2 * data.noise(0, 0)).sum(axis=1)
    known = strength_noise < WELL_KNOWN**2
    count = int(known.sum())
    if count < LEAST_KNOWN:
        return False
    strength, delay = (_variance(values[known]) for values in (found.strength, found.later_rad))
    by_noise, delay_by_noise = (float(median(values[known])) for values in (strength_noise, delay_noise))
    unsure = CERTAINTY * UNSURE / float(np.sqrt(count))
    most = max(strength - by_noise, 0.0) + unsure * by_noise
    least = delay - (1.0 + unsure) * delay_by_noise
    return most * rad_per_ns**2 < SAME_PER_NS**2 * least


def foretells(found: SecondPaths, data: PatchData, /) -> bool:
    """Return whether the second paths say, but for noise, what q_h of further harmonics is, where MPI is well seen."""
    first, second = data.relative[:2]
    seen = np.abs(data.ratios[0] - 1.0) / np.sqrt(2.5 * first + second)
    further = len(data.ratios) - 1
    if not further or float(median(seen)) < FORETOLD_SNR:
        return False
    by_data = _inverse(found.slopes)
    chi_squared = sum(_missed(found, by_data, data, row) for row in range(1, further + 1))
    return float(median(np.asarray(chi_squared))) < FORETOLD * median_of_noise(2 * further)


def median_of_noise(numbers: int, /) -> float:
    """Return the median χ² of so many independent numbers, as Wilson and Hilferty have it."""
    return numbers * (1.0 - 2.0 / (9.0 * numbers)) ** 3


def _missed(found: SecondPaths, by_data: Float, data: PatchData, row: int) -> Float:
    """Return χ², (n,), of what the ratios in a row differ by from what the second paths make of them."""
    expected, slopes = _of_two_paths(found.strength, found.later_rad, data.harmonics[row + 1])
    ratio = data.ratios[row]
    off = np.stack([np.log(np.abs(ratio)) - expected[0], wrapped(np.angle(ratio) - expected[1])])
    follows = np.einsum("ikn,kjn->ijn", slopes, by_data)
    shared = follows * data.noise(row, 0)
    covariance = np.einsum("ikn,kn,jkn->ijn", follows, data.noise(0, 0), follows) - shared - shared.swapaxes(0, 1)
    covariance[(0, 1), (0, 1)] += data.noise(row, row)
    missed: Float = np.einsum("in,ijn,jn->n", off, _inverse(covariance), off)
    return missed


def _of_two_paths(strength: Float, later_rad: Float, h: int) -> tuple[Float, Float]:
    """Return ln|q_h| and arg q_h of two paths, (2, n), and their slopes along both of these, (2, 2, n)."""
    share = np.exp(strength)
    first, further = (share * np.exp(1j * k * later_rad) for k in (1, h))
    slopes = np.empty((2, 2, strength.size))
    for column, (turn, more) in enumerate(((1.0, 1.0), (1j, 1j * h))):
        of_first, of_further = turn * first / (1.0 + first), more * further / (1.0 + further)
        slopes[0, column], slopes[1, column] = of_further.real - of_first.real, of_further.imag - h * of_first.imag
    one, other = np.log(1.0 + first), np.log(1.0 + further)
    return np.stack([other.real - one.real, other.imag - h * one.imag]), slopes


def _inverse(matrices: Float) -> Float:
    """Return the inverses of matrices, (2, 2, n)."""
    (a, b), (c, d) = matrices
    inverse: Float = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return inverse


def _variance(values: Float) -> float:
    """Return the variance that the quartiles of normal numbers tell."""
    low, high = quantiles(values, (0.25, 0.75))
    return float((high - low) / QUARTILES) ** 2
