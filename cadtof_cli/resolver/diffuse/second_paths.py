"""What two true paths show and a tail does not, though any q_2 can be that of two paths.

A second path that comes by a mirror, a pane or the lens has the same share of the light all over the view, whatever its delay.
In a room, both follow from where a surface lies. And two true paths foretell a third harmonic; two paths that explain
the first two harmonics of a tail miss its third. By how little, where the tail is short for its noise, all patches tell together:
they miss it to the same side, by as much as the delays of the MPI are spread.
"""

import math
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.quantiles import median, quantiles
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.light import PatchMeans
from cadtof_cli.resolver.diffuse.noise import noise_covariance
from cadtof_cli.resolver.diffuse.tail import wrapped
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.two_path.decomposition import decomposed

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
"""Median of |q_2 − 1| over its noise from which that tells two paths from a tail, …"""

FORETOLD_DELAY = 10.0
"""… where that median times the square of the delay in rad is as large, too. What is short for its noise, as a corner's tail,
two paths foretell as well. Up to there a tail comes nearer the truth, be there two paths or not."""


SPREAD = 0.008
"""Relative variance of the MPI's delays from which on MPI is a tail however well two paths foretell the rest: 0 of two true
paths, .002 where a reflector of 1.5 m sends the second one, .01 and more in corners that fill the view, .18 in rooms."""

SPREAD_CERTAINTY = 2.0
"""Standard deviations by which it must be larger."""

WIDEST = 0.1
"""Largest such variance of a patch, up or down, that counts: of what patches see that show two surfaces, it may be any."""


@dataclass(frozen=True, eq=False)
class PatchData:
    """What n patches show: q_h, (H − 1, n), and σ²/|p_h|² of every harmonic, (H, n), so numbered.

    `tolerated`, (2, H − 1, n), are variances of ln|q_h| and arg q_h besides noise: what a model may get wrong.
    """

    ratios: Complex
    relative: Float
    harmonics: tuple[int, ...]
    tolerated: Float | None = None

    @classmethod
    def of(cls, means: PatchMeans, lit: Bool, variances: Float, harmonics: tuple[int, ...], /) -> "PatchData":
        """Return the data of the lit patches; `variances` are those of a channel of each harmonic."""
        ratios = means.ratios[:, lit]
        relative = variances[:, None] / (means.amplitude[lit] ** 2 * means.pixels[lit])
        with np.errstate(divide="ignore"):
            relative[1:] /= np.abs(ratios) ** 2
        return cls(ratios, relative, harmonics)

    def noise(self, first: int, second: int, /) -> Float:
        """Return the covariance of ln|q_h| of two ratios, by their rows, and that of their arg q_h, (2, n)."""
        entries = noise_covariance(list(self.relative), harmonics=self.harmonics)
        count = len(self.ratios)
        noise = np.stack([entries[first, second], entries[count + first, count + second]])
        if first == second and self.tolerated is not None:
            noise += self.tolerated[:, first]
        return noise


@dataclass(frozen=True, eq=False)
class SecondPaths:
    """The weaker paths of n patches: ln of their amplitude over the stronger ones', and how much later they come, rad, (n,) each.

    `by_data`, (2, 2, n), says how both follow from ln|q_2| and arg q_2; `noise`, (2, n), are their variances by noise.
    """

    strength: Float
    later_rad: Float
    by_data: Float
    noise: Float

    @classmethod
    def of(cls, data: PatchData, /, *, kernel: str = NUMPY) -> "SecondPaths":
        """Return the second paths that explain q_2, (n,); `kernel` is of `available_kernels`, all of which give the same bits."""
        ratio = data.ratios[0]
        paths = decomposed(np.ones_like(ratio), ratio, kernel=kernel)
        share = np.minimum(paths.a, paths.b) / np.maximum(paths.a, paths.b)
        half = np.arctan2(np.where(paths.a >= paths.b, -paths.sin_half, paths.sin_half), paths.cos_half)
        later = wrapped(2.0 * half)
        slopes = of_two_paths(share, later, 2)[1]
        slopes[:, 0] *= share
        by_data = _inverse(slopes)
        return cls(np.log(share), later, by_data, (by_data**2 * data.noise(0, 0)).sum(axis=1))

    @cached_property
    def known(self) -> Bool:
        """Patches whose share is known well enough to tell how shares scatter, (n,); none where they are too few for that."""
        known: Bool = self.noise[0] < WELL_KNOWN**2
        return known & (np.count_nonzero(known) >= LEAST_KNOWN)

    @cached_property
    def strength_scatter(self) -> "Scatter":
        """How ln of the share scatters between the patches where it is known."""
        return Scatter.of(self.strength[self.known], self.noise[0, self.known])

    @cached_property
    def delay_scatter(self) -> "Scatter":
        """How delays scatter between the same patches, in rad."""
        return Scatter.of(self.later_rad[self.known], self.noise[1, self.known])


@dataclass(frozen=True)
class Scatter:
    """The variance of numbers besides that of their noise: at the least and at the most, with certainty."""

    least: float
    most: float

    @classmethod
    def of(cls, values: Float, noise: Float, /) -> "Scatter":
        """Return the scatter of values, (n,), whose noise has the given variances, (n,)."""
        low, high = quantiles(values, (0.25, 0.75))
        variance, by_noise = float((high - low) / QUARTILES) ** 2, float(median(noise))
        unsure = CERTAINTY * UNSURE / float(np.sqrt(values.size))
        return cls(max(variance - (1.0 + unsure) * by_noise, 0.0), max(variance - by_noise, 0.0) + unsure * by_noise)


def two_path_lag(ratio: Complex, /, *, kernel: str = NUMPY) -> Float:
    """Return by how much MPI turns arg p_1 if there are two paths, the stronger direct, from q_2 = p_2|p_1|/p_1²."""
    flat = ratio.ravel()
    paths = decomposed(np.ones_like(flat), flat, kernel=kernel)
    sin_half = np.where(paths.a >= paths.b, paths.sin_half, -paths.sin_half)
    lag: Float = -np.arctan2(
        paths.sin_mean * paths.cos_half + paths.cos_mean * sin_half,
        paths.cos_mean * paths.cos_half - paths.sin_mean * sin_half,
    )
    return lag.reshape(ratio.shape)


def has_one_share(found: SecondPaths, /, *, rad_per_ns: float) -> bool:
    """Return whether second paths have the same share of the light at different delays."""
    if not found.known.any():
        return False
    return found.strength_scatter.most * rad_per_ns**2 < SAME_PER_NS**2 * found.delay_scatter.least


def foretelling(found: SecondPaths, data: PatchData, /) -> bool:
    """Return whether there are further harmonics, and so much and so late MPI is seen that they tell two paths from a tail."""
    if len(data.ratios) == 1:
        return False
    first, second = data.relative[:2]
    seen = float(median(np.abs(data.ratios[0] - 1.0) / np.sqrt(2.5 * first + second)))
    later_rad = found.later_rad[np.isfinite(found.later_rad)]
    return seen >= FORETOLD_SNR and later_rad.size > 0 and seen * float(median(later_rad)) ** 2 >= FORETOLD_DELAY


def foretells(found: SecondPaths, data: PatchData, /) -> bool:
    """Return whether the second paths say, but for noise, what q_h of further harmonics is, and have one delay each."""
    if not float(median(missed(found, data))) < FORETOLD * median_of_noise(2 * len(data.ratios) - 2):
        return False
    spread, sigma = delay_spread(found, data)
    return spread - SPREAD_CERTAINTY * sigma < SPREAD


def delay_spread(found: SecondPaths, data: PatchData, /) -> tuple[float, float]:
    """Return the variance of the MPI's delays within a patch, over their square, that further harmonics show, and its standard
    deviation; (0, inf) where they show nothing.

    Delays that are spread by a variance of κθ² about θ make MPI at the harmonic h smaller by 1 − κ(hθ)²/2.
    """
    shown = weight = np.zeros(found.strength.size)
    for row in range(1, len(data.ratios)):
        differs = _Difference.of(found, data, row)
        by_spread = _by_spread(found, data.harmonics[row + 1])
        by_spread -= np.einsum("ijn,jn->in", differs.follows, _by_spread(found, 2))
        shown = shown + np.einsum("in,ijn,jn->n", by_spread, differs.precision, differs.off)
        weight = weight + np.einsum("in,ijn,jn->n", by_spread, differs.precision, by_spread)
    seen = np.isfinite(shown) & np.isfinite(weight) & (weight > 0.0)
    if not seen.any():
        return 0.0, math.inf
    shown, weight = shown[seen], weight[seen]
    total = float(weight.sum())
    return float((weight * np.clip(shown / weight, -WIDEST, WIDEST)).sum()) / total, 1.0 / math.sqrt(total)


def missed(found: SecondPaths, data: PatchData, /) -> Float:
    """Return χ², (n,), of what q_h of further harmonics, two numbers each, differ by from what the second paths make of them."""
    chi_squared = np.zeros(len(data.ratios[0]))
    for row in range(1, len(data.ratios)):
        differs = _Difference.of(found, data, row)
        chi_squared += np.einsum("in,ijn,jn->n", differs.off, differs.precision, differs.off)
    return chi_squared


def median_of_noise(numbers: int, /) -> float:
    """Return the median χ² of so many independent numbers, as Wilson and Hilferty have it."""
    return numbers * (1.0 - 2.0 / (9.0 * numbers)) ** 3


@dataclass(frozen=True, eq=False)
class _Difference:
    """What ln|q_h| and arg q_h of a further harmonic differ by from what second paths make of them: `off`, (2, n), the inverse
    of its covariance, `precision`, (2, 2, n), and how what they make of them follows from ln|q_2| and arg q_2, (2, 2, n).
    """

    off: Float
    precision: Float
    follows: Float

    @classmethod
    def of(cls, found: SecondPaths, data: PatchData, row: int, /) -> "_Difference":
        """Return that of the ratios in a row."""
        share = np.exp(found.strength)
        expected, slopes = of_two_paths(share, found.later_rad, data.harmonics[row + 1])
        slopes[:, 0] *= share
        ratio = data.ratios[row]
        off = np.stack([np.log(np.abs(ratio)) - expected[0], wrapped(np.angle(ratio) - expected[1])])
        follows = np.einsum("ikn,kjn->ijn", slopes, found.by_data)
        shared = follows * data.noise(row, 0)
        covariance = np.einsum("ikn,kn,jkn->ijn", follows, data.noise(0, 0), follows) - shared - shared.swapaxes(0, 1)
        covariance[(0, 1), (0, 1)] += data.noise(row, row)
        return cls(off, _inverse(covariance), follows)


def _by_spread(found: SecondPaths, h: int) -> Float:
    """Return by how much ln|q_h| and arg q_h grow, (2, n), per unit of the delays' relative variance."""
    first, further = (_logarithm_by_spread(found, k) for k in (1, h))
    return np.stack([further.real - first.real, further.imag - h * first.imag])


def _logarithm_by_spread(found: SecondPaths, h: int) -> Complex:
    """Return by how much ln H_h grows, (n,), per unit of the delays' relative variance."""
    second = np.exp(found.strength + 1j * h * found.later_rad)
    return np.asarray(-0.5 * (h * found.later_rad) ** 2 * second / (1.0 + second), np.complex128)


def of_two_paths(share: Float, later_rad: Float, h: int, /) -> tuple[Float, Float]:
    """Return ln|q_h| and arg q_h of two paths, (2, n), and their slopes along the second's share and delay, (2, 2, n)."""
    found, slopes = np.zeros((2, share.size)), np.zeros((2, 2, share.size))
    for k, of_size, of_phase in ((1, -1.0, -float(h)), (h, 1.0, 1.0)):
        turn = k * later_rad
        cos, sin = np.cos(turn), np.sin(turn)
        re, im = 1.0 + share * cos, share * sin
        square = re * re + im * im
        # exp(ikθ) over 1 + share·exp(ikθ)
        along, across, by_delay = (cos + share) / square, sin / square, share * k
        found[0] += of_size * 0.5 * np.log(square)
        found[1] += of_phase * np.arctan2(im, re)
        slopes[0, 0] += of_size * along
        slopes[1, 0] += of_phase * across
        slopes[0, 1] -= of_size * by_delay * across
        slopes[1, 1] += of_phase * by_delay * along
    return found, slopes


def _inverse(matrices: Float) -> Float:
    """Return the inverses of matrices, (2, 2, n)."""
    (a, b), (c, d) = matrices
    inverse: Float = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return inverse
