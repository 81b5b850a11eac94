"""A camera in a room: where it stands, what its pixels see, and the light on them, row by row of a coarser grid.

Light by way of other surfaces changes slowly along a surface, so it is traced at every second row and column and
averaged over a few neighbours on the same face. What a pixel sees, its direct light and shadows are its own.
"""

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32, Index
from cadtof_cli.simulation.camera import Camera
from cadtof_cli.simulation.geometry import Vector
from cadtof_cli.simulation.mix import require
from cadtof_cli.simulation.scene.lamp import Lamp
from cadtof_cli.simulation.scene.light_points import LampLight, lamp_light
from cadtof_cli.simulation.scene.solids import Interior, Meetings
from cadtof_cli.simulation.scene.tracing import transients

if TYPE_CHECKING:
    from scipy.sparse import csr_array

STEP = 2
"""Rows and columns from one traced pixel to the next."""

REACH = 3
"""Traced pixels to each side that an average may hold; their weights fall off evenly to nothing at REACH + 1/2."""

ROUNDNESS = 8
"""Power of the cosine between normals by which a neighbour on a ball counts less."""

ROWS_KEPT = 16
"""Traced rows that wait for the next band, which shares some of them."""

_GRID_KEY, _ALONE_KEY, _LAMP_KEY = 0, 1, 2
"""Branches of the seed for traced rows, for pixels that are traced for themselves, and for the light from the lamp."""


@dataclass(frozen=True, kw_only=True)
class View:
    """Room, lamp and camera.

    Attributes:
        interior: the room.
        camera: array and lens.
        position_m: of the camera, in the room's frame.
        yaw_rad, pitch_rad: how far it is turned to the right and then down from looking along z.
        lamp_offset_m: from the camera to its lamp, in the camera's frame.
        beam_rad: half angle of the lamp's beam, whose middle is the optical axis.
        light_paths: traced from each traced pixel.
        seed: of the tracing.
    """

    interior: Interior
    camera: Camera
    position_m: Vector
    yaw_rad: float
    pitch_rad: float
    lamp_offset_m: Vector
    beam_rad: float
    light_paths: int
    seed: int

    def __post_init__(self) -> None:
        inside = all(0 < at < size for at, size in zip(self.lamp.position_m, self.interior.size_m, strict=True))
        require(inside, "lamp offset", self.lamp_offset_m, "a lamp within the room; it stands in or behind a wall")

    @property
    def turn(self) -> Float:
        """Rotation from the camera's frame to the room's, (3, 3)."""
        a, b = self.yaw_rad, self.pitch_rad
        right_left = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
        up_down = np.array([[1, 0, 0], [0, math.cos(b), math.sin(b)], [0, -math.sin(b), math.cos(b)]])
        return np.asarray(right_left @ up_down)

    @property
    def lamp(self) -> Lamp:
        """The camera's lamp in the room's frame."""
        x, y, z = np.asarray(self.position_m) + self.turn @ np.asarray(self.lamp_offset_m)
        ahead = self.turn[:, 2]
        return Lamp(
            position_m=(float(x), float(y), float(z)),
            axis=(float(ahead[0]), float(ahead[1]), float(ahead[2])),
            beam_rad=self.beam_rad,
        )

    def meet(self, rays: Float, /) -> Meetings:
        """Return what rays in the camera's frame, (3, n), meet."""
        directions = (self.turn @ (rays / np.linalg.norm(rays, axis=0))).astype(np.float32)
        start = np.asarray(self.position_m, np.float32)[:, None]
        return self.interior.meet(np.broadcast_to(start, directions.shape), directions)

    def direct(self, seen: Meetings, /) -> Float32:
        """Return the lamp's irradiance where rays have met surfaces, (n,)."""
        return self.lamp.irradiance(self.interior, seen.points_m, seen.normals)


@dataclass(frozen=True)
class TracedRow:
    """One traced row.

    Attributes:
        surface: (n,), as in Meetings.
        normals: (3, n).
        light: (2, n, BINS), irradiance by time after the direct light, and irradiance times delay in ns.
    """

    surface: NDArray[np.int32]
    normals: Float32
    light: Float


@lru_cache(maxsize=ROWS_KEPT)
def traced_row(view: View, row: int, /) -> TracedRow:
    """Trace one row of every STEP; it depends on nothing but the view and its own number."""
    y = int(_traced_at(np.asarray(row), view.camera.height))
    columns = _traced_at(np.arange(_traced(view.camera.width)), view.camera.width)
    seen = view.meet(view.camera.rays(slice(y, y + 1))[:, 0, columns])
    light = _light(view, seen.points_m, seen.normals, spawn_key=(_GRID_KEY, row))
    return TracedRow(seen.surface, seen.normals, light)


def indirect_light(view: View, seen: Meetings, rows: range, /) -> Float:
    """Return light by way of other surfaces on rows of the camera, (2, Y·X, BINS), as TracedRow has it.

    Neighbours on another face do not count; a pixel without any on its own face is traced itself.

    Args:
        view: room and camera.
        seen: what the pixels of these rows see, (Y·X,).
        rows: of the camera.
    """
    from scipy import sparse

    first = max(rows.start // STEP - REACH, 0)
    last = min((rows.stop - 1) // STEP + REACH, _traced(view.camera.height) - 1)
    traced = [traced_row(view, row) for row in range(first, last + 1)]
    weights = _weights(view.camera, seen, rows, traced, first)
    whole = np.asarray(weights.sum(axis=1)).ravel()
    lonely = (whole == 0) & (seen.albedo > 0)
    weights = sparse.diags_array(1.0 / np.where(whole > 0, whole, 1.0)) @ weights
    light = np.stack([weights @ np.concatenate([row.light[part] for row in traced]) for part in range(2)])
    for line, y in enumerate(rows):
        alone = np.flatnonzero(lonely[line * view.camera.width :][: view.camera.width]) + line * view.camera.width
        if len(alone):
            light[:, alone] = _light(view, seen.points_m[:, alone], seen.normals[:, alone], spawn_key=(_ALONE_KEY, y))
    return np.asarray(light)


def _weights(camera: Camera, seen: Meetings, rows: range, traced: list[TracedRow], first: int) -> "csr_array":
    """Return how much each traced pixel counts for each pixel of the rows, (Y·X, traced pixels)."""
    from scipy.sparse import csr_array

    surface = np.concatenate([row.surface for row in traced])
    normals = np.concatenate([row.normals for row in traced], axis=1)
    across = _traced(camera.width)
    y, x = (part.ravel() for part in np.meshgrid(np.asarray(rows), np.arange(camera.width), indexing="ij"))
    pixels, places, shares = [], [], []
    for down, right in itertools.product(range(-REACH, REACH + 1), repeat=2):
        row, column = y // STEP + down - first, x // STEP + right
        share = _nearness(y, row + first, camera.height) * _nearness(x, column, camera.width)
        inside = (row >= 0) & (row < len(traced)) & (column >= 0) & (column < across) & (share > 0)
        pixel = np.flatnonzero(inside)
        place = row[pixel] * across + column[pixel]
        alike = (seen.normals[:, pixel] * normals[:, place]).sum(axis=0)
        same = (surface[place] == seen.surface[pixel]) & (alike > 0)
        pixels.append(pixel[same])
        places.append(place[same])
        shares.append(share[pixel[same]] * alike[same] ** ROUNDNESS)
    shape = len(seen.surface), len(surface)
    return csr_array((np.concatenate(shares), (np.concatenate(pixels), np.concatenate(places))), shape=shape)


def _traced(pixels: int) -> int:
    """Return how many of a line of pixels are traced."""
    return (pixels + STEP - 1) // STEP


def _traced_at(places: Index, pixels: int) -> Index:
    """Return which of a line of pixels the traced ones are."""
    return np.minimum(STEP * places + STEP // 2, pixels - 1)


def _nearness(pixels: Index, places: Index, count: int) -> Float:
    """Return 1 where a traced pixel is the pixel itself, falling evenly to 0."""
    return np.asarray(np.maximum(1.0 - np.abs(pixels - _traced_at(places, count)) / (STEP * (REACH + 0.5)), 0.0))


def _light(view: View, points_m: Float32, normals: Float32, *, spawn_key: tuple[int, int]) -> Float:
    generator = np.random.default_rng(np.random.SeedSequence(view.seed, spawn_key=spawn_key))
    lamp = view.lamp
    known = _lamp_light(view.interior, lamp, view.seed)
    light = transients(view.interior, lamp, known, points_m, normals, paths=view.light_paths, generator=generator)
    return np.stack([light.irradiance, light.moments])


@lru_cache(maxsize=2)
def _lamp_light(interior: Interior, lamp: Lamp, seed: int) -> LampLight:
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_LAMP_KEY,)))
    return lamp_light(interior, lamp, generator)
