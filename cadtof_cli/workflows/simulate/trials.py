"""One condition recorded and resolved many times: how well path times come back."""

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel, Pulse
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.voltages import ideal_phasor_map, phasors_from_stored
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.averaging import effective_length
from cadtof_cli.simulation.pixel.bounds import time_bounds_ns
from cadtof_cli.simulation.pixel.mix import Condition, require
from cadtof_cli.simulation.pixel.pixel import PixelModel, pixel_weights, record_pixel
from cadtof_cli.simulation.pixel.statistics import averaging_gain, confidence_model_v, draw_voltages, voltage_statistics

PHOTON_RUNS, STATISTICS_RUNS = 10, 1000
"""Runs that are drawn together; fixed, so that results never depend on how many processes share the blocks."""

SUCCESS_NS = 1.0
"""Half the width of the paper's success region, Fig. 7."""

_STATISTICS_KEY, _PHOTONS_KEY, EVOLUTION_KEY = 4, 5, 6
"""Branches of the seed, after those of `camera`: voltages of a block of runs, photons of one run, and of a drawn one."""


@dataclass(frozen=True, kw_only=True)
class Trials:
    """A condition with how it is recorded and resolved.

    Attributes:
        condition: the light.
        model: the pixel.
        resolver: how voltages become path times.
        runs: how often.
        photon_by_photon: draw photons, rather than voltages from their exact mean and covariance.
        pulse_correction: divide phasors by the pulse's response r_h; False leaves it in, as the paper's Eq. (3) does.
        seed: of all that is random.
        stream: number of these trials among others of the same seed.
    """

    condition: Condition
    model: PixelModel
    resolver: ResolverSettings = field(default_factory=ResolverSettings)
    runs: int = 400
    photon_by_photon: bool = False
    pulse_correction: bool = True
    seed: int = 0
    stream: int = 0

    def __post_init__(self) -> None:
        require(self.runs >= 2, "runs", self.runs, "2 or more")
        require(self.seed >= 0, "seed", self.seed, "0 or more")
        self.condition.mix(self.period_ns)
        if self.model.dead_time_ns > 0 and not self.photon_by_photon:
            raise SettingsError("dead time: found without photons, expected photon by photon, where it has an effect")

    @property
    def period_ns(self) -> float:
        """Period of the laser and of the fundamental."""
        return self.model.modulation.periods_ns[0]

    @property
    def blocks(self) -> tuple[range, ...]:
        """The runs, divided into blocks of work."""
        size = PHOTON_RUNS if self.photon_by_photon else STATISTICS_RUNS
        return tuple(range(first, min(first + size, self.runs)) for first in range(0, self.runs, size))


@dataclass(frozen=True)
class PathSummary:
    """How one path's time came back: in ns, and the share of runs within ±1 ns. NaN where there is no such path."""

    true_ns: float
    mean_ns: float
    bias_ns: float
    std_ns: float
    bound_ns: float
    within_1ns: float


@dataclass(frozen=True)
class TrialsSummary:
    """What all runs of a condition say together.

    Attributes:
        direct, second: the two paths.
        confidence_v: mean magnitude of the first phasor's voltages.
        confidence_model_v: the same by the analytical model.
        phase_std_rad: standard deviation of the first phasor's phase.
        phase_bias_rad: mean of the first phasor's phase, less that of the direct path.
    """

    direct: PathSummary
    second: PathSummary
    confidence_v: float
    confidence_model_v: float
    phase_std_rad: float
    phase_bias_rad: float


@lru_cache(maxsize=2)
def _weights(model: PixelModel) -> Float32:
    return pixel_weights(model)


def block_voltages(trials: Trials, runs: range, /) -> Float:
    """Return the voltages of one of the blocks of runs, (runs of the block, H, 2), in V."""
    model, mix = trials.model, trials.condition.mix(trials.period_ns)
    if trials.photon_by_photon:
        return np.stack([record_pixel(model, mix, _weights(model), _generators(trials, run)) for run in runs])
    means, gain = _gains(model)
    statistics = voltage_statistics(
        mix.jittered(model.jitter_ns),
        model.modulation,
        variance_gain=gain,
        mean_gain=means,
        sample_noise_v=model.sample_noise_v,
    )
    key = (_STATISTICS_KEY, trials.stream, runs.start)
    generator = np.random.default_rng(np.random.SeedSequence(trials.seed, spawn_key=key))
    voltages = draw_voltages(statistics, generator, draws=len(runs))
    return np.asarray(voltages * np.array([1.0, 1.0 + model.gain_mismatch]) + np.array(model.offsets_v))


def _generators(trials: Trials, run: int) -> list[np.random.Generator]:
    return [
        np.random.default_rng(np.random.SeedSequence(trials.seed, spawn_key=(_PHOTONS_KEY, trials.stream, run, row)))
        for row in range(len(trials.model.modulation.harmonics))
    ]


def _gains(model: PixelModel) -> tuple[float, float]:
    """Return Σ w_i and Σ w_i²: of the settled average of Eq. (1), or of what a switched cascade has taken up."""
    if model.averaging.stages.drive == "dc":
        return 1.0, averaging_gain(model.averaging.integration_length)
    weights = _weights(model)[0].astype(np.float64)
    return float(weights.sum()), float((weights**2).sum())


def noise_length(model: PixelModel, /) -> float:
    """Return the integration length that stands for the pixel's noise, whatever its stages."""
    if model.averaging.stages.drive == "dc":
        return model.averaging.integration_length
    return effective_length(_weights(model)[0].astype(np.float64))


def path_times_ns(trials: Trials, voltages_v: Float, /) -> Float:
    """Return the direct and the second path's time in every run, (2, runs), in ns; NaN where the resolver has none.

    Args:
        trials: the condition and how it is resolved.
        voltages_v: (runs, 2, 2), harmonics and channels of each run.
    """
    model = trials.model
    if model.modulation.harmonics != (1, 2):
        raise SettingsError(
            f"periods: found {list(model.modulation.periods_ns)}, expected a fundamental and its half, such as [40, 20]"
        )
    length = noise_length(model)
    metadata = CaptureMetadata(
        modulation=model.modulation,
        pixel=Pixel(integration_length=length),
        pulse=Pulse(fwhm_ns=trials.condition.fwhm_ns if trials.pulse_correction else 0.0),
    )
    stored = np.moveaxis(voltages_v, 0, -1)
    paths = resolve_paths(
        phasors_from_stored(stored, ideal_phasor_map(metadata, stored.dtype)),
        status=np.zeros(len(voltages_v), np.uint32),
        settings=trials.resolver,
        noise=noise_model(metadata, integration_length=length, quantised=False),
    ).paths
    turns = paths.phase_rad[:2] / (2.0 * math.pi)
    return np.asarray(turns * trials.period_ns)


def summary(trials: Trials, voltages_v: Float, /) -> TrialsSummary:
    """Return what the voltages of all runs, (runs, H, 2), say."""
    condition, modulation = trials.condition, trials.model.modulation
    mix = condition.mix(trials.period_ns).jittered(trials.model.jitter_ns)
    times = path_times_ns(trials, voltages_v)
    bounds = time_bounds_ns(mix, modulation, variance_gain=averaging_gain(noise_length(trials.model)))
    phasors = voltages_v[:, 0, 0] + 1j * voltages_v[:, 0, 1]
    lag = np.angle(phasors * np.exp(-2j * math.pi * condition.direct_ns / trials.period_ns))
    second_ns = condition.second_ns if condition.mpi_ratio > 0 else math.nan
    return TrialsSummary(
        direct=_path_summary(times[0], condition.direct_ns, float(bounds[0]), trials.period_ns),
        second=_path_summary(times[1], second_ns, float(bounds[1]), trials.period_ns),
        confidence_v=float(np.abs(phasors).mean()),
        confidence_model_v=float(confidence_model_v(mix, modulation)),
        phase_std_rad=float(np.std(lag, ddof=1)),
        phase_bias_rad=float(np.mean(lag)),
    )


def _path_summary(times_ns: Float, true_ns: float, bound_ns: float, period_ns: float) -> PathSummary:
    """Sum up times modulo the period, as differences from the truth; runs without an answer count as failures only."""
    found = times_ns[np.isfinite(times_ns)]
    if math.isnan(true_ns) or len(found) < 2:
        return PathSummary(true_ns, math.nan, math.nan, math.nan, bound_ns, math.nan if math.isnan(true_ns) else 0.0)
    errors = np.mod(found - true_ns + period_ns / 2.0, period_ns) - period_ns / 2.0
    bias = float(errors.mean())
    within = float((np.abs(errors) <= SUCCESS_NS).sum()) / len(times_ns)
    return PathSummary(true_ns, true_ns + bias, bias, float(errors.std(ddof=1)), bound_ns, within)
