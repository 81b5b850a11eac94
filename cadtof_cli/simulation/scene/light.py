"""The light on a band of a camera's pixels, with its truth, and the interface of a scene.

A scene returns the light of one band of rows at a time. No band depends on another, so any process can compute any band.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.errors import require
from cadtof_cli.simulation.pixel.mix import require_ratio
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.geometry import Bounce, Hits
from cadtof_cli.units import C_M_PER_NS


@dataclass(frozen=True)
class Light:
    """Light that reaches a band of pixels.

    Attributes:
        delays_ns: (P, Y, X), the direct path first; the other paths are MPI.
        photons: (P, Y, X), in a unit of the scene's own; a direct path without photons means that the pixel sees nothing.
        ambient: (Y, X), photons of ambient light in the same unit.
        ranges_m: (Y, X), range of the surface that each pixel sees, if the lamp is beside the camera; None if this range is half
            of the direct path.
    """

    delays_ns: Float
    photons: Float
    ambient: Float
    ranges_m: Float | None = None

    def truth(self, amplitude_v: float) -> dict[str, Float]:
        """Return what a perfect resolver would find, by layer name, (Y, X) per layer; NaN where there is no answer.

        `mpi.ratio` is MPI over direct photons, `mpi.delay` the mean delay of the MPI after the direct path in ns, and
        `mpi.depth` the range of a path with this mean delay.
        """
        direct, mpi = self.photons[0], self.photons[1:].sum(axis=0)
        seen, spread = direct > 0, (direct > 0) & (mpi > 0)
        later = self.delays_ns[1:] - self.delays_ns[0]
        delay = np.full_like(direct, np.nan)
        np.divide((self.photons[1:] * later).sum(axis=0), mpi, out=delay, where=spread)
        ratio = np.full_like(direct, np.nan)
        np.divide(mpi, direct, out=ratio, where=seen)
        total = np.where(direct + mpi + self.ambient > 0, direct + mpi + self.ambient, 1.0)
        arrival = np.where(seen, self.delays_ns[0], np.nan)
        ranges_m = arrival * C_M_PER_NS / 2.0 if self.ranges_m is None else np.where(seen, self.ranges_m, np.nan)
        return {
            "direct.depth": ranges_m,
            "direct.amplitude": amplitude_v * direct / total,
            "mpi.depth": (arrival + delay) * C_M_PER_NS / 2.0,
            "mpi.amplitude": amplitude_v * mpi / total,
            "mpi.ratio": ratio,
            "mpi.delay": delay,
        }


class Scene(Protocol):
    """What a camera can look at."""

    @property
    def summary(self) -> str:
        """One sentence about the scene, for the comments of `capture.toml`."""
        ...

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return the light on the given rows of the camera."""
        ...


def light_from_bounces(seen: Hits, bounces: tuple[Bounce, ...], albedo: float, distance_m: float, asr: float) -> Light:
    """Return light from geometry. Its unit is the photons of a surface with this albedo that faces the light at this distance."""
    ranges_m = np.nan_to_num(seen.ranges_m)
    unit = distance_m**2 * seen.albedo / albedo
    ways_m = [ranges_m[None] * 2.0, *(bounce.lengths_m + ranges_m for bounce in bounces)]
    photons = [seen.irradiance[None], *(bounce.irradiance for bounce in bounces)]
    return Light(
        delays_ns=np.concatenate(ways_m) / C_M_PER_NS,
        photons=np.concatenate(photons) * unit,
        ambient=np.where(seen.surface < 0, 1.0, asr * seen.albedo / albedo),
    )


def check_common(distance_m: float, albedo: float, asr: float) -> None:
    """Raise SettingsError for a distance, albedo or ASR that is impossible in every scene."""
    require(0.01 <= distance_m <= 1e9, "distance", f"{distance_m:g} m", "0.01 to 1e9 m")
    require(0 < albedo <= 1, "albedo", f"{albedo:g}", "above 0, at most 1")
    require_ratio(asr, "ASR", f"{asr:g}")
