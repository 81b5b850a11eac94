"""Which model a frame gets: a tail where there is MPI, and no sign that it comes by separate paths.

A tail lowers |H_2| below |H_1| and makes it lag. Two paths can do otherwise: a weak first return before a strong one, or a strong
second one 12 to 28 ns late (T1 = 40 ns), makes H_2 lead, or larger than H_1. Those that do not are told by all patches together.
"""

import math
from typing import Literal

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.quantiles import median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.even_paths import PatchPlaces, are_even
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.light import PatchLight, PatchMeans
from cadtof_cli.resolver.diffuse.second_paths import (
    PatchData,
    SecondPaths,
    foretelling,
    foretells,
    has_one_share,
    median_of_noise,
)
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.diffuse.smoothness import are_smoothed_by_two_paths
from cadtof_cli.resolver.kernels import NUMPY

LARGEST_LEAD_RAD = 0.1
"""Largest arg q_2 of a tail: 0 for one that decays, and what renderings of 30 rooms leave of it."""

LARGEST_RATIO = 1.2
"""Largest |q_2| of a tail: below 1 for one that decays; strong light from one far wall reaches 1.15."""

SEPARATE_SHARE = 0.2
"""Share of separate patches above which a whole frame is taken as two paths: .14 at the most in 473 of 475 rendered rooms, .17
and .19 in the others; up to .51 on true ones. Those below are told by `are_two_paths`: no frame of `scripts/second_paths.py`
needs less than this."""

LEAST_PATCHES = 64
"""Patches with light below which there is no room to predict from: a view of 32 × 32 pixels, or a fifth of a larger one."""

LEAST_MISFIT = 2.0
"""Square of what patches differ from light without MPI, over its noise, below which there is no MPI to be seen: 1 without any;
rooms at an integration length of 2e3 show 20 and more. As the mean of all, and as the median of the patches, over that of noise:
the light of a room reaches all that is seen, by 3 and more at that length; where half a view has none, the rest has no tail."""

NOISE_KNOWN = 0.1
"""Share of the noise's variance to which it is known; a mean square of the patches' departures from light without MPI that is
closer to 1 than that says nothing against there being none."""

SEEN_SNR = 3.0
"""Amplitude over noise from which a patch counts."""

SEEN_SHARE = 0.1
"""Share of a patch's pixels that must have a signal for it to count."""

NOISE_MARGIN = 7.0
"""Three standard deviations of arg q_2 in σ/|p1| of a pixel: its variance is 1 + 4 times that of a phase; √5 · 3."""

LARGEST_MISFIT = 3.0
"""Median over the patches of χ² per datum, against what the frame expects of them, above which no tail explains it: at most 2
with three harmonics in rendered rooms, and 3.6 to 40 where there are strong second paths after 6 to 11 ns. The two data of two
harmonics say nothing about that: some tail comes near any of them."""

UNEXPLAINED, UNEXPLAINED_SHARE = (10.0, 5.0), (0.065, 0.165)
"""χ² per datum above which no tail of the frame's room explains a patch, and the share of such patches above which the frame has
none: with two harmonics, and with more. At most .043 and .153 are so in 90 rendered rooms; .083 and .174 where second paths of a
twentieth of the light come 3 to 20 ns late, each like a tail alone."""

Reason = Literal["tail", "no MPI to be seen", "separate paths", "no tail fits", "few patches with light"]
"""Why a frame got its model: the first is diffuse."""


@dataclass(frozen=True, eq=False)
class PatchKinds:
    """Which patches count, (rows, columns), which of them have separate paths, what share, and what that says of the frame.

    `mpi_probability` is how likely it is that any MPI is in the frame at all, where it is taken for one with a tail.
    """

    lit: Bool
    separate: Bool
    separate_share: float
    reason: Reason
    mpi_probability: float = 1.0


@dataclass(frozen=True)
class RoomNumbers:
    """The frame's state as medians over its patches, and their scatter (half the way from the 16th to the 84th percentile).

    `albedo` s, `beside` b, `later` u, `unseen` v, `decay_ns` τ and `start_ns` t; each (median, scatter).
    """

    albedo: tuple[float, float]
    beside: tuple[float, float]
    later: tuple[float, float]
    unseen: tuple[float, float]
    decay_ns: tuple[float, float]
    start_ns: tuple[float, float]


@dataclass(frozen=True)
class DiffuseChoice:
    """Which model a frame got and why: `patches` with light, the share of them with separate paths, the room's numbers, and how
    many patches something covers that lets light through.
    """

    reason: Reason
    patches: int
    separate_share: float
    room: RoomNumbers | None = None
    through_patches: int = 0

    @property
    def taken(self) -> Literal["discrete", "diffuse"]:
        """The model."""
        return "diffuse" if self.reason == "tail" else "discrete"


def patch_kinds(
    light: PatchLight,
    means: PatchMeans,
    variances: Float,
    /,
    *,
    grid: PatchGrid,
    settings: DiffuseSettings,
    alike: float = 0.0,
    kernel: str = NUMPY,
) -> PatchKinds:
    """Look at the light of every patch of a grid, and at its means; `variances` are those of a channel of each harmonic.

    With `settings.model` `diffuse`, nothing but too little light speaks against a tail. `alike` is the correlation of the noise
    of neighbours, `kernel` of `available_kernels`.
    """
    sigma = float(np.sqrt(variances[0]))
    # enough of a patch's pixels are lit enough
    lit: Bool = (means.amplitude > SEEN_SNR * sigma) & (means.seen > SEEN_SHARE)
    if lit.sum() < LEAST_PATCHES:
        return PatchKinds(lit, np.zeros_like(lit), 0.0, "few patches with light")
    misfits = misfits_without_mpi(means, lit, variances, harmonics=settings.harmonics)
    misfit = float(np.mean(misfits))
    likely = mpi_probability(misfit, numbers=misfits.size)
    if settings.model == "diffuse":
        return PatchKinds(lit, np.zeros_like(lit), 0.0, "tail", likely)
    separate = separate_patches(means, lit, sigma)
    reason: Reason = "tail"
    share = float(separate.sum() / lit.sum())
    if share > SEPARATE_SHARE:
        reason = "separate paths"
    elif misfit < LEAST_MISFIT or _is_noise_in_half(misfits):
        reason = "no MPI to be seen"
    elif are_two_paths(
        PatchData.of(means, lit, variances, settings.harmonics),
        PatchPlaces(grid.even[lit], means.phase_rad[lit], lit, settings.rad_per_ns, alike),
        kernel=kernel,
    ) or are_smoothed_by_two_paths(light, means, lit, grid=grid, settings=settings, kernel=kernel):
        reason = "separate paths"
    return PatchKinds(lit, separate, share, reason, likely)


def are_two_paths(data: PatchData, places: PatchPlaces, /, *, kernel: str = NUMPY) -> bool:
    """Return whether patches have two true paths each: of one share, or as further harmonics tell, or else evenness."""
    with np.errstate(all="ignore"):
        # of one path alone, the other has no delay
        found = SecondPaths.of(data, kernel=kernel)
        if has_one_share(found, rad_per_ns=places.rad_per_ns):
            return True
        return foretells(found, data) if foretelling(found, data) else are_even(found, data, places)


def tail_fits(chi_squared: Float, by_two_paths: Float, data: int, /) -> bool:
    """Return whether a tail explains a frame whose patches, (n,), leave these χ² of so many data each.

    `by_two_paths`, (n,), is what two paths leave of the data that follow those of q_2, none with two harmonics. A patch that they
    explain no better than a tail does says nothing for them.
    """
    if data > 2 and float(median(chi_squared)) > LARGEST_MISFIT * data:
        return False
    unexplained = (chi_squared > UNEXPLAINED[data > 2] * data) & (by_two_paths * data <= chi_squared * (data - 2))
    return float(np.mean(unexplained)) <= UNEXPLAINED_SHARE[data > 2]


def misfits_without_mpi(means: PatchMeans, lit: Bool, variances: Float, /, *, harmonics: tuple[int, ...]) -> Float:
    """Return the squares, over the noise, of how far the lit patches' q_h are from 1, in size and in phase, (2·H − 2, n)."""
    noise = 1.0 / (means.amplitude[lit] ** 2 * means.pixels[lit])
    misfits = []
    for ratio, h, variance in zip(means.ratios[:, lit], harmonics[1:], variances[1:], strict=True):
        misfits.append((np.abs(ratio) - 1.0) ** 2 / (noise * (variances[0] + variance)))
        misfits.append(np.angle(ratio) ** 2 / (noise * (h * h * variances[0] + variance)))
    return np.array(misfits)


def _is_noise_in_half(misfits: Float) -> bool:
    """Return whether the misfits of patches without MPI, (numbers, n), are those of noise in half of them."""
    return float(median(misfits.sum(axis=0))) < LEAST_MISFIT * median_of_noise(len(misfits))


def mpi_probability(misfit: float, /, *, numbers: int) -> float:
    """Return how likely MPI is in a frame, one to one before it was seen, from the misfit of so many numbers without it.

    Without MPI the misfit m is that of noise, χ²/n; with it, noise and MPI together have some variance, whatever it is: m times
    the noise's explains the numbers by exp(n/2·(m − 1 − ln m)) better, at a cost of √n for being free to choose. Since the noise
    itself is known to a tenth, a frame's numbers weigh as n = 2/(2/numbers + .1²).
    """
    count = 2.0 / (2.0 / numbers + NOISE_KNOWN**2)
    more = max(misfit - 1.0, 0.0)
    return 1.0 / (1.0 + math.sqrt(count) * math.exp(-0.5 * count * (more - math.log1p(more))))


def separate_patches(means: PatchMeans, lit: Bool, noise_sigma: float, /) -> Bool:
    """Return which of the lit patches no tail explains, beyond what noise does to them, (rows, columns)."""
    margin = (
        NOISE_MARGIN * noise_sigma / np.where(lit, means.amplitude * np.sqrt(np.maximum(means.pixels, 1.0)), np.inf)
    )
    ratio = means.ratios[0]
    separate: Bool = lit & ((np.angle(ratio) > LARGEST_LEAD_RAD + margin) | (np.abs(ratio) > LARGEST_RATIO + margin))
    return separate
