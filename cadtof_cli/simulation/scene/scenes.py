"""The registry of scenes, and four of them: wall, two-path card, corner (Fig. 5 of the paper), inter-reflection (Fig. 4)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cadtof_cli.errors import require
from cadtof_cli.simulation.pixel.mix import require_ratio
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.geometry import (
    Bounce,
    Surface,
    bounce_by_directions,
    bounce_by_patches,
    hits,
    spread_over,
)
from cadtof_cli.simulation.scene.light import Light, check_common, light_from_bounces
from cadtof_cli.simulation.scene.rooms.cornell import CornellBox
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.units import C_M_PER_NS

_WALL_ALBEDO, _PANEL_ALBEDO = 0.6, 0.8
"""Albedos of the wall and of the panel. They are no settings, because they change nothing: a surface reflects laser light, MPI
and ambient light alike, and the ratios of these three are settings."""


@dataclass(frozen=True, kw_only=True)
class Wall:
    """A diffuse wall without MPI, as for calibration.

    Attributes:
        distance_m: distance along the optical axis; without a tilt it is the perpendicular distance.
        tilt_deg: how far the wall is turned to the right and down from facing the camera.
        asr: ratio of ambient to direct photons for a wall that faces the light at this distance.
    """

    distance_m: float = 3.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    asr: float = 2.0

    def __post_init__(self) -> None:
        check_common(self.distance_m, _WALL_ALBEDO, self.asr)
        require(all(abs(tilt) < 60 for tilt in self.tilt_deg), "tilt", self.tilt_deg, "angles below 60°")

    @property
    def summary(self) -> str:
        """One sentence about the scene."""
        return f"wall at {self.distance_m:g} m, tilted by {self.tilt_deg[0]:g}° and {self.tilt_deg[1]:g}°"

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return one path per pixel: range D √(1 + X² + Y²)/(1 + αX + βY), with α, β the tangents of the tilt."""
        right, down = (math.radians(tilt) for tilt in self.tilt_deg)
        across, along = _unit(1.0, 0.0, -math.tan(right)), _unit(0.0, 1.0, -math.tan(down))
        normal = np.cross(across, along)
        x, y, z = np.cross(normal / np.linalg.norm(normal), across).tolist()
        middle = (0.0, 0.0, self.distance_m)
        wall = Surface(origin_m=middle, across=across, along=(x, y, z), albedo=_WALL_ALBEDO)
        return light_from_bounces(hits((wall,), camera.rays(rows)), (), _WALL_ALBEDO, self.distance_m, self.asr)


@dataclass(frozen=True, kw_only=True)
class Card:
    """The test card: two ideal paths. Their separation grows from left to right, the MPI ratio from top to bottom.

    Attributes:
        distance_m: range of the direct path, the same in all pixels.
        separations_ns: delay of the second path after the direct path, in the first and in the last column.
        mpi_ratios: ratio of MPI to direct photons, in the first row with MPI and in the last row.
        clean_share: share of rows without MPI; they are at the top.
        asr: ratio of ambient to direct photons in all pixels.
    """

    distance_m: float = 0.75
    separations_ns: tuple[float, float] = (3.0, 20.0)
    mpi_ratios: tuple[float, float] = (0.05, 0.6)
    clean_share: float = 1.0 / 6.0
    asr: float = 2.0

    def __post_init__(self) -> None:
        check_common(self.distance_m, 1.0, self.asr)
        require(all(0 <= s < math.inf for s in self.separations_ns), "separations", self.separations_ns, "≥ 0 ns")
        for ratio in self.mpi_ratios:
            require_ratio(ratio, "MPI ratios", f"{ratio:g}")

    @property
    def summary(self) -> str:
        """One sentence about the scene."""
        near, far = self.separations_ns
        low, high = self.mpi_ratios
        return (
            f"two ideal paths, direct at {self.distance_m:g} m, MPI {near:g} to {far:g} ns later across; "
            f"MPI/direct 0 in the top rows, then {low:g} to {high:g} down"
        )

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return two paths per pixel."""
        row, column = np.meshgrid(np.arange(camera.height)[rows], np.arange(camera.width), indexing="ij")
        clean = round(self.clean_share * camera.height)
        down = (row - clean) / max(camera.height - 1 - clean, 1)
        ratio = np.where(row < clean, 0.0, self.mpi_ratios[0] + (self.mpi_ratios[1] - self.mpi_ratios[0]) * down)
        across = column / max(camera.width - 1, 1)
        separation = self.separations_ns[0] + (self.separations_ns[1] - self.separations_ns[0]) * across
        direct = np.full(row.shape, 2.0 * self.distance_m / C_M_PER_NS)
        return Light(
            delays_ns=np.stack([direct, direct + separation]),
            photons=np.stack([np.ones_like(ratio), ratio]),
            ambient=np.full(row.shape, self.asr),
        )


@dataclass(frozen=True, kw_only=True)
class Corner:
    """The corner of Fig. 5: two diffuse planes that meet in an upright edge, which is the far end of the scene.

    The light of one bounce is integrated over the other plane, so the MPI of a pixel is a distribution of delays. These delays
    shrink to 0 towards the edge. MPI is always later than the direct light.

    Attributes:
        distance_m: distance of the edge.
        opening_deg: angle between the planes.
        extents_m: width and height of each plane.
        albedo: albedo of both planes.
        asr: ratio of ambient to direct photons for a plane that faces the light at this distance.
        directions: number of directions into which a pixel's hemisphere is divided.
    """

    distance_m: float = 2.0
    opening_deg: float = 90.0
    extents_m: tuple[float, float] = (1.4, 2.0)
    albedo: float = 0.8
    asr: float = 2.0
    directions: int = 300

    def __post_init__(self) -> None:
        check_common(self.distance_m, self.albedo, self.asr)
        require(10 <= self.opening_deg < 180, "opening", f"{self.opening_deg:g}°", "10° to below 180°")
        require(all(extent > 0 for extent in self.extents_m), "extents", self.extents_m, "lengths above 0 m")
        require(1 <= self.directions <= 10_000, "directions", self.directions, "1 to 10000")

    @property
    def summary(self) -> str:
        """One sentence about the scene."""
        return (
            f"corner of two diffuse planes at {self.opening_deg:g}°, edge at {self.distance_m:g} m, "
            f"albedo {self.albedo:g}; MPI is the light of one bounce"
        )

    def surfaces(self) -> tuple[Surface, Surface]:
        """Return the left and the right plane."""
        half = math.radians(self.opening_deg / 2.0)
        width, height = self.extents_m
        left, right = (
            Surface(
                origin_m=(0.0, 0.0, self.distance_m),
                across=(side * math.sin(half), 0.0, -math.cos(half)),
                along=(0.0, 1.0, 0.0),
                extents_m=(0.0, width, -height / 2.0, height / 2.0),
                albedo=self.albedo,
            )
            for side in (-1.0, 1.0)
        )
        return left, right

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return the direct path and one path for each direction; a direction that misses the other plane carries no light."""
        left, right = self.surfaces()
        seen = hits((left, right), camera.rays(rows))
        bounces = {
            index: bounce_by_directions(seen.of_surface(index), other, count=self.directions)
            for index, other in ((0, right), (1, left))
        }
        bounced = spread_over(seen, bounces, ways=self.directions)
        return light_from_bounces(seen, (bounced,), self.albedo, self.distance_m, self.asr)


_PATCHES = 6
"""Number of patches along each side of the reflector; light comes by way of every patch."""


@dataclass(frozen=True, kw_only=True)
class InterReflection:
    """The inter-reflection of Fig. 4: a panel in front of a wall, and a second reflector out of sight at its side.

    The reflector's light comes to the panel about 24 ns after the direct light. That is more than half the period, so the panel
    looks nearer, as the paper measured. The strength of this light at the middle of the panel is a setting: it depends on how
    glossy the reflector was, which is not in the paper. Where the light falls, and how late it comes, follows from the geometry.

    Attributes:
        distance_m: perpendicular distance of the panel.
        wall_m: perpendicular distance of the wall behind the panel.
        panel_m: width and height of the panel.
        mpi_ratio: ratio of MPI to direct photons at the middle of the panel; 0 removes the reflector.
        reflector_m: distance of the reflector to the side.
        asr: ratio of ambient to direct photons for a panel that faces the light at this distance.
    """

    distance_m: float = 3.35
    wall_m: float = 4.2
    panel_m: tuple[float, float] = (1.5, 1.8)
    mpi_ratio: float = 0.033
    reflector_m: float = 5.0
    asr: float = 2.0

    def __post_init__(self) -> None:
        check_common(self.distance_m, _PANEL_ALBEDO, self.asr)
        require(self.wall_m > self.distance_m, "wall", f"{self.wall_m:g} m", f"more than {self.distance_m:g} m")
        require_ratio(self.mpi_ratio, "MPI ratio", f"{self.mpi_ratio:g}")
        require(all(extent > 0 for extent in self.panel_m), "panel", self.panel_m, "lengths above 0 m")
        require(0.5 <= self.reflector_m < math.inf, "reflector", f"{self.reflector_m:g} m", "0.5 m or more")

    @property
    def summary(self) -> str:
        """One sentence about the scene."""
        return (
            f"panel at {self.distance_m:g} m before a wall at {self.wall_m:g} m; light of a reflector "
            f"{self.reflector_m:g} m to the side with MPI/direct {self.mpi_ratio:g} at the middle of the panel"
        )

    def surfaces(self) -> tuple[Surface, Surface, Surface]:
        """Return the panel, the wall behind it, and the reflector at the side."""
        width, height = self.panel_m
        right, down = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        panel = Surface(
            origin_m=(0.0, 0.0, self.distance_m),
            extents_m=(-width / 2.0, width / 2.0, -height / 2.0, height / 2.0),
            albedo=_PANEL_ALBEDO,
            across=right,
            along=down,
        )
        wall = Surface(origin_m=(0.0, 0.0, self.wall_m), across=right, along=down, albedo=_PANEL_ALBEDO / 2.0)
        reflector = Surface(
            origin_m=(self.reflector_m, 0.0, 0.45 * self.distance_m),
            across=(0.0, 0.0, 1.0),
            along=(0.0, 1.0, 0.0),
            extents_m=(-0.75, 0.75, -0.75, 0.75),
        )
        return panel, wall, reflector

    def light(self, camera: Camera, rows: slice, /) -> Light:
        """Return the direct path and, for the pixels of the panel, one path for each patch of the reflector."""
        panel, wall, reflector = self.surfaces()
        seen = hits((panel, wall), camera.rays(rows))
        middle = hits((panel,), np.array([0.0, 0.0, 1.0]).reshape(3, 1, 1))
        there = bounce_by_patches(middle, reflector, count=_PATCHES)
        gain = self.mpi_ratio * float(middle.irradiance[0, 0]) / float(there.irradiance.sum())
        bounced = bounce_by_patches(seen.of_surface(0), reflector, count=_PATCHES)
        scaled = spread_over(seen, {0: Bounce(gain * bounced.irradiance, bounced.lengths_m)}, ways=_PATCHES**2)
        return light_from_bounces(seen, (scaled,), _PANEL_ALBEDO, self.distance_m, self.asr)


SCENES: Mapping[str, type[Wall | Card | Corner | InterReflection | RandomRoom | CornellBox]] = {
    "card": Card,
    "wall": Wall,
    "corner": Corner,
    "inter-reflection": InterReflection,
    "room": RandomRoom,
    "cornell": CornellBox,
}


def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length
