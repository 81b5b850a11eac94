"""Signs of two true paths that a tail does not show, although any q_2 can be that of two paths.

A second path that comes by a mirror, a pane or the lens has the same share of the light all over the view, whatever its
delay. In a room, share and delay both depend on where a surface lies. Two true paths also predict the third harmonic. Two
paths that are fitted to the first two harmonics of a tail miss its third harmonic. If the tail is short for its noise,
each patch misses it by little. But all patches miss it to the same side, by as much as the delays of the MPI are spread.
"""

import math
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, median, quantiles
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.light import FrameTraits, PatchMeans
from cadtof_cli.resolver.diffuse.noise import median_of_noise, noise_covariance
from cadtof_cli.resolver.diffuse.tail import wrapped
from cadtof_cli.resolver.two_path.decomposition import decomposed

ONE_SHARE_PER_NS = 0.05
"""Threshold on the scatter of the logarithm of the second paths' share of the light, for every ns that their delays
scatter. Below it, all second paths have the same share. Rendered rooms have .09 and more, at any light. Cards with one
share have less than .04 if it is seen well enough."""

LARGEST_LOG_SHARE_SIGMA = 0.3
"""Largest standard deviation of that logarithm, by noise, at which a patch counts."""

LEAST_KNOWN = 64
"""Smallest number of patches that must count: fewer do not tell how their shares scatter."""

CERTAINTY = 3.0
"""Standard deviations between the estimate of a scatter and its bounds."""

QUARTILE_DISTANCE = 1.349
"""Distance between the quartiles of normal numbers, in standard deviations."""

VARIANCE_SIGMA = 2.33
"""Relative standard deviation of a variance that is estimated from the quartiles of n normal numbers, times √n."""

LARGEST_FURTHER_MISFIT = 1.35
"""Largest median χ² of the further harmonics about what two paths predict, over that of noise, at which there are two
paths. Cards have .8 to 1.1; rendered rooms have 2.2 and more."""

LEAST_MPI_SNR = 5.0
"""Smallest median of |q_2 − 1| over its noise at which further harmonics tell two paths from a tail."""

LEAST_SNR_DELAY_SQUARE = 10.0
"""Smallest product of that median and the squared median delay, in rad², at which they do. Two paths also predict the
further harmonics of a tail that is short for its noise, such as that of a corner. Below this limit, a tail comes nearer
the truth, whether there are two paths or not."""


LEAST_SPREAD = 0.008
"""Relative variance of the MPI's delays from which MPI is a tail, however well two paths predict the further harmonics.
It is 0 for two true paths, .002 if a reflector of 1.5 m sends the second path, .01 and more in corners that fill the
view, and .18 in rooms."""

SPREAD_CERTAINTY = 2.0
"""Standard deviations by which that variance must exceed `LEAST_SPREAD`."""

LARGEST_SPREAD = 0.1
"""Largest magnitude of that variance with which a patch counts; a larger value, positive or negative, is cut to it. A
patch that shows two surfaces may have any value."""


@dataclass(frozen=True, eq=False)
class PatchData:
    """The data of n patches: `ratios` q_h, (H − 1, n), and `relative` σ²/|p_h|² of every harmonic, (H, n).

    `harmonics` are the numbers of the harmonics. `tolerated`, (2, H − 1, n), are variances of ln|q_h| and arg q_h in
    addition to noise: what a model may get wrong.
    """

    ratios: Complex
    relative: Float
    harmonics: tuple[int, ...]
    tolerated: Float | None = None

    @classmethod
    def of(cls, means: PatchMeans, lit: Bool, frame: FrameTraits, /) -> "PatchData":
        """Return the data of the lit patches of a frame."""
        ratios = means.ratios[:, lit]
        relative = frame.variances[:, None] / (means.amplitude[lit] ** 2 * means.pixels[lit])
        with np.errstate(divide="ignore"):
            relative[1:] /= np.abs(ratios) ** 2
        return cls(ratios, relative, frame.settings.harmonics)

    def noise(self, first: int, second: int, /) -> Float:
        """Return the covariances between two ratios, given by their rows: of ln|q_h| and of arg q_h, (2, n)."""
        entries = noise_covariance(list(self.relative), harmonics=self.harmonics)
        count = len(self.ratios)
        noise = np.stack([entries[first, second], entries[count + first, count + second]])
        if first == second and self.tolerated is not None:
            noise += self.tolerated[:, first]
        return noise


@dataclass(frozen=True, eq=False)
class SecondPaths:
    """The weaker of the two paths of n patches.

    Attributes:
        log_share: logarithm of its amplitude over that of the stronger path, (n,).
        later_rad: how much later it comes than the stronger path, within half a turn; negative if it comes earlier, (n,).
        by_data: derivatives of both with respect to ln|q_2| and arg q_2, (2, 2, n).
        noise: variances of both by noise, (2, n).
    """

    log_share: Float
    later_rad: Float
    by_data: Float
    noise: Float

    @classmethod
    def of(cls, data: PatchData, /) -> "SecondPaths":
        """Return the second paths that explain q_2, (n,)."""
        ratio = data.ratios[0]
        paths = decomposed(np.ones_like(ratio), ratio)
        share = np.minimum(paths.a, paths.b) / np.maximum(paths.a, paths.b)
        half = np.arctan2(np.where(paths.a >= paths.b, -paths.sin_half, paths.sin_half), paths.cos_half)
        later = wrapped(2.0 * half)
        slopes = of_two_paths(share, later, 2)[1]
        slopes[:, 0] *= share
        by_data = _inverse(slopes)
        return cls(np.log(share), later, by_data, (by_data**2 * data.noise(0, 0)).sum(axis=1))

    @cached_property
    def known(self) -> Bool:
        """Which patches know their share well enough to tell how shares scatter, (n,); none if there are too few of them."""
        known: Bool = self.noise[0] < LARGEST_LOG_SHARE_SIGMA**2
        return known & (np.count_nonzero(known) >= LEAST_KNOWN)

    @cached_property
    def log_share_scatter(self) -> "Scatter":
        """Scatter of the logarithm of the share between the patches that know it."""
        return Scatter.of(self.log_share[self.known], self.noise[0, self.known])


@dataclass(frozen=True)
class Scatter:
    """Lower and upper bound of the variance of numbers in addition to that of their noise, with certainty. The lower one
    is below 0 if noise may explain all of it."""

    least: float
    most: float

    @classmethod
    def of(cls, values: Float, noise: Float, /) -> "Scatter":
        """Return the scatter of values, (n,), whose noise has the given variances, (n,)."""
        low, high = quantiles(values, (0.25, 0.75))
        variance, noise_variance = float((high - low) / QUARTILE_DISTANCE) ** 2, float(median(noise))
        margin = CERTAINTY * VARIANCE_SIGMA / float(np.sqrt(values.size))
        return cls(
            variance - (1.0 + margin) * noise_variance, max(variance - noise_variance, 0.0) + margin * noise_variance
        )


def two_path_lag(ratio: Complex, /) -> Float:
    """Return arg H_1 if there are two paths and the stronger is direct, from q_2 = p_2|p_1|/p_1²; same shape.

    This is by how much MPI turns arg p_1, in rad.
    """
    flat = ratio.ravel()
    paths = decomposed(np.ones_like(flat), flat)
    stronger = paths.a >= paths.b
    sin, cos = np.where(stronger, paths.sin_x, paths.sin_y), np.where(stronger, paths.cos_x, paths.cos_y)
    return np.asarray(-np.arctan2(sin, cos).reshape(ratio.shape))


def has_one_share(second: SecondPaths, /, *, rad_per_ns: float) -> bool:
    """Return whether second paths have the same share of the light at different delays."""
    if not second.known.any():
        return False
    delays = Scatter.of(second.later_rad[second.known], second.noise[1, second.known])
    return second.log_share_scatter.most * rad_per_ns**2 < ONE_SHARE_PER_NS**2 * delays.least


def further_harmonics_tell(second: SecondPaths, data: PatchData, /) -> bool:
    """Return whether further harmonics tell two paths from a tail: there are some, and MPI is strong and late enough."""
    if len(data.ratios) == 1:
        return False
    noise_1, noise_2 = data.relative[:2]
    snr = float(median(np.abs(data.ratios[0] - 1.0) / np.sqrt(2.5 * noise_1 + noise_2)))
    later_rad = second.later_rad[np.isfinite(second.later_rad)]
    return snr >= LEAST_MPI_SNR and later_rad.size > 0 and snr * float(median(later_rad)) ** 2 >= LEAST_SNR_DELAY_SQUARE


def predict_further_harmonics(second: SecondPaths, data: PatchData, /) -> bool:
    """Return whether second paths predict q_h of the further harmonics, apart from noise, and have one delay each."""
    if not float(median(further_chi_squared(second, data))) < LARGEST_FURTHER_MISFIT * median_of_noise(
        2 * len(data.ratios) - 2
    ):
        return False
    spread, sigma = delay_spread(second, data)
    return spread - SPREAD_CERTAINTY * sigma < LEAST_SPREAD


def delay_spread(second: SecondPaths, data: PatchData, /) -> tuple[float, float]:
    """Return the variance of the MPI's delays within a patch, over their square, and its standard deviation.

    Both come from what further harmonics show; (0, inf) if they show nothing. Delays that are spread by a variance of
    κθ² about θ make the MPI at the harmonic h smaller by the factor 1 − κ(hθ)²/2.
    """
    projected = weight = np.zeros(second.log_share.size)
    for row in range(1, len(data.ratios)):
        difference = _Difference.of(second, data, row)
        by_spread = _by_spread(second, data.harmonics[row + 1])
        by_spread -= np.einsum("ijn,jn->in", difference.by_data, _by_spread(second, 2))
        projected = projected + np.einsum("in,ijn,jn->n", by_spread, difference.precision, difference.residual)
        weight = weight + np.einsum("in,ijn,jn->n", by_spread, difference.precision, by_spread)
    seen = np.isfinite(projected) & np.isfinite(weight) & (weight > 0.0)
    if not seen.any():
        return 0.0, math.inf
    projected, weight = projected[seen], weight[seen]
    total = float(weight.sum())
    return float(
        (weight * np.clip(projected / weight, -LARGEST_SPREAD, LARGEST_SPREAD)).sum()
    ) / total, 1.0 / math.sqrt(total)


def further_chi_squared(second: SecondPaths, data: PatchData, /) -> Float:
    """Return χ², (n,), of the q_h of further harmonics, two numbers each, about what the second paths predict."""
    chi_squared = np.zeros(len(data.ratios[0]))
    for row in range(1, len(data.ratios)):
        difference = _Difference.of(second, data, row)
        chi_squared += np.einsum("in,ijn,jn->n", difference.residual, difference.precision, difference.residual)
    return chi_squared


@dataclass(frozen=True, eq=False)
class _Difference:
    """The difference of ln|q_h| and arg q_h of a further harmonic from what the second paths predict.

    `residual`, (2, n), is the difference and `precision`, (2, 2, n), the inverse of its covariance. `by_data`, (2, 2, n),
    are the derivatives of the prediction with respect to ln|q_2| and arg q_2.
    """

    residual: Float
    precision: Float
    by_data: Float

    @classmethod
    def of(cls, second: SecondPaths, data: PatchData, row: int, /) -> "_Difference":
        """Return the difference for the ratios in a row."""
        share = np.exp(second.log_share)
        expected, slopes = of_two_paths(share, second.later_rad, data.harmonics[row + 1])
        slopes[:, 0] *= share
        ratio = data.ratios[row]
        residual = np.stack([np.log(np.abs(ratio)) - expected[0], wrapped(np.angle(ratio) - expected[1])])
        by_data = np.einsum("ikn,kjn->ijn", slopes, second.by_data)
        shared = by_data * data.noise(row, 0)
        covariance = np.einsum("ikn,kn,jkn->ijn", by_data, data.noise(0, 0), by_data) - shared - shared.swapaxes(0, 1)
        covariance[(0, 1), (0, 1)] += data.noise(row, row)
        return cls(residual, _inverse(covariance), by_data)


def _by_spread(second: SecondPaths, h: int) -> Float:
    """Return the derivatives of ln|q_h| and arg q_h with respect to the relative variance of the delays, (2, n)."""
    first, further = (_logarithm_by_spread(second, k) for k in (1, h))
    return np.stack([further.real - first.real, further.imag - h * first.imag])


def _logarithm_by_spread(second: SecondPaths, h: int) -> Complex:
    """Return the derivative of ln H_h with respect to the relative variance of the delays, (n,)."""
    phasor = np.exp(second.log_share + 1j * h * second.later_rad)
    return np.asarray(-0.5 * (h * second.later_rad) ** 2 * phasor / (1.0 + phasor), np.complex128)


def of_two_paths(share: Float, later_rad: Float, h: int, /) -> tuple[Float, Float]:
    """Return ln|q_h| and arg q_h of two paths, (2, n), and their derivatives, (2, 2, n).

    The derivatives are with respect to the share and the delay of the second path.
    """
    values, slopes = np.zeros((2, share.size)), np.zeros((2, 2, share.size))
    for k, size_factor, phase_factor in ((1, -1.0, -float(h)), (h, 1.0, 1.0)):
        turn = k * later_rad
        cos, sin = np.cos(turn), np.sin(turn)
        re, im = 1.0 + share * cos, share * sin
        square = re * re + im * im
        # real and imaginary part of exp(ikθ)/(1 + share·exp(ikθ))
        along, across, by_delay = (cos + share) / square, sin / square, share * k
        values[0] += size_factor * 0.5 * np.log(square)
        values[1] += phase_factor * np.arctan2(im, re)
        slopes[0, 0] += size_factor * along
        slopes[1, 0] += phase_factor * across
        slopes[0, 1] -= size_factor * by_delay * across
        slopes[1, 1] += phase_factor * by_delay * along
    return values, slopes


def _inverse(matrices: Float) -> Float:
    """Return the inverses of matrices, (2, 2, n)."""
    (a, b), (c, d) = matrices
    inverse: Float = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return inverse
