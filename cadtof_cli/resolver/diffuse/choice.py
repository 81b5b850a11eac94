"""The choice of the model for a frame: a tail if there is MPI and no sign that it comes by separate paths.

For a tail that decays, the magnitude |H_2|/|H_1| of q_2 is below 1, and its phase arg H_2 − 2·arg H_1 is at most 0. Two
paths can exceed either limit: a weak first return before a strong one does, and so does a strong second return 12 to 28
ns late (T1 = 40 ns). Two paths that exceed neither limit are found from all patches together.
"""

import math
from typing import Literal

import numpy as np

from cadtof_cli.arrays import Bool, Float, median, quantiles
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.light import FrameTraits, PatchLight, PatchMeans
from cadtof_cli.resolver.diffuse.noise import median_of_noise

LARGEST_LEAD_RAD = 0.1
"""Largest arg q_2 of a tail. A tail that decays has at most 0; the rest is the margin that renderings of 30 rooms need."""

LARGEST_RATIO = 1.2
"""Largest |q_2| of a tail. A tail that decays has less than 1; strong light from one far wall reaches 1.15."""

SEPARATE_SHARE = 0.2
"""Share of separate patches above which a whole frame is taken for two paths. Of 475 rendered rooms, 473 have at most
.14, the other two .17 and .19; frames of two true paths have up to .51. Two true paths with a smaller share are found
by `are_two_paths`: no frame of `scripts/second_paths.py` needs a lower limit than this one."""

LEAST_PATCHES = 64
"""Smallest number of patches with light from which a room can be predicted: a view of 32 × 32 pixels, or a fifth of a
larger one."""

LEAST_MISFIT = 2.0
"""Threshold on the mean squared deviation of the patches from light without MPI, in units of its noise variance. Below it,
the frame counts as free of MPI. Expected value without MPI: 1. Rooms at an integration length of 2e3 show 20 and more.

The same threshold holds for the median over the patches, in units of the median by noise alone; rooms show 3 and more
at that length. The light of a room reaches every surface that is seen. So if half of a view has no MPI, the MPI of the
other half is no tail."""

NOISE_KNOWN = 0.1
"""Relative error with which the variance of the noise is known. If the mean squared deviation of the patches from light
without MPI is closer to 1 than this, it is no evidence for MPI."""

SEEN_SNR = 3.0
"""A patch counts if its amplitude exceeds this multiple of the noise of a pixel."""

SEEN_SHARE = 0.1
"""A patch counts if more than this share of its pixels has a signal."""

NOISE_MARGIN = 7.0
"""Margin for noise on both limits of q_2, in units of σ/|p1| of the patch's mean: three standard deviations of arg q_2.
The variance of arg q_2 is 1 + 4 times that of a phase, and 3·√5 is 6.7."""

LARGEST_MISFIT = 3.0
"""Largest median over the patches of χ² per datum, about the values that the frame expects. Above it, no tail explains
the frame. With three harmonics, rendered rooms have at most 2, and frames with strong second paths after 6 to 11 ns
have 3.6 to 40. With two harmonics the limit is not used: some tail comes near any two data."""

UNEXPLAINED, UNEXPLAINED_SHARE = (10.0, 5.0), (0.065, 0.165)
"""χ² per datum above which no tail of the frame's room explains a patch, and the largest share of such patches in a
frame with a tail: with two harmonics, and with more. In 90 rendered rooms the share is at most .043 and .153. It is .083
and .174 if second paths with a twentieth of the light come 3 to 20 ns late; each patch alone then looks like a tail."""

Reason = Literal["tail", "no MPI to be seen", "separate paths", "no tail fits", "few patches with light"]
"""Why a frame got its model. Only the first reason stands for the diffuse model."""


@dataclass(frozen=True)
class RoomNumbers:
    """The state of a frame: `albedo` s, `beside` b, `later` u, `unseen` v, `decay_ns` τ and `start_ns` t.

    Each is (median over the patches, scatter). The scatter is half the distance from the 16th to the 84th percentile.
    """

    albedo: tuple[float, float]
    beside: tuple[float, float]
    later: tuple[float, float]
    unseen: tuple[float, float]
    decay_ns: tuple[float, float]
    start_ns: tuple[float, float]

    @classmethod
    def of(cls, state: Float, /) -> "RoomNumbers":
        """Return the medians and the scatter of the states of all patches, (6, n)."""
        low, middle, high = quantiles(state, (0.16, 0.5, 0.84))
        scatter = 0.5 * (high - low)
        natural = np.exp(middle[:5])
        albedo, beside, later, unseen, decay = (
            (float(value), float(value * s)) for value, s in zip(natural, scatter, strict=False)
        )
        return cls(albedo, beside, later, unseen, decay, (float(middle[5]), float(scatter[5])))


@dataclass(frozen=True)
class DiffuseChoice:
    """Which model a frame got, and why.

    `patches` is the number of patches with light, `separate_share` the share of them with separate paths, and `room`
    the numbers of the room. `net_patches` is the number of patches covered by a surface that lets light through.
    """

    reason: Reason
    patches: int
    separate_share: float
    room: RoomNumbers | None = None
    net_patches: int = 0

    @property
    def taken(self) -> Literal["discrete", "diffuse"]:
        """Name of the model."""
        return "diffuse" if self.reason == "tail" else "discrete"


@dataclass(frozen=True, eq=False)
class PatchKinds:
    """What kinds of patches a frame has, and what that says of the frame.

    Attributes:
        lit: patches that count, (rows, columns).
        separate: patches with separate paths, (rows, columns).
        choice: the model that the frame gets, as far as these kinds tell.
        mpi_probability: probability that the frame has any MPI, if it is taken for a frame with a tail.
    """

    lit: Bool
    separate: Bool
    choice: DiffuseChoice
    mpi_probability: float = 1.0


def patch_kinds(light: PatchLight, means: PatchMeans, frame: FrameTraits, /) -> PatchKinds:
    """Return the kinds of a frame's patches, from their light and its means.

    If `frame.settings.model` is `diffuse`, every frame with enough light gets a tail.
    """
    settings, sigma = frame.settings, float(np.sqrt(frame.variances[0]))
    lit: Bool = (means.amplitude > SEEN_SNR * sigma) & (means.seen > SEEN_SHARE)
    count, none = int(lit.sum()), np.zeros_like(lit)
    if count < LEAST_PATCHES:
        return PatchKinds(lit, none, DiffuseChoice("few patches with light", count, 0.0))
    misfits = misfits_without_mpi(means, lit, frame)
    misfit = float(np.mean(misfits))
    probability = mpi_probability(misfit, numbers=misfits.size)
    if settings.model == "diffuse":
        return PatchKinds(lit, none, DiffuseChoice("tail", count, 0.0), probability)
    separate = separate_patches(means, lit, sigma)
    reason: Reason = "tail"
    share = float(separate.sum() / count)
    if share > SEPARATE_SHARE:
        reason = "separate paths"
    elif misfit < LEAST_MISFIT or median(misfits.sum(axis=0)) < LEAST_MISFIT * median_of_noise(len(misfits)):
        reason = "no MPI to be seen"
    elif _are_two_paths(light, means, lit, frame):
        reason = "separate paths"
    return PatchKinds(lit, separate, DiffuseChoice(reason, count, share), probability)


def _are_two_paths(light: PatchLight, means: PatchMeans, lit: Bool, frame: FrameTraits) -> bool:
    """Return whether the lit patches have two true paths each, by any sign of them."""
    # imported here because only frames with MPI need it
    from cadtof_cli.resolver.diffuse.even_paths import PatchPlaces, are_two_paths
    from cadtof_cli.resolver.diffuse.second_paths import PatchData
    from cadtof_cli.resolver.diffuse.smoothness import are_smoothed_by_two_paths

    data = PatchData.of(means, lit, frame)
    places = PatchPlaces(frame.grid.even[lit], lit, frame.settings.rad_per_ns, frame.shared.neighbours)
    return are_two_paths(data, places) or are_smoothed_by_two_paths(light, means, lit, frame)


def tail_fits(chi_squared: Float, by_two_paths: Float, data: int, /) -> bool:
    """Return whether a tail explains a frame.

    Args:
        chi_squared: χ² that the tail leaves in the data of each patch, (n,).
        by_two_paths: χ² that two paths leave in the data of the harmonics after the second, (n,); 0 with two harmonics.
            A patch that two paths explain no better than the tail is no evidence against the tail.
        data: number of data of a patch.
    """
    if data > 2 and float(median(chi_squared)) > LARGEST_MISFIT * data:
        return False
    unexplained = (chi_squared > UNEXPLAINED[data > 2] * data) & (by_two_paths * data <= chi_squared * (data - 2))
    return float(np.mean(unexplained)) <= UNEXPLAINED_SHARE[data > 2]


def two_paths_fail(chi_squared: Float, data: int, /) -> bool:
    """Return whether two paths do not explain a frame; the harmonics after the second tell.

    `chi_squared`, (n,), is what two paths leave of these harmonics in each patch; a patch has `data` data in all.
    """
    return data > 2 and float(median(chi_squared)) > LARGEST_MISFIT * (data - 2)


def misfits_without_mpi(means: PatchMeans, lit: Bool, frame: FrameTraits, /) -> Float:
    """Return the squared deviations of the lit patches' q_h from 1, over the noise variance, (2·H − 2, n).

    For each h, there is one row for the deviation of |q_h| and one for that of arg q_h.
    """
    noise = 1.0 / (means.amplitude[lit] ** 2 * means.pixels[lit])
    misfits, variances = [], frame.variances
    for ratio, h, variance in zip(means.ratios[:, lit], frame.settings.harmonics[1:], variances[1:], strict=True):
        misfits.append((np.abs(ratio) - 1.0) ** 2 / (noise * (variances[0] + variance)))
        misfits.append(np.angle(ratio) ** 2 / (noise * (h * h * variances[0] + variance)))
    return np.array(misfits)


def mpi_probability(misfit: float, /, *, numbers: int) -> float:
    """Return the probability that a frame has MPI; the prior probability is one half.

    `misfit` m is χ²/n of `numbers` values about light without MPI. Without MPI, the values have the variance of the
    noise. With MPI, their variance is unknown. The best one, m times that of the noise, explains them better by the
    factor exp(n/2·(m − 1 − ln m)); because it is free, it costs the factor √n. The noise is known to a tenth only, so
    the values of a frame weigh as n = 2/(2/numbers + .1²).
    """
    count = 2.0 / (2.0 / numbers + NOISE_KNOWN**2)
    excess = max(misfit - 1.0, 0.0)
    return 1.0 / (1.0 + math.sqrt(count) * math.exp(-0.5 * count * (excess - math.log1p(excess))))


def separate_patches(means: PatchMeans, lit: Bool, noise_sigma: float, /) -> Bool:
    """Return which lit patches no tail explains, (rows, columns): q_2 exceeds a limit by more than the noise margin."""
    margin = (
        NOISE_MARGIN * noise_sigma / np.where(lit, means.amplitude * np.sqrt(np.maximum(means.pixels, 1.0)), np.inf)
    )
    ratio = means.ratios[0]
    separate: Bool = lit & ((np.angle(ratio) > LARGEST_LEAD_RAD + margin) | (np.abs(ratio) > LARGEST_RATIO + margin))
    return separate
