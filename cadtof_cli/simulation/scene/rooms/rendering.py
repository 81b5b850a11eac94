"""The light on a camera's pixels in a room. Light by way of other surfaces is traced at some pixels and averaged for all.

Such light changes slowly along a surface; the more surfaces it has come by, the more slowly it changes. So it is traced only at
every second row and column. Light by way of one other surface is averaged over a few traced pixels on the same face, and light
by way of more surfaces over a wider neighbourhood. The surface that a pixel sees, its direct light and its shadows are not
averaged.
"""

from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Float, Float32, sealed
from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.averages import Faces, Lattice, means_of_cells, neighbour_weights
from cadtof_cli.simulation.scene.rooms.lamp import Lamp, LampLight, lamp_light
from cadtof_cli.simulation.scene.rooms.solids import Interior, Meetings
from cadtof_cli.simulation.scene.rooms.tracing import Transients, transients
from cadtof_cli.simulation.scene.rooms.view import View
from cadtof_cli.units import C_M_PER_NS

STEP = 2
"""Rows and columns from one traced pixel to the next."""

REACH = 2
"""Number of traced pixels to each side over which light by way of one other surface is averaged."""

CELL = 4
"""Number of traced pixels along each side of a cell; light by way of more surfaces is averaged over cells."""

CELLS = 2
"""Number of cells to each side over which light by way of more surfaces is averaged."""

COARSE, FEWEST = 8, 15
"""Largest step in rows and columns between the pixels from which the median of the direct light is taken, and the number of rows
and of columns that these pixels fill at least: in small pictures, a few pixels do not tell the median."""

ROWS_KEPT = 32
"""Number of traced rows that are kept for the next band, which needs most of them again."""

_GRID_KEY, _ALONE_KEY, _LAMP_KEY = 0, 1, 2
"""Branches of the seed: for traced rows, for pixels that are traced for themselves, and for the light from the lamp."""


def light_in_room(view: View, rows: slice, /, *, asr: float) -> Light:
    """Return the light on rows of a camera in a room; photons are irradiance times albedo."""
    lines = range(*rows.indices(view.camera.height))
    shape = len(lines), view.camera.width
    seen = view.meet(view.camera.rays(rows).reshape(3, -1))
    ranges_m = seen.lengths_m.astype(np.float64)
    direct_ns = (ranges_m + view.lamp.distances_m(seen.points_m)) / C_M_PER_NS
    irradiance, moments = np.moveaxis(indirect_light(view, seen, lines), 1, 2)
    later_ns = np.divide(moments, irradiance, out=np.zeros_like(moments), where=irradiance > 0)
    photons = np.concatenate([view.direct(seen)[None], irradiance]) * seen.albedo.astype(np.float64)
    ambient = asr * median_irradiance(view) * np.where(seen.albedo > 0, seen.albedo, 1.0)
    # even with an ASR of 0, something makes the noise of pixels that see nothing
    ambient = np.where(photons.any(axis=0) | (ambient > 0), ambient, 1.0)
    return Light(
        delays_ns=np.concatenate([direct_ns[None], direct_ns + later_ns]).reshape(-1, *shape),
        photons=photons.reshape(-1, *shape),
        ambient=ambient.reshape(shape),
        ranges_m=ranges_m.reshape(shape),
    )


@lru_cache(maxsize=4)
def median_irradiance(view: View, /) -> float:
    """Return the median of the direct irradiance over what the camera sees, 1/m²."""
    step = max(1, min(COARSE, view.camera.height // FEWEST, view.camera.width // FEWEST))
    rays: Float = view.camera.rays(slice(None))[:, ::step, ::step].reshape(3, -1)
    direct = view.direct(view.meet(rays))
    return float(np.median(direct[direct > 0])) if (direct > 0).any() else 1.0


@lru_cache(maxsize=ROWS_KEPT)
def traced_row(view: View, row: int, /) -> tuple[Faces, Transients]:
    """Return what the pixels of one traced row see, and the light on them, which depends only on the view and on the row."""
    camera = view.camera
    columns = np.minimum(np.arange(0, camera.width, STEP) + STEP // 2, camera.width - 1)
    y = min(STEP * row + STEP // 2, camera.height - 1)
    seen = view.meet(camera.rays(slice(y, y + 1))[:, 0, columns])
    light = _light(view, seen.points_m, seen.normals, spawn_key=(_GRID_KEY, row))
    return sealed((Faces(seen.surface, seen.normals), light))


def indirect_light(view: View, seen: Meetings, rows: range, /) -> Float:
    """Return the light by way of other surfaces on the pixels of some rows, (2, Y·X, BINS), in the form of `Transients`.

    `seen` has the surfaces that these pixels see, (Y·X,). Neighbours on another face do not count; a pixel that has no neighbour
    on its own face is traced itself.
    """
    width, faces = view.camera.width, Faces(seen.surface, seen.normals)
    fine, coarse = Lattice(width, STEP, REACH), Lattice(width, CELL * STEP, CELLS)
    last = (view.camera.height - 1) // STEP
    near = [traced_row(view, row) for row in fine.rows(rows) if row <= last]
    cells = coarse.rows(rows)
    wide = [traced_row(view, row) for row in range(CELL * cells.start, CELL * cells.stop) if row <= last]
    traced = _together(near)
    by_pixels = neighbour_weights(fine, rows, faces, np.arange(len(traced.surface)), traced)
    means, places, means_faces = means_of_cells(_together(wide), fine.across, CELL)
    by_cells = neighbour_weights(coarse, rows, faces, places, means_faces)
    light = np.stack(
        [
            by_pixels @ np.concatenate([row.once[part] for _, row in near])
            + by_cells @ (means @ np.concatenate([row.later[part] for _, row in wide]))
            for part in range(2)
        ]
    )
    found = np.minimum(by_pixels.sum(axis=1), by_cells.sum(axis=1))
    for line, y in enumerate(rows):
        pixels = np.arange(line * width, (line + 1) * width)
        alone = pixels[(found[pixels] == 0) & (seen.albedo[pixels] > 0)]
        if len(alone):
            own = _light(view, seen.points_m[:, alone], seen.normals[:, alone], spawn_key=(_ALONE_KEY, y))
            light[:, alone] = own.once + own.later
    return light


def _together(rows: list[tuple[Faces, Transients]]) -> Faces:
    surfaces, normals = ([seen.surface for seen, _ in rows], [seen.normals for seen, _ in rows])
    return Faces(np.concatenate(surfaces), np.concatenate(normals, axis=1))


def _light(view: View, points_m: Float32, normals: Float32, *, spawn_key: tuple[int, int]) -> Transients:
    generator = np.random.default_rng(np.random.SeedSequence(view.seed, spawn_key=spawn_key))
    lamp = view.lamp
    known = _lamp_light(view.room.interior, lamp, view.seed)
    return transients(view.room.interior, lamp, known, points_m, normals, paths=view.light_paths, generator=generator)


@lru_cache(maxsize=2)
def _lamp_light(interior: Interior, lamp: Lamp, seed: int) -> LampLight:
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_LAMP_KEY,)))
    return sealed(lamp_light(interior, lamp, generator))
