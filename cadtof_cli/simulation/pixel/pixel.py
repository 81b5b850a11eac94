"""The pixel, photon by photon: each photon samples the modulation when it arrives, and the samples are averaged.

A single recording can be followed from photon to photon, as in the paper's Fig. 2.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.capture.metadata import Modulation, Waveform
from cadtof_cli.errors import SettingsError, require, require_memory_for_scipy
from cadtof_cli.records import setting
from cadtof_cli.simulation.pixel.arrivals import draw_detections, draw_phases
from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.mix import AT_REST, Motion, PhotonMix
from cadtof_cli.simulation.pixel.waveforms import sampled_pair

PHOTONS_PER_LENGTH = 12.5
"""Number of photons over n_av if the number of cycles is not given: the paper's 50,000 photons at n_av 4000."""

FORGOTTEN_LENGTHS = 40.0
"""Photons that are older than this many n_av are not drawn, because their weights are smaller than rounding errors."""

BINS = 128
"""Number of bins of the histogram of arrival times in an evolution."""

MOST_ROWS = 1000
"""How many points in time of an evolution are kept; a picture shows no more."""

CHUNK = 1 << 16
"""How many photons are drawn at once: their buffers stay in the processor's cache."""

MOST_PHOTONS = 10**9
"""Largest number of photons of a harmonic: their weights are held in memory, 16 bytes per photon."""


@dataclass(frozen=True, kw_only=True)
class PixelModel:
    """One pixel and how long it is exposed.

    Attributes:
        modulation: the voltages that the pixel samples.
        averaging: how the samples are averaged.
        sample_noise_v: noise of every sample, one standard deviation, such as kTC noise √(kT/C1).
        motion: motion of the scene from harmonic to harmonic.
    """

    modulation: Modulation = field(default_factory=Modulation)
    averaging: Averaging
    photons_per_cycle: int = setting(5, "Photons per laser cycle; with --photons.")
    cycles: int | None = setting(
        None, "Laser cycles per harmonic; with --photons.  [default: as many as give 12.5 n_av photons]"
    )
    dead_time_ns: float = setting(0.0, "Dead time of the SPAD; with --photons.")
    jitter_ns: float = setting(0.0, "Timing jitter of the SPAD, one standard deviation.")
    sample_noise_v: float = setting(0.0, "Noise of every sample, one standard deviation.")
    gain_mismatch: float = setting(0.0, "Relative gain error of SC2: gain of SC2 over gain of SC1, minus 1.")
    offsets_v: tuple[float, float] = setting((0.0, 0.0), "Offsets of SC1 and SC2 in V.")
    motion: Motion = AT_REST

    def __post_init__(self) -> None:
        require(self.photons_per_cycle >= 1, "photons per cycle", self.photons_per_cycle, "1 or more")
        require(self.cycles is None or self.cycles >= 1, "cycles", self.cycles, "1 or more")
        period = self.modulation.periods_ns[0]
        require(
            0 <= self.dead_time_ns < period,
            "dead time",
            f"{self.dead_time_ns:g} ns",
            f"0 to less than one cycle of {period:g} ns",
        )
        shortest = min(self.modulation.periods_ns)
        require(0 <= self.jitter_ns < shortest, "jitter", f"{self.jitter_ns:g} ns", f"0 to less than {shortest:g} ns")
        require(0 <= self.sample_noise_v <= 1e6, "sample noise", f"{self.sample_noise_v:g} V", "0 to 1e6 V")
        require(-1 <= self.gain_mismatch <= 1e6, "gain mismatch", self.gain_mismatch, "-1 to 1e6")
        require(
            all(abs(offset) <= 1e6 for offset in self.offsets_v), "offsets", self.offsets_v, "two voltages up to 1e6 V"
        )
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


def _require_few_photons(model: PixelModel) -> None:
    expected = f"{MOST_PHOTONS} or less: use a smaller integration length, or fewer --cycles or --photons-per-cycle"
    require(model.photons <= MOST_PHOTONS, "photons", f"{model.photons} in a harmonic", expected)


def pixel_weights(model: PixelModel, /) -> Float32:
    """Return the weights of the photons that count, (2, n) float32, the latest photon last; they are the same in all runs.

    Too many photons to simulate one by one, or no photon that counts, raise a SettingsError.
    """
    _require_few_photons(model)
    weights = model.averaging.weights(model.photons, photon_rate_hz=model.photon_rate_hz)
    if model.averaging.stages.drive == "dc":
        kept = math.ceil(FORGOTTEN_LENGTHS * model.averaging.integration_length)
        weights = weights[:, -min(kept, model.photons) :]
    return np.ascontiguousarray(weights, dtype=np.float32)


def record_pixel(
    model: PixelModel, mix: PhotonMix, weights: Float32, generators: list[np.random.Generator], /
) -> Float:
    """Return the final voltages of one run, (H, 2), in V, without keeping the trace; the weights are `pixel_weights`.

    The mix has no pixel axes. It has no jitter either: the jitter of the model is used. Each harmonic has its own generator,
    because the harmonics are recorded one after the other.
    """
    voltages = np.empty((len(model.modulation.harmonics), 2))
    delays = model.motion.delays_ns(len(generators))
    for row, (harmonic, generator) in enumerate(zip(model.modulation.harmonics, generators, strict=True)):
        used, seen = weights, mix.later(delays[row])
        if model.dead_time_ns > 0:
            phases = _detected_phases(model, seen, generator, harmonic)
            used = weights[:, -len(phases) :]
            sums = _weighted(model, phases[-used.shape[1] :].astype(np.float32), used)
        else:
            sums = _weighted_arrivals(model, seen.jittered(model.jitter_ns), used, generator, harmonic)
        noise = model.sample_noise_v * np.sqrt((used.astype(np.float64) ** 2).sum(axis=1))
        voltages[row] = _read_out(model, model.modulation.amplitude_v * sums + noise * generator.standard_normal(2))
    return voltages


def require_traceable(model: PixelModel, /) -> None:
    """Raise a SettingsError if no recording of the pixel can be followed from photon to photon.

    Then the stages are switched, or there are too many photons.
    """
    _require_few_photons(model)
    if model.averaging.stages.drive == "switched":
        raise SettingsError("stages: found switched stages, expected --stages dc for the evolution of voltages")


def trace_pixel(
    model: PixelModel, mix: PhotonMix, generator: np.random.Generator, /, *, harmonic: int
) -> tuple[Float, Float]:
    """Return one recording photon by photon, from 0 V on, for averaging by Eq. (1), with the stages closed (`dc`).

    The first array has the arrival time of each photon within the period of the fundamental, in ns, (n,). The second
    array has SC1 and SC2 after each photon, in V, (2, n). See `require_traceable` for what raises a SettingsError.
    """
    require_traceable(model)
    if model.dead_time_ns > 0:
        phases = _detected_phases(model, mix, generator, harmonic)
    else:
        jittered = mix.jittered(model.jitter_ns)
        drawn = [draw_phases(jittered, generator, count=n, harmonic=1) for n in _chunks(model.photons)]
        phases = np.concatenate(drawn).astype(np.float64) * harmonic
    times = phases / (2.0 * math.pi * harmonic) * model.modulation.periods_ns[0]
    samples = model.modulation.amplitude_v * np.stack(sampled_pair(model.modulation.waveform, phases))
    samples += model.sample_noise_v * generator.standard_normal(samples.shape)
    step = 1.0 / model.averaging.integration_length
    require_memory_for_scipy()
    from scipy.signal import lfilter

    voltages = lfilter([step], [1.0, step - 1.0], samples, axis=1)
    return np.mod(times, model.modulation.periods_ns[0]), _read_out(model, voltages)


def _chunks(count: int) -> list[int]:
    return [CHUNK] * (count // CHUNK) + ([count % CHUNK] if count % CHUNK else [])


def _weighted_arrivals(
    model: PixelModel, mix: PhotonMix, weights: Float32, generator: np.random.Generator, harmonic: int
) -> Float:
    """Return the weighted sums of the samples of SC1 and of SC2 in units of A, (2,), computed a chunk of photons at a time."""
    sums, start = np.zeros(2), 0
    for count in _chunks(weights.shape[1]):
        phases = draw_phases(mix, generator, count=count, harmonic=harmonic)
        sums += _weighted(model, phases, weights[:, start : start + count])
        start += count
    return sums


def _weighted(model: PixelModel, phases: Float32, weights: Float32) -> Float:
    first, second = sampled_pair(model.modulation.waveform, phases)
    return np.array([weights[0] @ first, weights[1] @ second], dtype=np.float64)


def _detected_phases(model: PixelModel, mix: PhotonMix, generator: np.random.Generator, harmonic: int) -> Float:
    times = draw_detections(
        mix,
        generator,
        cycles=model.photons // model.photons_per_cycle,
        photons_per_cycle=model.photons_per_cycle,
        dead_time_ns=model.dead_time_ns,
        jitter_ns=model.jitter_ns,
    )
    return 2.0 * math.pi * harmonic / mix.period_ns * np.mod(times, mix.period_ns)


def _read_out(model: PixelModel, voltages_v: Float) -> Float:
    """Apply gain mismatch and offsets to voltages (2, ...)."""
    shape = (2, *[1] * (voltages_v.ndim - 1))
    gain = np.array([1.0, 1.0 + model.gain_mismatch]).reshape(shape)
    return np.asarray(gain * voltages_v + np.array(model.offsets_v).reshape(shape))


@dataclass(frozen=True)
class Evolution:
    """One recording of the fundamental.

    Attributes:
        bin_ns: (BINS,), middle of each bin of the histogram.
        counts: (BINS,), photons in each bin.
        photons: (n,), numbers of photons sampled so far, evenly thinned.
        voltages_v: (2, n), SC1 and SC2 after each of these numbers of photons.
        period_ns: period of the modulation, which is the range of the histogram.
        waveform: waveform of the modulation.
    """

    bin_ns: Float
    counts: Float
    photons: Float
    voltages_v: Float
    period_ns: float
    waveform: Waveform

    @property
    def phase_deg(self) -> Float:
        """Phase of the voltages, 0° to 360°, (n,)."""
        return np.asarray(np.degrees(np.arctan2(self.voltages_v[1], self.voltages_v[0])) % 360.0)

    @property
    def settled_phase_deg(self) -> float:
        """Phase of the mean voltages over the later half, when the average has settled."""
        half = self.voltages_v.shape[1] // 2
        first, second = self.voltages_v[:, half:].mean(axis=1)
        return math.degrees(math.atan2(second, first)) % 360.0


def evolution(model: PixelModel, mix: PhotonMix, generator: np.random.Generator, /) -> Evolution:
    """Record the fundamental once, photon by photon, and return the data that a picture needs."""
    seen = mix.later(model.motion.delays_ns(len(model.modulation.harmonics))[0])
    times_ns, voltages_v = trace_pixel(model, seen, generator, harmonic=1)
    period = model.modulation.periods_ns[0]
    counts, _ = np.histogram(times_ns, bins=BINS, range=(0.0, period))
    middles = np.linspace(0.5, BINS - 0.5, BINS) * (period / BINS)
    count = voltages_v.shape[1]
    kept = np.unique(np.linspace(0, count - 1, min(count, MOST_ROWS)).astype(np.intp))
    photons = (kept + 1).astype(np.float64)
    waveform = model.modulation.waveform
    return Evolution(middles, counts.astype(np.float64), photons, voltages_v[:, kept], period, waveform)
