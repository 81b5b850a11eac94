"""One condition recorded and resolved many times."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.calibration.apply import tabulated_responses
from cadtof_cli.capture.metadata import CaptureMetadata, Pulse
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.maps.depth import beyond_light
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.phasors.voltages import ideal_phasor_map, phasors_from_stored
from cadtof_cli.records import setting
from cadtof_cli.resolver.paper.solver import steps_of_starts
from cadtof_cli.resolver.paper.starts import RandomStarts
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.pixel import PixelModel, record_pixel, seen_length, weight_sums
from cadtof_cli.simulation.pixel.statistics import draw_voltages, voltage_statistics

PHOTON_RUNS, STATISTICS_RUNS = 10, 1000
"""How many runs are drawn together in a block. This is fixed, so that results never depend on the number of processes."""

MOST_RUNS = 10**9

_STATISTICS_KEY, _PHOTONS_KEY, EVOLUTION_KEY = 4, 5, 6
"""Branches of the seed, besides those of `camera`: the voltages of a block of runs, the photons of one run, and the photons of
the recording that `write_evolution` draws."""


@dataclass(frozen=True, kw_only=True)
class Trials:
    """A condition, and how it is recorded and resolved.

    Attributes:
        condition: the light.
        model: the pixel.
        resolver: how voltages become path times. Its seed is replaced by the seed of these trials.
        pulse_correction: divide phasors by the pulse's response r_h; False leaves it in, as the paper's Eq. (3) does.
        stream: number of these trials among others of the same seed; each number gives other random numbers.
    """

    condition: Condition
    model: PixelModel
    resolver: ResolverSettings = field(default_factory=ResolverSettings)
    runs: int = setting(400, "Number of recordings per condition.")
    # the next two do what the paper does and cadtof does not; with `--solver lm --order 2` they give the published method
    pulse_correction: bool = setting(
        True,
        "Whether to correct the phasors for the length of the pulse; the paper does not.  [default: correct]",
        option="--pulse-correction/--no-pulse-correction",
        show_default=False,
    )
    wrapped: bool = setting(
        False,
        "Wrap times to ± half the period before they are compared with the truth, as the paper does; errors are not wrapped.",
        show_default=False,
    )
    seed: int = setting(0, "Seed of the random numbers; the same seed gives the same bytes.")
    photon_by_photon: bool = setting(
        False,
        "Simulate every photon, instead of drawing voltages from their exact mean and covariance.",
        option="--photons",
    )
    stream: int = 0

    def __post_init__(self) -> None:
        require(2 <= self.runs <= MOST_RUNS, "runs", self.runs, f"2 to {MOST_RUNS}")
        require(self.seed >= 0, "seed", self.seed, "0 or more")
        self.condition.mix(self.period_ns)
        # raises an error if no solver fits
        self.resolver.solver_module(self.model.modulation.harmonics, sine=self.sine)
        if self.model.dead_time_ns > 0 and not self.photon_by_photon:
            why = "it has an effect only on single photons"
            raise SettingsError(f"dead time: found without --photons, expected both: {why}")

    @property
    def sine(self) -> bool:
        """Whether the runs are resolved as those of a sine. The paper's equation takes all waveforms for sines."""
        return self.model.modulation.waveform == "sine" or self.resolver.solver == "lm"

    @property
    def period_ns(self) -> float:
        """Period of the laser and of the fundamental."""
        return self.model.modulation.periods_ns[0]

    def generator(self, key: int, /, *places: int) -> np.random.Generator:
        """Return the generator of the random numbers of a branch of the seed, and of a place in this branch."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(key, self.stream, *places)))

    @property
    def blocks(self) -> tuple[range, ...]:
        """The runs, divided into blocks of work."""
        size = PHOTON_RUNS if self.photon_by_photon else STATISTICS_RUNS
        return tuple(range(first, min(first + size, self.runs)) for first in range(0, self.runs, size))


@dataclass(frozen=True)
class Recordings:
    """Runs of a condition, recorded and resolved.

    Attributes:
        voltages_v: (runs, H, 2), harmonics and channels.
        times_ns: (K, runs), K ≥ 2, the direct path first, then the others, the strongest first; NaN if the resolver has none.
        impossible: (runs,), whether amplitudes exceed what the modulation can record; then there is no answer.
        steps: (S, runs), steps of the paper's search from each start; S is 0 with any other solver.
    """

    voltages_v: Float
    times_ns: Float
    impossible: Bool
    steps: Float

    @classmethod
    def joined(cls, parts: "Sequence[Recordings]", /) -> "Recordings":
        """Return the runs of all parts, in order."""
        return cls(
            np.concatenate([part.voltages_v for part in parts]),
            np.concatenate([part.times_ns for part in parts], axis=1),
            np.concatenate([part.impossible for part in parts]),
            np.concatenate([part.steps for part in parts], axis=1),
        )


def recordings(trials: Trials, runs: range, /) -> Recordings:
    """Return a block of runs, recorded and resolved."""
    return resolved(trials, block_voltages(trials, runs), first=runs.start)


def block_voltages(trials: Trials, runs: range, /) -> Float:
    """Return the voltages of a block of runs, (runs of the block, H, 2), in V."""
    model, mix = trials.model, trials.condition.mix(trials.period_ns)
    if trials.photon_by_photon:
        rows = range(len(model.modulation.harmonics))
        generators = ([trials.generator(_PHOTONS_KEY, run, row) for row in rows] for run in runs)
        return np.stack([record_pixel(model, mix, of_run) for of_run in generators])
    means, gain = weight_sums(model)
    statistics = voltage_statistics(
        mix.jittered(model.jitter_ns),
        model.modulation,
        variance_gain=gain,
        mean_gain=means,
        sample_noise_v=model.sample_noise_v,
        motion=model.motion,
    )
    return model.read_out(draw_voltages(statistics, trials.generator(_STATISTICS_KEY, runs.start), draws=len(runs)))


def resolved(trials: Trials, voltages_v: Float, /, *, first: int = 0) -> Recordings:
    """Resolve the voltages of runs, (runs, H, 2), from number `first` on."""
    model, settings = trials.model, replace(trials.resolver, seed=trials.seed)
    metadata = CaptureMetadata(
        modulation=replace(model.modulation, waveform="sine" if trials.sine else model.modulation.waveform),
        pulse=Pulse(fwhm_ns=trials.condition.fwhm_ns if trials.pulse_correction else 0.0),
    )
    stored = np.moveaxis(voltages_v, 0, -1)
    phasors = phasors_from_stored(stored, ideal_phasor_map(metadata, stored.dtype))
    noise = noise_model(metadata, integration_length=seen_length(model), quantised=False)
    response = tabulated_responses(ideal_response(metadata), None)
    found = resolve_paths(
        phasors,
        status=np.zeros(len(voltages_v), np.uint32),
        settings=settings,
        noise=noise,
        response=response,
        first=first,
    )
    longest = response.longest if response else 1.0
    impossible = beyond_light(found.paths.amplitude, found.confidence, noise=noise, longest=longest)
    times = np.where(impossible, np.nan, found.paths.phase_rad / (2.0 * math.pi) * trials.period_ns)
    return Recordings(voltages_v, times, impossible, _steps(phasors, settings, model.modulation.harmonics, first))


def _steps(phasors: Complex, settings: ResolverSettings, harmonics: tuple[int, ...], first: int) -> Float:
    if settings.solver_module(harmonics, sine=True) != "paper.solver":
        return np.empty((0, phasors.shape[1]))
    places, starts = np.arange(first, first + phasors.shape[1]), RandomStarts(settings.starts, settings.seed)
    with np.errstate(all="ignore"):
        return steps_of_starts(phasors, harmonics=harmonics, places=places, starts=starts).astype(np.float64)
