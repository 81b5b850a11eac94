"""A camera with defects, for calibrating it: voltages straight from the sampled waveform, without any series or phasor.

What `calibration/` undoes is made here from its physical cause, so that neither can hide a mistake of the other: a photon
at time t samples the wave at its phase, the pulse smears it, and electronics add, scale and delay.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.units import C_M_PER_NS, FWHM_PER_SIGMA

_STEPS = 4096
_PULSE_NODES = 241


@dataclass(frozen=True, kw_only=True)
class Defects:
    """What is wrong with a camera. Per-pixel values are drawn once from `seed`.

    Attributes:
        offset_v: largest dark offset; offsets are uniform over ± this, one a pixel, harmonic and channel.
        hot_share: share of pixels with an offset far outside, and of as many that are noisy.
        phase_rad: delay of each harmonic's modulation, as a phase of that harmonic.
        gain: of each harmonic's channels.
        sc2_gain: of SC2 against SC1.
        pixel_phase_rad: standard deviation over the array of each pixel's own phase, one a harmonic.
        pixel_gain: standard deviation over the array of each pixel's own gain at harmonics other than the first.
        petzval_m: k2, k4 of the field curvature.
    """

    offset_v: float = 0.0
    hot_share: float = 0.0
    phase_rad: tuple[float, ...] = (0.0, 0.0)
    gain: tuple[float, ...] = (1.0, 1.0)
    sc2_gain: float = 1.0
    pixel_phase_rad: float = 0.0
    pixel_gain: float = 0.0
    petzval_m: tuple[float, float] = (0.0, 0.0)
    seed: int = 0


@dataclass(frozen=True, eq=False)
class PixelDefects:
    """The draw of one array: offsets (H, 2, Y, X) V, phases (H, Y, X) rad, gains (H, Y, X), hot and noisy pixels (Y, X)."""

    offset_v: Float
    phase_rad: Float
    gain: Float
    hot: Bool
    noisy: Bool


@dataclass(frozen=True, kw_only=True)
class DefectiveCamera:
    """A camera whose defects are known. Without a focal length in the metadata it cannot look at walls."""

    metadata: CaptureMetadata
    pixels: tuple[int, int] = (240, 320)
    defects: Defects = field(default_factory=Defects)
    bits: int = 14

    def drawn(self) -> PixelDefects:
        """Return what is fixed in the array."""
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
            shares: (P, Y, X), each path's photons over all, ambient light included; none is a covered lens.
            count: frames.
            seed: of the noise.
        """
        drawn, means, noise = self.drawn(), [], []
        modulation, n_av = self.metadata.modulation, self.metadata.pixel.integration_length
        assert n_av is not None
        delays = 2.0 / C_M_PER_NS * (ranges_m + self.curvature_m())
        for row, (h, period) in enumerate(zip(modulation.harmonics, modulation.periods_ns, strict=True)):
            theta = 2.0 * np.pi / period * delays + self.defects.phase_rad[row] + drawn.phase_rad[row]
            scale = modulation.amplitude_v * self.defects.gain[row] * drawn.gain[row]
            wave = smeared_wave(self.metadata, h)
            first = scale * (shares * wave(theta)).sum(axis=0)
            second = scale * self.defects.sc2_gain * (shares * wave(theta - 0.5 * np.pi)).sum(axis=0)
            means.append(np.stack([first, second]) + drawn.offset_v[row])
            power = 0.5 if modulation.waveform == "sine" else 1.0 / 3.0
            spread = scale * np.sqrt(power / (2.0 * n_av - 1.0)) * np.where(drawn.noisy, 12.0, 1.0)
            noise.append(np.stack([spread, self.defects.sc2_gain * spread]))
        mean, sigma = np.stack(means), np.stack(noise)
        rng = np.random.default_rng([self.defects.seed, 2, seed])
        voltage = self.metadata.voltage
        per_count = voltage.volts_per_count or 1.0
        frames = []
        for _ in range(count):
            volts = mean + sigma * rng.standard_normal(mean.shape)
            counts = np.rint(volts / per_count + voltage.zero_counts)
            frames.append(np.clip(counts, 0, 2**self.bits - 1).astype(np.uint16))
        return frames


def smeared_wave(metadata: CaptureMetadata, harmonic: int, /) -> Callable[[Float], Float]:
    """Return the wave that a pulse of the metadata's width samples, with the peak of a cosine at phase 0, in units of A."""
    period = metadata.modulation.periods_ns[0] / harmonic
    spread = 2.0 * np.pi / period * metadata.pulse.fwhm_ns / FWHM_PER_SIGMA
    nodes = np.linspace(-6.0, 6.0, _PULSE_NODES)
    weights = np.exp(-0.5 * nodes**2)
    weights /= weights.sum()
    phases = np.linspace(0.0, 2.0 * np.pi, _STEPS + 1)
    table = np.zeros_like(phases)
    for node, weight in zip(nodes, weights, strict=True):
        at = phases + spread * node
        if metadata.modulation.waveform == "sine":
            table += weight * np.cos(at)
        else:
            table += weight * (np.abs((at * 2.0 / np.pi) % 4.0 - 2.0) - 1.0)

    def wave(theta: Float) -> Float:
        return np.interp(theta % (2.0 * np.pi), phases, table)

    return wave


def qvga_metadata(metadata: CaptureMetadata | None = None, /) -> CaptureMetadata:
    """Return metadata of a 14-bit camera on top of what is given."""
    base = metadata or CaptureMetadata()
    return replace(base, voltage=Voltage(zero_counts=8192.0, volts_per_count=6.0e-5, saturated_counts=(0.0, 16383.0)))
