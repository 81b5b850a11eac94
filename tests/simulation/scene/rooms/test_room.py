"""Rooms as scenes: what a seed draws, and what the truth is; nothing depends on which process does the work."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from cadtof_cli.arrays import Complex
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.cornell import SIZE_M, STAND_OFF_M, CornellBox
from cadtof_cli.simulation.scene.rooms.rendering import light_in_room, median_irradiance
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.simulation.scene.rooms.solids import Interior
from cadtof_cli.simulation.scene.rooms.view import Room, View

CAMERA = Camera(width=24, height=18)
ALL_ROWS = slice(0, 18)
C_M_PER_NS = 0.299792458


def view(room: Interior, *, lamp_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0), paths: int = 16) -> View:
    placed = Room(interior=room, position_m=(1.5, 1.2, 0.5), yaw_rad=0.0, pitch_rad=0.0, beam_rad=math.pi)
    return View(room=placed, camera=CAMERA, lamp_offset_m=lamp_offset_m, light_paths=paths)


def mpi_phasor(light: Light, period_ns: float = 40.0) -> Complex:
    """Return the phasor of the MPI divided by that of the direct light."""
    turn = np.exp(2j * np.pi / period_ns * (light.delays_ns[1:] - light.delays_ns[0]))
    return np.asarray((light.photons[1:] * turn).sum(axis=0) / light.photons[0])


def test_a_seed_always_gives_the_same_room() -> None:
    assert RandomRoom(seed=3).room == RandomRoom(seed=3).room
    assert RandomRoom(seed=3).room != RandomRoom(seed=4).room
    first, second = (RandomRoom(seed=3, light_paths=8).light(CAMERA, slice(0, 8)) for _ in range(2))
    np.testing.assert_array_equal(first.photons, second.photons)
    np.testing.assert_array_equal(first.delays_ns, second.delays_ns)


def test_rows_are_the_same_whoever_traces_them() -> None:
    scene = RandomRoom(seed=11, light_paths=8)
    whole = scene.light(CAMERA, ALL_ROWS)
    bands = [scene.light(CAMERA, rows) for rows in (slice(16, 18), slice(0, 8), slice(8, 16))]
    for name in ("photons", "delays_ns"):
        parts = [getattr(bands[index], name) for index in (1, 2, 0)]
        np.testing.assert_array_equal(np.concatenate(parts, axis=1), getattr(whole, name))


def test_rooms_of_many_seeds_have_sensible_sizes_distances_and_albedos() -> None:
    sizes = set()
    for seed in range(40):
        scene = RandomRoom(seed=seed)
        drawn = View(room=scene.room, camera=CAMERA)
        seen = drawn.meet(CAMERA.rays(ALL_ROWS).reshape(3, -1))
        closed = seen.albedo > 0
        assert closed.mean() > 0.6
        assert seen.lengths_m[closed].max() < 5.7
        assert seen.lengths_m.min() > 0.5
        assert ((seen.albedo[closed] >= 0.2) & (seen.albedo[closed] <= 0.9)).all()
        width, height, depth = scene.room.interior.size_m
        assert 1.2 <= width <= 7.0
        assert 1.5 <= depth <= 7.0
        assert 2.3 <= height <= 3.2
        assert scene.room.summary.split(", ")[0].endswith(f" of {width:.2f} × {depth:.2f} × {height:.2f} m")
        sizes.add((width, height, depth))
    assert len(sizes) == 40


@pytest.mark.parametrize("pieces", [0, 1, 8])
def test_as_many_pieces_of_furniture_as_asked_stand_on_the_floor(pieces: int) -> None:
    room = RandomRoom(seed=24, furniture=pieces).room
    assert room.summary.endswith(f"pieces of furniture: {pieces}")
    solids = room.interior.solids
    assert (len(solids) >= pieces) if pieces else (len(solids) == 0)
    size = np.asarray(room.interior.size_m)
    for box in room.interior.boxes:
        assert (np.asarray(box.centre_m) > 0).all()
        assert (np.asarray(box.centre_m) < size).all()
        assert box.centre_m[1] + box.half_m[1] <= size[1] + 1e-9
        away = math.hypot(box.centre_m[0] - room.position_m[0], box.centre_m[2] - room.position_m[2])
        assert away > 0.5


def test_one_albedo_is_that_of_all_surfaces() -> None:
    interior = RandomRoom(seed=24, albedo=0.35).room.interior
    assert set(interior.albedos) == {0.35}
    assert {solid.albedo for solid in interior.solids} == {0.35}
    assert {patch.albedo for patch in interior.patches} <= {0.0, 0.35}


def test_direct_light_follows_the_inverse_square_and_cosine_laws() -> None:
    room = Interior(size_m=(40.0, 40.0, 2.5), albedos=(0.0, 0.0, 0.0, 0.0, 0.0, 0.5))
    placed = Room(interior=room, position_m=(20.0, 20.0, 0.5), yaw_rad=0.0, pitch_rad=0.0, beam_rad=math.pi)
    light = light_in_room(View(room=placed, camera=CAMERA, light_paths=4), ALL_ROWS, asr=1.0)
    x, y, _ = CAMERA.rays(ALL_ROWS)
    stretch = 1 + x * x + y * y
    np.testing.assert_allclose(light.photons[0], 0.5 / 4.0 * stretch**-1.5, rtol=1e-5)
    np.testing.assert_allclose(light.truth(1.0)["direct.depth"], 2.0 * np.sqrt(stretch), rtol=1e-6)
    assert light.photons[1:].sum() == 0.0


def test_a_lamp_beside_the_camera_lengthens_ways_and_leaves_the_true_range() -> None:
    room = Interior(size_m=(3.0, 2.5, 4.0), albedos=(0.5,) * 6)
    light = light_in_room(view(room, lamp_offset_m=(0.2, 0.0, 0.0)), ALL_ROWS, asr=1.0)
    centred = light_in_room(view(room), ALL_ROWS, asr=1.0)
    np.testing.assert_array_equal(light.truth(1.0)["direct.depth"], centred.truth(1.0)["direct.depth"])
    x, y, _ = CAMERA.rays(ALL_ROWS) * 3.5
    on_wall = (x > -1.5) & (x < 1.5) & (y > -1.2) & (y < 1.3)
    expected = np.hypot(np.hypot(x, y), 3.5) + np.sqrt((x - 0.2) ** 2 + y**2 + 3.5**2)
    np.testing.assert_allclose((light.delays_ns[0] * C_M_PER_NS)[on_wall], expected[on_wall], rtol=1e-6)
    assert on_wall.mean() > 0.5


def test_an_opening_has_no_truth() -> None:
    seen = RandomRoom(seed=0, light_paths=4).light(Camera(width=64, height=48), slice(0, 48))
    truth = seen.truth(1.0)["direct.depth"]
    assert 0.0 < np.isnan(truth).mean() < 0.4
    assert (seen.photons[:, np.isnan(truth)][0] == 0).all()
    assert (seen.ambient > 0).all()


def test_light_from_neighbours_is_the_light_of_the_pixel() -> None:
    """Averages over neighbours agree with every third pixel of a rendering of three times the resolution."""
    scene = RandomRoom(seed=10, light_paths=256)
    coarse = mpi_phasor(scene.light(Camera(width=60, height=45), slice(16, 24)))
    fine = mpi_phasor(scene.light(Camera(width=180, height=135), slice(48, 72)))[1::3, 1::3]
    difference = np.angle((1 + coarse) / (1 + fine)) * C_M_PER_NS * 40.0 / (4 * np.pi)
    size = np.angle(1 + fine) * C_M_PER_NS * 40.0 / (4 * np.pi)
    assert np.median(np.abs(difference)) < 0.02 * np.median(size)
    assert np.abs(np.median(difference)) < 0.01 * np.median(size)


def test_the_scatter_of_a_rendering_is_far_below_what_is_measured() -> None:
    first, second = (
        mpi_phasor(
            RandomRoom(seed=1, light_paths=256, tracing_seed=seed).light(Camera(width=80, height=60), slice(24, 32))
        )
        for seed in (0, 1)
    )
    scatter_m = np.angle((1 + first) / (1 + second)) * C_M_PER_NS * 40.0 / (4 * np.pi) / math.sqrt(2.0)
    assert np.median(np.abs(scatter_m)) < 2e-3


def test_the_box_in_the_manner_of_cornell() -> None:
    scene = CornellBox(light_paths=16)
    camera = Camera(width=80, height=60)
    light = scene.light(camera, slice(24, 36))
    truth = light.truth(1.0)
    assert truth["direct.depth"][0, 40] < STAND_OFF_M + SIZE_M + 0.5
    assert 0.2 < float(np.nanmedian(truth["mpi.ratio"])) < 2.0
    assert "Cornell" in scene.summary


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RandomRoom(furniture=40), "furniture: found 40, expected 0 to 12 pieces"),
        (lambda: RandomRoom(albedo=1.0), "albedo: found 1.0, expected above 0, at most 0.95"),
        (lambda: RandomRoom(lamp_offset_m=(1.0, 0.0, 0.0)), "lamp offset: found .* expected 0.3 m or less"),
        (lambda: RandomRoom(beam_deg=0.0), "beam: found 0.0, expected 1° to 180°"),
        (lambda: RandomRoom(asr=-1.0), "ASR: found -1, expected a ratio from 0 to"),
        (lambda: RandomRoom(light_paths=0), "light paths: found 0, expected 1 to 100000"),
        (lambda: RandomRoom(seed=-1), "seed: found -1, expected 0 or more"),
    ],
)
def test_impossible_rooms_are_refused(make: Callable[[], RandomRoom], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        make()


def test_a_lamp_behind_the_wall_is_refused() -> None:
    room = Interior(size_m=(3.0, 2.5, 4.0), albedos=(0.5,) * 6)
    with pytest.raises(SettingsError, match="expected a lamp within the room"):
        view(room, lamp_offset_m=(0.0, 0.0, -0.6))


@pytest.mark.parametrize("asr", [0.5, 4.0])
def test_the_asr_is_ambient_light_over_the_median_of_direct_light(asr: float) -> None:
    light = RandomRoom(seed=2003, asr=asr, light_paths=1).light(CAMERA, ALL_ROWS)
    lit = light.photons[0] > 0.0
    assert np.median(light.photons[0][lit] / light.ambient[lit]) == pytest.approx(1.0 / asr, rel=0.1)


@pytest.mark.parametrize(("width", "height", "within"), [(8, 6, 0.02), (16, 12, 0.02), (32, 24, 0.02), (64, 48, 0.1)])
def test_the_asr_of_small_pictures_is_that_of_the_median_too(width: int, height: int, within: float) -> None:
    for seed in range(12):
        seen = View(room=RandomRoom(seed=seed).room, camera=Camera(width=width, height=height))
        direct = seen.direct(seen.meet(seen.camera.rays(slice(None)).reshape(3, -1)))
        assert median_irradiance(seen) == pytest.approx(float(np.median(direct[direct > 0])), rel=within)


def test_without_ambient_light_pixels_that_see_nothing_hold_noise() -> None:
    light = RandomRoom(asr=0.0, light_paths=1).light(CAMERA, ALL_ROWS)
    lit = light.photons.any(axis=0)
    assert not lit.all()
    np.testing.assert_array_equal(light.ambient > 0, ~lit)
    truth = light.truth(0.2746)
    assert np.isnan(truth["direct.depth"][~lit]).all()
    assert (truth["direct.amplitude"][~lit] == 0).all()
