"""The noise of phasors, known from the integration length or estimated from a frame, and thresholds on χ²."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cadtof_cli.arrays import Complex, Float, Float32, SomePixels, Stored, median
from cadtof_cli.capture.metadata import CaptureMetadata, Waveform, mean_length
from cadtof_cli.phasors.response import ideal_response, pulse_response
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.phasors.rotors import Rotor

MAD_PER_SIGMA = 0.6744897501960817
"""Median absolute deviation of a Gaussian over its standard deviation."""

_MEAN_SQUARE: dict[Waveform, float] = {"sine": 1.0 / 2.0, "triangle": 1.0 / 3.0}
"""Mean square of a waveform of amplitude 1."""

_WAVE_NOISE: dict[Waveform, tuple[float, float]] = {
    "sine": (1.0, 1.0),
    "triangle": (8.0 / math.pi**2 * math.sqrt(1.5), 3.0 * (2.0 / math.pi**2 + 4.0 / math.pi**3)),
}
"""Factors on r_h and r_2h: with them, the equations for the noise of a sine give the noise of this waveform.

r_h: a sampled triangle has the mean square 1/3 instead of 1/2, and its term k = 1 is 8/π² of its amplitude, so that
(1/3)/(8/π²)² = (1/2)/0.993². r_2h: light of one delay changes the covariance matrix with twice its phase. The variances
change by 4/π² and the covariance by 8/π³; a sine has 1/2 in both. The mean of 4/π² and 8/π³, over 1/3, is 0.995. The
terms that are left out are below 3 % of the variance at ASR 5.
"""

LEAST_SHARE = 1e-3
"""Floor for the variance of a phasor, as a share of the variance by ambient light alone: if all light is the laser's, the
variance along the phasor falls to rounding error."""

MOST_INTEGRATION = 1e12
"""Longest integration length, that of a frame without any noise. Its noise is that of float32 rounding, so every
threshold stays finite."""


FEWEST_DIFFERENCES = 16
"""Fewest differences between neighbours from which noise is estimated."""

FEWEST_ALIKE = 16
"""Least number of pixels in a frame that cannot all hold the same values by accident."""

_COARSE = 0.4
"""Share of pixels with the value of their neighbour above which counts are so coarse that noise leaves many neighbours the
same: noise of .7 counts and less."""


@dataclass(frozen=True)
class HarmonicNoise:
    """Noise of one harmonic's phasor, in units of the modulation amplitude.

    `harmonic` is its number h, `averaging` is 1/(2·n_av − 1) of the exponentially weighted average, `pulse` and
    `pulse_double` are r_h and r_2h times the factors of the waveform. `floor` is a variance per channel that does not
    depend on the light: that of quantisation, and of the noise of a calibration's own frames.
    """

    harmonic: int
    averaging: float
    pulse: float
    pulse_double: float
    floor: float

    @cached_property
    def ambient_variance(self) -> float:
        """Variance per channel by photons of ambient light alone."""
        return 0.5 * self.averaging / self.pulse**2

    @cached_property
    def dark_variance(self) -> float:
        """Variance per channel if only ambient light arrives."""
        return self.ambient_variance + self.floor

    def one_path_variances(self, amplitude: Float | Float32, /) -> tuple[Any, Any]:
        """Return the variances along and across the phasor of a single path of the given amplitude, (n,) each, of the
        amplitude's type."""
        share: Any = np.clip(amplitude, 0.0, 1.0)
        doubled = (self.ambient_variance * self.pulse_double) * share
        across = self.dark_variance - doubled
        along = self.dark_variance + doubled - self.averaging * share * share
        return np.maximum(along, LEAST_SHARE * self.ambient_variance), across

    def covariance(self, phasor: "Rotor", doubled: "Rotor", /) -> tuple[Float, Float, Float]:
        """Return the covariance's entries re·re, re·im and im·im, (n,) each, for light whose phasors at h and 2h are given.

        The equation is that of `noise_model`; `LEAST_SHARE` keeps the matrix positive definite.
        """
        level, double, averaging = self.covariance_terms
        re, im = phasor
        return (
            level + double * doubled[0] - averaging * re * re,
            double * doubled[1] - averaging * re * im,
            level - double * doubled[0] - averaging * im * im,
        )

    @property
    def covariance_terms(self) -> tuple[float, float, float]:
        """Variance without light, the factor of the phasor at 2h, and the factor of the products of the phasor at h."""
        ambient = self.ambient_variance
        return (1.0 + LEAST_SHARE) * ambient + self.floor, ambient * self.pulse_double, self.averaging


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Noise of every recorded harmonic, independent of each other, and the integration length that it follows from, or
    that gives their mean noise if each has its own.

    `each` is the noise of one recorded pixel's phasors, one entry per harmonic. `samples`, (n,), is the number of
    recorded pixels that each phasor is a mean of (None: 1). `noise[block]` is the noise of some of these n phasors.
    """

    each: tuple[HarmonicNoise, ...]
    integration_length: float
    estimated: bool
    samples: Float | None = None

    def __getitem__(self, pixels: SomePixels, /) -> "NoiseModel":
        return self if self.samples is None else replace(self, samples=self.samples[pixels])

    @cached_property
    def harmonics(self) -> tuple[int, ...]:
        """The numbers of the harmonics."""
        return tuple(one.harmonic for one in self.each)


def noise_model(
    metadata: CaptureMetadata,
    /,
    *,
    integration_length: float | tuple[float, ...],
    quantised: bool,
    estimated: bool = False,
) -> NoiseModel:
    """Return the noise of a capture's phasors at an integration length n_av, of all harmonics or of each.

    The covariance of harmonic h is [[(1+Re m_2h)/2 − c², Im m_2h/2 − cs], [·, (1−Re m_2h)/2 − s²]]/(2·n_av − 1) with
    c + is = m_h (docs/physics.md); `quantised` adds a count's rounding error, 1/12 count².
    """
    modulation, voltage = metadata.modulation, metadata.voltage
    step = (voltage.volts_per_count or 0.0) / modulation.amplitude_v if quantised else 0.0
    gain, doubled = _WAVE_NOISE[modulation.waveform]
    pulse = partial(pulse_response, fwhm_ns=metadata.pulse.fwhm_ns, period_ns=modulation.periods_ns[0])
    lengths = integration_length
    each = lengths if isinstance(lengths, tuple) else (lengths,) * len(modulation.harmonics)
    return NoiseModel(
        tuple(
            HarmonicNoise(
                h,
                1.0 / (2.0 * length - 1.0),
                gain * pulse(h),
                doubled * pulse(2 * h),
                (step / response.main.real) ** 2 / 12,
            )
            for h, length, response in zip(modulation.harmonics, each, ideal_response(metadata), strict=True)
        ),
        mean_length(lengths),
        estimated,
    )


def ambient_noise_v(metadata: CaptureMetadata, /, *, integration_length: float) -> float:
    """Return the standard deviation of a channel of one frame, in V, if only ambient light arrives."""
    modulation = metadata.modulation
    return modulation.amplitude_v * math.sqrt(_MEAN_SQUARE[modulation.waveform] / (2.0 * integration_length - 1.0))


def repeated_rounding(ratio: float, /) -> float:
    """Return the share of the variance of rounding errors that recordings of the same light have in common.

    `ratio` is the variance of the noise over that of rounding, count²/12. If noise of the standard deviation σ is small
    beside a count, the error of a pixel is nearly the same in all recordings, and their mean keeps it. The share is
    Σ_k 6/(πk)²·exp(−(2πkσ/count)²): 1 without noise, and less than 1 % from σ = 1/3 count on.
    """
    k = np.arange(1, 201)
    return float((6.0 / (math.pi * k) ** 2 * np.exp(-((2.0 * math.pi * k) ** 2) * ratio / 12.0)).sum())


def with_repeated_rounding(noise: NoiseModel, recordings: float, /) -> NoiseModel:
    """Return the noise of one recording; over the number of recordings, it is the noise of their mean."""
    if not all(one.floor for one in noise.each):
        return noise
    shares = (repeated_rounding(one.ambient_variance / one.floor) for one in noise.each)
    floors = (one.floor * (1.0 + (recordings - 1.0) * share) for one, share in zip(noise.each, shares, strict=True))
    return replace(noise, each=tuple(replace(one, floor=floor) for one, floor in zip(noise.each, floors, strict=True)))


@np.errstate(invalid="ignore", over="ignore")
def estimated_integration_length(
    phasors: Complex,
    metadata: CaptureMetadata,
    /,
    *,
    quantised: bool,
    samples: float = 1.0,
    variances: Float | None = None,
) -> float:
    """Return the n_av that explains the pixel-to-pixel noise of a frame's phasors, complex128 (H, Y, X).

    The diagonal second difference (p[y,x] − p[y,x+1] − p[y+1,x] + p[y+1,x+1])/2 keeps the variance of white noise and
    removes every gradient along rows and columns; a sensor of one row or column has (p[x] − 2·p[x+1] + p[x+2])/√6. Its
    median absolute deviation ignores edges and outliers. NaN is left out, and so are neighbours that all hold the same
    values, as where a camera sets pixels without light to 0 V.

    The less ambient light a pixel has, the less noise. So each difference is divided by the deviation that `noise_model`
    expects of its pixels, over that of a pixel with the median of |p_h|². The variance is compared with that of such a pixel.
    Phasors of a triangle are those of the pixel's channels: not turned by a calibrated delay.
    Returns infinity for a frame without noise, and NaN if fewer than 16 differences of a harmonic are finite.

    `quantised`: the values are whole numbers. Rounding to them is not noise of photons, so its variance is taken off.
    `samples`: number of recordings that each pixel is a mean of. The n_av is that of one recording.
    `variances`: (Y, X), of pixels that are means of other numbers of recordings, over that of a mean of `samples`.
    """
    # its variances are those of photons, times 2·n_av − 1
    unit = noise_model(metadata, integration_length=1.0, quantised=quantised)
    # infinite pixels make NaN here, and NaN is left out
    line = 1 in phasors.shape[1:]
    phasors = _recorded(phasors.reshape(len(phasors), 1, -1), 1, 3) if line else _recorded(phasors, 2, 2)
    if line:
        difference = np.diff(phasors, n=2) / math.sqrt(6.0)
    else:
        difference = 0.5 * (phasors[:, :-1, :-1] - phasors[:, :-1, 1:] - phasors[:, 1:, :-1] + phasors[:, 1:, 1:])
    seen = expected = 0.0
    quieter = _less_noise(phasors, unit.each, metadata.modulation.waveform)
    for plane, less, one in zip(difference, quieter, unit.each, strict=True):
        if np.count_nonzero(np.isfinite(plane)) < FEWEST_DIFFERENCES:
            return math.nan
        usual, least = float(median(less[np.isfinite(less)])), 2.0 * LEAST_SHARE * one.ambient_variance
        typical = max(2.0 * one.ambient_variance - usual, least)
        own = np.maximum(2.0 * one.ambient_variance - less, least) / typical
        own = own if variances is None else own * variances.reshape(own.shape)
        pairs = own[:-1] + own[1:]
        # the variance of each second difference
        mean = (own[:, :-2] + 4.0 * own[:, 1:-1] + own[:, 2:]) / 6.0 if line else 0.25 * (pairs[:, :-1] + pairs[:, 1:])
        plane = plane / np.sqrt(mean)
        finite = plane[np.isfinite(plane)]
        # means of counts are multiples of step/samples, and half their sums are multiples of half of that
        step = 0.5 * math.sqrt(12.0 * one.floor) / samples
        spread = [median_of_steps(np.abs(part), step) / MAD_PER_SIGMA for part in (finite.real, finite.imag)]
        seen += spread[0] ** 2 + spread[1] ** 2 - 2.0 * (one.floor / samples + step**2 / 12.0)
        expected += typical
    averaging = float(seen / expected)
    if averaging <= 0.0:
        return math.inf
    # 1/(2·n_av − 1) of one recording is that of the mean, times the number of recordings
    return 0.5 * (1.0 + 1.0 / averaging / samples)


def _less_noise(phasors: Complex, each: Sequence[HarmonicNoise], waveform: Waveform, /) -> Float:
    """Return by how much less than ambient light's the variance of both channels is, of `phasors`' shape, times 2·n_av − 1.

    The variance is the mean square of the samples less the square of their mean, |p|². Samples of a sine have the same mean
    square at all times. With a triangle, all light of one path is a = |SC1| + |SC2|, and its mean square is |SC|²/a; over all
    times it is 2/3. The less of the light that the harmonic with the largest sum shows is in a harmonic's sum, the more the
    light is of several paths, and the nearer to 2/3 its mean square is taken to be.
    """
    power = np.square(np.abs(phasors))
    if waveform == "sine":
        return power
    ambient = np.array([2.0 * one.ambient_variance for one in each])[:, np.newaxis, np.newaxis]
    scale = np.sqrt(2.0 / 3.0 / ambient)
    # in units of the triangle's amplitude
    sums = scale * (np.abs(phasors.real) + np.abs(phasors.imag))
    light = np.maximum(sums.max(axis=0), np.finfo(np.float64).tiny)
    less: Float = power - (power - ambient * np.square(sums)) / light
    return less


def median_of_steps(sizes: Float, step: float, /) -> float:
    """Return the median of sizes ≥ 0, (n,), each of which stands for all sizes within half a `step` of it.

    Sizes of whole numbers have few values, and their median is one of these: it may be half a step off. This median is
    not. The median of sizes that are not in steps stays as it is, apart from noise. With a step of 0, it is the usual one.
    """
    if step == 0.0:
        return float(median(sizes))
    middle = sizes.size // 2
    value = float(np.partition(sizes, middle)[middle])
    low, high = max(value - 0.5 * step, 0.0), value + 0.5 * step
    below = int(np.count_nonzero(sizes < low))
    within = int(np.count_nonzero(sizes <= high)) - below
    return low + (high - low) * (0.5 * sizes.size - below) / within


def _recorded(phasors: Complex, down: int, right: int) -> Complex:
    """Return phasors, (H, Y, X), with NaN where `down` × `right` neighbours hold the same values, unless hardly any others
    are left."""
    rows, columns = phasors.shape[1] - down + 1, phasors.shape[2] - right + 1
    if min(rows, columns) < 1:
        return phasors
    first, *others = (np.s_[y : y + rows, x : x + columns] for y in range(down) for x in range(right))
    same = np.ones((rows, columns), np.bool_)
    for place in others:
        # noise leaves no neighbours the same, so this nearly always ends at once
        for phasor in phasors:
            same &= phasor[place] == phasor[first]
        if not same.any():
            return phasors
    left_out = np.zeros(phasors.shape[1:], np.bool_)
    for place in (first, *others):
        left_out[place] |= same
    kept = ~np.logical_or.reduce([left_out[place] for place in (first, *others)])
    if np.count_nonzero(kept) < FEWEST_DIFFERENCES:
        return phasors
    repeated = [np.mean(phasor.real[others[0]][kept] == phasor.real[first][kept]) for phasor in phasors]
    return phasors if max(repeated) > _COARSE else np.where(left_out, np.nan, phasors)


def is_without_noise(stored: Stored, noise: NoiseModel, /) -> bool:
    """Return whether all pixels, (H, 2, n), hold the same values although noise makes that impossible.

    Noise makes it impossible if it is more than half a step of the stored values and the pixels are not just a few. If
    the noise is estimated from these pixels, it tells nothing, and they are taken for none that a camera recorded.
    """
    if stored.shape[2] < FEWEST_ALIKE or not (stored == stored[:, :, :1]).all():
        return False
    # the floor is the variance of rounding to steps of s, s²/12: the rest is then more than 3·s²/12 = (s/2)²
    return noise.estimated or all(one.dark_variance > 4.0 * one.floor for one in noise.each)


@lru_cache(maxsize=64)
def chi_squared_threshold(false_alarm: float, *, pairs: int) -> float:
    """Return the χ² (2·pairs degrees of freedom) that noise exceeds with probability `false_alarm`.

    N harmonics without a signal have N pairs; K paths fitted to N harmonics leave N − K pairs. Noise exceeds t with
    probability exp(−t/2)·Σ_{k<pairs} (t/2)^k/k!. For one pair the threshold is −2·ln(false alarm), 9.21 at 1 %. The
    probability falls with t, so bisection finds the threshold for more pairs.
    """
    low, high = 0.0, 4.0 * (pairs - math.log(false_alarm))
    while low < (middle := 0.5 * (low + high)) < high:
        half = 0.5 * middle
        survival = math.exp(-half) * sum(half**k / math.factorial(k) for k in range(pairs))
        low, high = (middle, high) if survival > false_alarm else (low, middle)
    return middle
