"""Light on rows of a camera agrees with light that is traced for each pixel alone, and becomes photons and delays."""

import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.lamp import Lamp, LampLight, lamp_light
from cadtof_cli.simulation.scene.rooms.rendering import (
    STEP,
    indirect_light,
    light_in_room,
    median_irradiance,
    traced_row,
)
from cadtof_cli.simulation.scene.rooms.solids import Box, Interior
from cadtof_cli.simulation.scene.rooms.tracing import Transients, transients
from cadtof_cli.simulation.scene.rooms.view import Room, View

C_M_PER_NS = 0.299792458

CAMERA = Camera(width=21, height=13, focal_length_px=24.0)

POST = Box(centre_m=(1.99, 1.9, 2.6), half_m=(0.02, 0.6, 0.02), albedo=0.4)
"""A post so thin that some of its pixels have no traced neighbour on the same face."""

ROOM = Interior(size_m=(3.0, 2.5, 4.0), albedos=(0.6, 0.5, 0.8, 0.3, 0.4, 0.7), boxes=(POST,))

ROWS = range(5, 8)

PLACED = Room(interior=ROOM, position_m=(1.4, 1.2, 0.4), yaw_rad=0.1, pitch_rad=0.05, beam_rad=math.pi)

VIEW = View(room=PLACED, camera=CAMERA, light_paths=48, seed=3)


@cache
def by_rows() -> Float:
    seen = VIEW.meet(CAMERA.rays(slice(ROWS.start, ROWS.stop)).reshape(3, -1))
    return indirect_light(VIEW, seen, ROWS)


@cache
def by_pixels() -> Float:
    """Return irradiance, and irradiance times delay, of these pixels, each traced alone, (2, Y·X)."""
    seen = VIEW.meet(CAMERA.rays(slice(ROWS.start, ROWS.stop)).reshape(3, -1))
    generator = np.random.default_rng(11)
    known = lamp_light(ROOM, VIEW.lamp, generator)
    found = transients(ROOM, VIEW.lamp, known, seen.points_m, seen.normals, paths=800, generator=generator)
    return np.asarray((found.once + found.later).sum(axis=-1))


@cache
def light() -> Light:
    return light_in_room(VIEW, slice(ROWS.start, ROWS.stop), asr=1.5)


def test_averages_over_neighbours_are_the_light_of_each_pixel() -> None:
    ours, theirs = by_rows().sum(axis=-1), by_pixels()
    assert ours.shape == theirs.shape
    assert np.median(np.abs(ours[0] / theirs[0] - 1.0)) < 0.05
    assert np.abs(ours[0] / theirs[0] - 1.0).max() < 0.35
    assert ours[0].sum() == pytest.approx(theirs[0].sum(), rel=0.04)
    delay, alone = ours[1] / ours[0], theirs[1] / theirs[0]
    assert np.median(np.abs(delay / alone - 1.0)) < 0.09
    assert delay.mean() == pytest.approx(alone.mean(), rel=0.04)


def test_every_pixel_has_light_also_one_without_a_neighbour_on_its_face() -> None:
    seen = VIEW.meet(CAMERA.rays(slice(ROWS.start, ROWS.stop)).reshape(3, -1))
    assert (seen.surface // 8 == 1).any()
    assert (by_rows()[0].sum(axis=-1) > 0.0).all()


@pytest.mark.parametrize("row", [0, 3, 6])
def test_every_second_pixel_is_traced_and_the_last_of_an_odd_number(row: int) -> None:
    columns = [min(column + 1, CAMERA.width - 1) for column in range(0, CAMERA.width, STEP)]
    line = min(STEP * row + 1, CAMERA.height - 1)
    rays = CAMERA.rays(slice(None))[:, line, columns]
    seen = VIEW.meet(rays)
    faces, found = traced_row(VIEW, row)
    np.testing.assert_array_equal(faces.surface, seen.surface)
    assert_allclose(faces.normals, seen.normals)
    assert found.once.shape[:2] == (2, 11)


def test_photons_of_a_pixel_are_the_light_on_its_surface_times_the_albedo() -> None:
    rays = CAMERA.rays(slice(ROWS.start, ROWS.stop)).reshape(3, -1)
    seen, found = VIEW.meet(rays), light()
    flat = {name: getattr(found, name).reshape(-1, seen.albedo.size) for name in ("photons", "delays_ns")}
    assert_allclose(flat["photons"][0], VIEW.direct(seen) * seen.albedo, rtol=1e-5)
    assert_allclose(flat["photons"][1:], by_rows()[0].T * seen.albedo, rtol=1e-5)
    assert_allclose(flat["delays_ns"][0], 2.0 * seen.lengths_m / C_M_PER_NS, rtol=1e-5)
    irradiance, moments = by_rows()
    some = irradiance > 0.0
    later = (flat["delays_ns"][1:] - flat["delays_ns"][0]).T
    assert_allclose(later[some], moments[some] / irradiance[some], atol=1e-9)
    assert_allclose(later[~some], 0.0, atol=1e-9)
    assert_allclose(found.ambient.ravel(), 1.5 * median_irradiance(VIEW) * seen.albedo, rtol=1e-5)
    assert found.ranges_m is not None
    assert_allclose(found.ranges_m.ravel(), seen.lengths_m)
    assert found.photons.shape[1:] == found.ambient.shape == (3, 21)


def test_rows_and_seeds_are_traced_independently() -> None:
    first, second = (traced_row(VIEW, row)[1].once[0].sum(axis=-1) for row in (2, 3))
    assert not np.isclose(first, second).any()
    again = View(**{**vars(VIEW), "seed": 4})
    assert not np.array_equal(traced_row(again, 2)[1].once, traced_row(VIEW, 2)[1].once)


def arrays_in(record: object) -> Iterator[NDArray[Any]]:
    """Yield all arrays of a record, and of the records in it."""
    for part in vars(record).values():
        if isinstance(part, np.ndarray):
            yield part
        elif hasattr(part, "__dict__"):
            yield from arrays_in(part)


def test_light_that_is_kept_for_other_rows_cannot_be_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    handed = list[object]()

    def watched(interior: Interior, lamp: Lamp, known: LampLight, *places: Float32, **how: Any) -> Transients:
        handed.append(known)
        return transients(interior, lamp, known, *places, **how)

    monkeypatch.setattr("cadtof_cli.simulation.scene.rooms.rendering.transients", watched)
    other = View(**{**vars(VIEW), "seed": 5})
    rows = (*traced_row(other, 0), *traced_row(other, 1))
    assert handed[0] is handed[1]
    for record in (handed[0], *rows):
        arrays = list(arrays_in(record))
        assert len(arrays) >= 2
        assert not any(array.flags.writeable for array in arrays)
