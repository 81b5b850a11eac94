"""A scene, recorded by a camera: the distribution of every pixel's voltages, made in bands of rows, and frames drawn from it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.simulation.pixel.averaging import averaging_gain
from cadtof_cli.simulation.pixel.mix import AT_REST, Motion, PhotonMix
from cadtof_cli.simulation.pixel.pixel import IDEAL, PixelDefects
from cadtof_cli.simulation.pixel.statistics import VoltageStatistics, draw_voltages, voltage_statistics
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.units import unambiguous_range_m

BAND_ROWS = 8
"""Number of rows of a band. It is fixed, so that results never depend on the number of processes that share the bands."""

_FRAME_KEY = 0


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """A recording: a scene, seen by a camera, with the modulation and averaging of the metadata.

    `seed` is that of everything random, in the array and in the frames. All of the scene moves from harmonic to
    harmonic, by `motion`; every frame shows it at the same place. All pixels have the same `defects`, besides those of
    their own that the camera has.
    """

    scene: Scene
    camera: Camera
    metadata: CaptureMetadata
    seed: int = 0
    motion: Motion = AT_REST
    defects: PixelDefects = IDEAL

    def __post_init__(self) -> None:
        require(self.seed >= 0, "seed", self.seed, "0 or more")
        self.defects.require_jitter_below(min(self.metadata.modulation.periods_ns))

    @property
    def told(self) -> CaptureMetadata:
        """The metadata for `capture.toml`. If samples have a noise of their own, they tell no integration length, which
        stands for the noise of photons alone."""
        return replace(self.metadata, pixel=Pixel()) if self.defects.sample_noise_v else self.metadata

    @property
    def integration_length(self) -> float:
        """n_av of Eq. (1), or of the harmonics' mean noise; raises SettingsError if the metadata have none."""
        length = self.metadata.pixel.mean_length
        if length is None:
            raise SettingsError("integration length: found none, expected a number above 1")
        return length


@dataclass(frozen=True)
class Band:
    """Distribution of the voltages of some rows, (H, 2 or 3, Y, X), and their truth by layer name, (Y, X) per layer."""

    voltages: VoltageStatistics
    truth: dict[str, Float]


def band_rows(height: int) -> tuple[slice, ...]:
    """Return the rows of each band, from top to bottom."""
    return tuple(slice(top, min(top + BAND_ROWS, height)) for top in range(0, height, BAND_ROWS))


def expose_band(exposure: Exposure, rows: slice, /) -> Band:
    """Return the voltages and the truth of one band.

    A scene that reaches beyond the unambiguous range, where its truth could not be resolved, raises a SettingsError.
    """
    modulation, camera = exposure.metadata.modulation, exposure.camera
    light = exposure.scene.light(camera, rows)
    truth = light.truth(modulation.amplitude_v)
    _check_range(truth["direct.depth"], unambiguous_range_m(modulation.periods_ns[0]))
    shift = camera.curvature_delay_ns(rows)
    if camera.fixed_delay_ns > 0:
        shift = shift + camera.fixed_delays_ns(exposure.seed)[rows]
    mix = PhotonMix(
        delays_ns=light.delays_ns + shift,
        photons=light.photons,
        ambient=light.ambient,
        period_ns=modulation.periods_ns[0],
        fwhm_ns=exposure.metadata.pulse.fwhm_ns,
    )
    given = exposure.metadata.pixel.integration_length
    lengths = given if isinstance(given, tuple) else (exposure.integration_length,)
    gain = np.array([averaging_gain(length) for length in lengths]).reshape(-1, 1, 1, 1)
    voltages = voltage_statistics(
        mix.jittered(exposure.defects.jitter_ns),
        modulation,
        variance_gain=gain,
        sample_noise_v=exposure.defects.sample_noise_v,
        motion=exposure.motion,
    )
    return Band(voltages, truth)


def expose_bands(exposure: Exposure, bands: Sequence[slice], /) -> list[Band]:
    """Return what `expose_band` returns for each of some bands."""
    return [expose_band(exposure, rows) for rows in bands]


def _check_range(depth_m: Float, limit_m: float) -> None:
    farthest = float(np.nanmax(depth_m, initial=0.0))
    if farthest >= limit_m:
        raise SettingsError(
            f"scene: found a direct path of {farthest:.3f} m, expected less than the unambiguous range of "
            f"{limit_m:.3f} m; bring the scene nearer or lengthen the modulation period"
        )


def joined(bands: list[Band], /) -> Band:
    """Return the whole frame from its bands, in order."""
    return Band(
        VoltageStatistics(
            np.concatenate([band.voltages.means_v for band in bands], axis=2),
            np.concatenate([band.voltages.covariances_v2 for band in bands], axis=2),
        ),
        {name: np.concatenate([band.truth[name] for band in bands]) for name in bands[0].truth},
    )


def frame_voltages(exposure: Exposure, whole: Band, index: int, /, *, offsets_v: Float | None = None) -> Float:
    """Return the voltages of one frame in V, (H, 2, Y, X), plus the dark offsets, which have the same shape.

    Frames are independent draws, because the average forgets its content between two read-outs. A frame depends only on the
    exposure's seed and on the frame's index.
    """
    generator = np.random.default_rng(np.random.SeedSequence(exposure.seed, spawn_key=(_FRAME_KEY, index)))
    voltages: Float = draw_voltages(whole.voltages, generator, draws=1)[0]
    if exposure.defects != IDEAL:
        channels_last = exposure.defects.read_out(np.moveaxis(voltages, 1, -1))
        voltages = np.ascontiguousarray(np.moveaxis(channels_last, -1, 1))
    return voltages if offsets_v is None else voltages + offsets_v
