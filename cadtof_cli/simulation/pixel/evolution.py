"""One recording of the fundamental, followed from photon to photon, as in the paper's Fig. 2."""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Waveform
from cadtof_cli.errors import SettingsError, require_memory_for_scipy
from cadtof_cli.simulation.pixel.arrivals import draw_phases
from cadtof_cli.simulation.pixel.mix import PhotonMix
from cadtof_cli.simulation.pixel.pixel import PixelModel, chunks, detected_phases, require_few_photons
from cadtof_cli.simulation.pixel.waveforms import sampled_pair

BINS = 128
"""Number of bins of the histogram of arrival times."""

MOST_ROWS = 1000
"""How many points in time are kept; a picture shows no more."""


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


def require_traceable(model: PixelModel, /) -> None:
    """Raise a SettingsError if no recording of the pixel can be followed from photon to photon.

    Then the stages are switched, or there are too many photons.
    """
    require_few_photons(model)
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
        phases = detected_phases(model, mix, generator, harmonic)
    else:
        jittered = mix.jittered(model.jitter_ns)
        drawn = [draw_phases(jittered, generator, count=n, harmonic=1) for n in chunks(model.photons)]
        phases = np.concatenate(drawn).astype(np.float64) * harmonic
    times = phases / (2.0 * math.pi * harmonic) * model.modulation.periods_ns[0]
    samples = model.modulation.amplitude_v * np.stack(sampled_pair(model.modulation.waveform, phases))
    samples += model.sample_noise_v * generator.standard_normal(samples.shape)
    step = 1.0 / model.averaging.integration_length
    require_memory_for_scipy()
    from scipy.signal import lfilter

    voltages = lfilter([step], [1.0, step - 1.0], samples, axis=1)
    return np.mod(times, model.modulation.periods_ns[0]), model.read_out(voltages.T).T


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
