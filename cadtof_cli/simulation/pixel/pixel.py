"""The pixel: each photon samples the modulation when it arrives, and the samples are averaged by their weights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Float, Float32, sealed
from cadtof_cli.capture.metadata import Modulation
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.records import setting
from cadtof_cli.simulation.pixel.arrivals import draw_detections, draw_phases
from cadtof_cli.simulation.pixel.averaging import Averaging, averaging_gain, effective_length
from cadtof_cli.simulation.pixel.mix import AT_REST, Motion, PhotonMix
from cadtof_cli.simulation.pixel.waveforms import sampled_pair

PHOTONS_PER_LENGTH = 12.5
"""Number of photons over n_av if the number of cycles is not given: the paper's 50,000 photons at n_av 4000."""

FORGOTTEN_LENGTHS = 40.0
"""Photons that are older than this many n_av are not drawn, because their weights are smaller than rounding errors."""

CHUNK = 1 << 16
"""How many photons are drawn at once: their buffers stay in the processor's cache."""

MOST_PHOTONS = 10**9
"""Largest number of photons of a harmonic: their weights are held in memory, 16 bytes per photon."""


@dataclass(frozen=True, kw_only=True)
class PixelDefects:
    """What a real pixel does, besides averaging samples of the modulation.

    Attributes:
        sample_noise_v: noise of every sample, one standard deviation, such as kTC noise √(kT/C1).
    """

    jitter_ns: float = setting(0.0, "Timing jitter of the SPAD, one standard deviation.")
    sample_noise_v: float = setting(0.0, "Noise of every sample, one standard deviation.")
    gain_mismatch: float = setting(0.0, "Relative gain error of SC2: gain of SC2 over gain of SC1, minus 1.")
    offsets_v: tuple[float, float] = setting((0.0, 0.0), "Offsets of SC1 and SC2 in V.")

    def __post_init__(self) -> None:
        require(0 <= self.sample_noise_v <= 1e6, "sample noise", f"{self.sample_noise_v:g} V", "0 to 1e6 V")
        require(-1 <= self.gain_mismatch <= 1e6, "gain mismatch", self.gain_mismatch, "-1 to 1e6")
        require(
            all(abs(offset) <= 1e6 for offset in self.offsets_v), "offsets", self.offsets_v, "two voltages up to 1e6 V"
        )

    def require_jitter_below(self, period_ns: float, /) -> None:
        """Raise SettingsError if the jitter is not less than the shortest period."""
        expected = f"0 to less than {period_ns:g} ns"
        require(0 <= self.jitter_ns < period_ns, "jitter", f"{self.jitter_ns:g} ns", expected)

    def read_out(self, voltages_v: Float, /) -> Float:
        """Return averaged voltages, (..., 2), as the pixel reads them out: with gain mismatch and offsets."""
        return np.asarray(voltages_v * np.array([1.0, 1.0 + self.gain_mismatch]) + np.array(self.offsets_v))


IDEAL = PixelDefects()
"""A pixel without defects."""


@dataclass(frozen=True, kw_only=True)
class PixelModel(PixelDefects):
    """One pixel and how long it is exposed.

    Attributes:
        modulation: the voltages that the pixel samples.
        averaging: how the samples are averaged.
        motion: motion of the scene from harmonic to harmonic.
    """

    modulation: Modulation = field(default_factory=Modulation)
    averaging: Averaging
    photons_per_cycle: int = setting(5, "Photons per laser cycle; with --photons.")
    cycles: int | None = setting(
        None, "Laser cycles per harmonic; with --photons.  [default: as many as give 12.5 n_av photons]"
    )
    dead_time_ns: float = setting(0.0, "Dead time of the SPAD; with --photons.")
    motion: Motion = AT_REST

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.photons_per_cycle >= 1, "photons per cycle", self.photons_per_cycle, "1 or more")
        require(self.cycles is None or self.cycles >= 1, "cycles", self.cycles, "1 or more")
        period = self.modulation.periods_ns[0]
        require(
            0 <= self.dead_time_ns < period,
            "dead time",
            f"{self.dead_time_ns:g} ns",
            f"0 to less than one cycle of {period:g} ns",
        )
        self.require_jitter_below(min(self.modulation.periods_ns))
        if self.dead_time_ns > 0 and self.averaging.stages.drive == "switched":
            raise SettingsError("dead time: found with switched stages, expected --stages dc")

    @property
    def photons(self) -> int:
        """Photons that arrive while one harmonic is recorded."""
        if self.cycles is not None:
            return self.cycles * self.photons_per_cycle
        wanted = PHOTONS_PER_LENGTH * self.averaging.integration_length
        return math.ceil(wanted / self.photons_per_cycle) * self.photons_per_cycle

    @property
    def settles(self) -> bool:
        """Whether as many photons come as by default, so that less than 10⁻⁵ of the settled voltages is missing."""
        return self.photons >= PHOTONS_PER_LENGTH * self.averaging.integration_length

    @property
    def photon_rate_hz(self) -> float:
        """Mean rate of arrivals."""
        return self.photons_per_cycle / (self.modulation.periods_ns[0] * 1e-9)


def require_few_photons(model: PixelModel, /) -> None:
    """Raise a SettingsError if a harmonic has too many photons to simulate them one by one."""
    expected = f"{MOST_PHOTONS} or less: use a smaller integration length, or fewer --cycles or --photons-per-cycle"
    require(model.photons <= MOST_PHOTONS, "photons", f"{model.photons} in a harmonic", expected)


@lru_cache(maxsize=2)
def pixel_weights(model: PixelModel, /) -> Float32:
    """Return the weights of the photons that count, (2, n) float32, the latest photon last; they are the same in all runs.

    Too many photons to simulate one by one, or no photon that counts, raise a SettingsError.
    """
    require_few_photons(model)
    weights = model.averaging.weights(model.photons, photon_rate_hz=model.photon_rate_hz)
    if model.averaging.stages.drive == "dc":
        kept = math.ceil(FORGOTTEN_LENGTHS * model.averaging.integration_length)
        weights = weights[:, -min(kept, model.photons) :]
    return sealed(np.ascontiguousarray(weights, dtype=np.float32))


def _weights_of_sc1(model: PixelModel) -> Float:
    return np.asarray(pixel_weights(model)[0], np.float64)


def weight_sums(model: PixelModel, /) -> tuple[float, float]:
    """Return Σ w_i and Σ w_i² of the samples' weights w_i, in the settled average of Eq. (1) or in a switched cascade."""
    if model.averaging.stages.drive == "dc":
        return 1.0, averaging_gain(model.averaging.integration_length)
    weights = _weights_of_sc1(model)
    return float(weights.sum()), float((weights**2).sum())


def noise_length(model: PixelModel, /, *, counted: bool = False) -> float:
    """Return the integration length that describes the noise of the voltages relative to their mean, also of switched stages.

    `counted`: photons are simulated one by one. If so few come that the average does not settle, the length is less.
    """
    if model.averaging.stages.drive == "dc" and (model.settles or not counted):
        return model.averaging.integration_length
    return effective_length(_weights_of_sc1(model))


def seen_length(model: PixelModel, /) -> float:
    """Return the integration length at which photons alone have the noise of the pixel, sample noise included.

    `cadtof resolve` estimates this length from frames. A channel's variance is that of ambient light, A²/2, plus that of the
    sample noise, both over 2·n_av − 1.
    """
    length = noise_length(model)
    added = 2.0 * (model.sample_noise_v / model.modulation.amplitude_v) ** 2
    return length - (length - 0.5) * (added / (1.0 + added))


def record_pixel(model: PixelModel, mix: PhotonMix, generators: Sequence[np.random.Generator], /) -> Float:
    """Return the final voltages of one run, photon by photon, (H, 2), in V, without keeping the trace.

    The mix has no pixel axes. It has no jitter either: the jitter of the model is used. Each harmonic has its own generator,
    because the harmonics are recorded one after the other.
    """
    voltages, weights = np.empty((len(model.modulation.harmonics), 2)), pixel_weights(model)
    delays = model.motion.delays_ns(len(generators))
    for row, (harmonic, generator) in enumerate(zip(model.modulation.harmonics, generators, strict=True)):
        used, seen = weights, mix.later(delays[row])
        if model.dead_time_ns > 0:
            phases = detected_phases(model, seen, generator, harmonic)
            used = weights[:, -len(phases) :]
            sums = _weighted(model, phases[-used.shape[1] :].astype(np.float32), used)
        else:
            sums = _weighted_arrivals(model, seen.jittered(model.jitter_ns), used, generator, harmonic)
        noise = model.sample_noise_v * np.sqrt((used.astype(np.float64) ** 2).sum(axis=1))
        voltages[row] = model.modulation.amplitude_v * sums + noise * generator.standard_normal(2)
    return model.read_out(voltages)


def chunks(count: int, /) -> list[int]:
    """Return how many of so many photons are drawn at once, one number per chunk."""
    return [CHUNK] * (count // CHUNK) + ([count % CHUNK] if count % CHUNK else [])


def _weighted_arrivals(
    model: PixelModel, mix: PhotonMix, weights: Float32, generator: np.random.Generator, harmonic: int
) -> Float:
    """Return the weighted sums of the samples of SC1 and of SC2 in units of A, (2,), computed a chunk of photons at a time."""
    sums, start = np.zeros(2), 0
    for count in chunks(weights.shape[1]):
        phases = draw_phases(mix, generator, count=count, harmonic=harmonic)
        sums += _weighted(model, phases, weights[:, start : start + count])
        start += count
    return sums


def _weighted(model: PixelModel, phases: Float32, weights: Float32) -> Float:
    first, second = sampled_pair(model.modulation.waveform, phases)
    return np.array([weights[0] @ first, weights[1] @ second], dtype=np.float64)


def detected_phases(model: PixelModel, mix: PhotonMix, generator: np.random.Generator, harmonic: int, /) -> Float:
    """Return the phases of the harmonic at which a SPAD with dead time detects photons, (n,), in rad."""
    times = draw_detections(
        mix,
        generator,
        cycles=model.photons // model.photons_per_cycle,
        photons_per_cycle=model.photons_per_cycle,
        dead_time_ns=model.dead_time_ns,
        jitter_ns=model.jitter_ns,
    )
    return 2.0 * math.pi * harmonic / mix.period_ns * np.mod(times, mix.period_ns)
