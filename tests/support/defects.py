"""A camera with defects, for calibrating it: voltages straight from the sampled waveform, without any series or phasor.

The defects that `calibration/` corrects are made here from their physical causes, so that neither can hide a mistake of
the other. A photon at time t samples the wave at its phase, the pulse smears it, and electronics add, scale and delay.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage, Waveform
from cadtof_cli.units import C_M_PER_NS, FWHM_PER_SIGMA

Moment = Literal["SC1", "SC2", "SC1²", "SC2²", "SC1·SC2"]

_STEPS = 4096
_PULSE_NODES = 241


@dataclass(frozen=True, kw_only=True)
class Defects:
    """The defects of a camera. Per-pixel values are drawn once, from `seed`.

    Attributes:
        offset_v: largest dark offset; offsets are uniform over ± this, one per pixel, harmonic and channel.
        hot_share: share of pixels with an offset far outside; as large a share of other pixels is noisy.
        phase_rad: delay of each harmonic's modulation, as a phase of that harmonic.
        gain: gain of both channels, per harmonic.
        sc2_gain: gain of SC2 over that of SC1.
        pixel_phase_rad: standard deviation over the array of each pixel's own phase, one per harmonic.
        pixel_gain: standard deviation over the array of each pixel's own gain at harmonics other than the first.
        petzval_m: k2, k4 of the field curvature.
    """

    offset_v: float = 0.0
    hot_share: float = 0.0
    phase_rad: tuple[float, ...] = (0.0, 0.0, 0.0)
    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    sc2_gain: float = 1.0
    pixel_phase_rad: float = 0.0
    pixel_gain: float = 0.0
    petzval_m: tuple[float, float] = (0.0, 0.0)
    seed: int = 0


@dataclass(frozen=True, eq=False)
class PixelDefects:
    """Defects of an array: offsets (H, 2, Y, X) V, phases (H, Y, X) rad, gains (H, Y, X), hot, noisy pixels (Y, X)."""

    offset_v: Float
    phase_rad: Float
    gain: Float
    hot: Bool
    noisy: Bool


@dataclass(frozen=True, kw_only=True)
class DefectiveCamera:
    """A camera with known defects. Without a focal length in the metadata it cannot look at walls."""

    metadata: CaptureMetadata
    pixels: tuple[int, int] = (240, 320)
    defects: Defects = field(default_factory=Defects)
    bits: int = 14

    def drawn(self) -> PixelDefects:
        """Return the defects that are fixed in the array."""
        rng = np.random.default_rng([self.defects.seed, 1])
        harmonics = len(self.metadata.modulation.harmonics)
        defects, shape = self.defects, self.pixels
        offset = defects.offset_v * rng.uniform(-1.0, 1.0, (harmonics, 2, *shape))
        phase = defects.pixel_phase_rad * rng.standard_normal((harmonics, *shape))
        gain = 1.0 + defects.pixel_gain * rng.standard_normal((harmonics, *shape))
        gain[0] = 1.0
        lot = rng.random(shape)
        hot, noisy = lot < defects.hot_share, (lot >= defects.hot_share) & (lot < 2 * defects.hot_share)
        offset[:, :, hot] += 0.25
        return PixelDefects(offset, phase, gain, hot, noisy)

    def curvature_m(self) -> Float:
        """Return k2 ρ² + k4 ρ⁴ of every pixel in m, (Y, X)."""
        height, width = self.pixels
        column, row = self.metadata.optics.principal_point_px or ((width - 1) / 2, (height - 1) / 2)
        y, x = np.mgrid[:height, :width]
        rho = np.hypot(x - column, y - row) / (0.5 * np.hypot(height, width))
        k2, k4 = self.defects.petzval_m
        return np.asarray(k2 * rho**2 + k4 * rho**4)

    def wall_range_m(self, distance_m: float, tilt_deg: tuple[float, float] = (0.0, 0.0)) -> Float:
        """Return the true range of a plane through (0, 0, distance), turned by the tilts, by intersecting rays, (Y, X)."""
        optics, (height, width) = self.metadata.optics, self.pixels
        assert optics.focal_length_px is not None
        column, row = optics.principal_point_px or ((width - 1) / 2, (height - 1) / 2)
        y, x = np.mgrid[:height, :width]
        rays = np.stack(
            [(x - column) / optics.focal_length_px, (y - row) / optics.focal_length_px, np.ones(self.pixels)]
        )
        right, down = np.radians(tilt_deg)
        normal = np.array([np.tan(right), np.tan(down), 1.0])
        times = distance_m / np.tensordot(normal, rays, axes=1)
        return np.asarray(times * np.linalg.norm(rays, axis=0))

    def frames(self, ranges_m: Float, shares: Float, /, *, count: int, seed: int) -> list[np.ndarray]:
        """Return `count` frames of uint16 counts, (H, 2, Y, X), of paths with these true ranges and shares of all photons.

        Args:
            ranges_m: (P, Y, X).
            shares: (P, Y, X), each path's photons over all photons, ambient light included; all 0: a covered lens.
            count: number of frames.
            seed: seed of the noise.
        """
        drawn = self.drawn()
        modulation, voltage = self.metadata.modulation, self.metadata.voltage
        delays = 2.0 / C_M_PER_NS * (ranges_m + self.curvature_m())
        harmonics = []
        for row, period in enumerate(modulation.periods_ns):
            theta = 2.0 * np.pi / period * delays + self.defects.phase_rad[row] + drawn.phase_rad[row]
            scale = modulation.amplitude_v * self.defects.gain[row] * drawn.gain[row]
            gains = np.stack([scale, self.defects.sc2_gain * scale])
            harmonics.append((self._sampled(row, theta, shares), gains))
        rng = np.random.default_rng([self.defects.seed, 2, seed])
        noisy = np.where(drawn.noisy, 12.0, 1.0)
        frames = []
        for _ in range(count):
            planes = []
            for row, (sampled, gains) in enumerate(harmonics):
                first, second = rng.standard_normal((2, *self.pixels)) * noisy
                drawn_noise = np.stack([sampled.first * first, sampled.slope * first + sampled.rest * second])
                planes.append(gains * (sampled.means + drawn_noise) + drawn.offset_v[row])
            counts = np.rint(np.stack(planes) / (voltage.volts_per_count or 1.0) + voltage.zero)
            frames.append(np.clip(counts, 0, 2**self.bits - 1).astype(np.uint16))
        return frames

    def _sampled(self, row: int, theta: Float, shares: Float) -> "_Sampled":
        """Return mean and noise of the average of samples; both follow from the samples' first and second moments."""
        n_av = self.metadata.pixel.mean_length
        assert n_av is not None
        harmonic = self.metadata.modulation.harmonics[row]
        ambient = 1.0 - shares.sum(axis=0)

        def mean(moment: Moment) -> Float:
            """Average over the light of all paths and over ambient light, which comes at all phases equally."""
            answer = smeared(self.metadata, harmonic, moment)
            anywhere = answer(np.linspace(0.0, 2.0 * np.pi, _STEPS, endpoint=False)).mean()
            return np.asarray((shares * answer(theta)).sum(axis=0) + ambient * anywhere)

        first, second = mean("SC1"), mean("SC2")
        variance = mean("SC1²") - first**2
        covariance = mean("SC1·SC2") - first * second
        other = mean("SC2²") - second**2
        spread = np.sqrt(variance)
        slope = covariance / spread
        rest = np.sqrt(np.maximum(other - slope**2, 0.0))
        gain = 1.0 / np.sqrt(2.0 * n_av - 1.0)
        return _Sampled(np.stack([first, second]), gain * spread, gain * slope, gain * rest)


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Means of SC1 and SC2, (2, Y, X), and their noise.

    The noise of SC1 is `first` times a draw; that of SC2 is `slope` times the same draw plus `rest` times another draw.
    """

    means: Float
    first: Float
    slope: Float
    rest: Float


_waves: Mapping[Waveform, Callable[[Float], Float]] = {
    "sine": np.cos,
    "triangle": lambda at: np.abs((at * 2.0 / np.pi) % 4.0 - 2.0) - 1.0,
}
"""Sample of a photon by its phase, in units of the amplitude; the wave has its peak at phase 0, as a cosine has."""


_moments: Mapping[Moment, Callable[[Float, Float], Float]] = {
    "SC1": lambda first, _: first,
    "SC2": lambda _, second: second,
    "SC1²": lambda first, _: first**2,
    "SC2²": lambda _, second: second**2,
    "SC1·SC2": lambda first, second: first * second,
}


@lru_cache(maxsize=64)
def smeared(metadata: CaptureMetadata, harmonic: int, moment: Moment, /) -> Callable[[Float], Float]:
    """Return a moment of the samples as a function of the phase at which the pulse arrives, averaged over the pulse."""
    wave = _waves[metadata.modulation.waveform]
    period = metadata.modulation.periods_ns[0] / harmonic
    spread = 2.0 * np.pi / period * metadata.pulse.fwhm_ns / FWHM_PER_SIGMA
    nodes = np.linspace(-6.0, 6.0, _PULSE_NODES)
    weights = np.exp(-0.5 * nodes**2)
    weights /= weights.sum()
    phases = np.linspace(0.0, 2.0 * np.pi, _STEPS + 1)
    table = np.zeros_like(phases)
    for node, weight in zip(nodes, weights, strict=True):
        at = phases + spread * node
        table += weight * _moments[moment](wave(at), wave(at - 0.5 * np.pi))
    return lambda theta: np.interp(theta % (2.0 * np.pi), phases, table)


def qvga_metadata(metadata: CaptureMetadata | None = None, /) -> CaptureMetadata:
    """Return metadata of a 14-bit camera on top of what is given."""
    base = metadata or CaptureMetadata()
    return replace(base, voltage=Voltage(zero_counts=8192.0, volts_per_count=6.0e-5, saturated_counts=(0.0, 16383.0)))
