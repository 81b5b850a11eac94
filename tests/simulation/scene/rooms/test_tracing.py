"""Traced light conserves energy, and agrees with an integral over the other surface."""

import math

import numpy as np
import pytest

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.simulation.scene.geometry import Hits, Surface, bounce_by_patches
from cadtof_cli.simulation.scene.rooms import lamp as lamps
from cadtof_cli.simulation.scene.rooms.directions import directions_about
from cadtof_cli.simulation.scene.rooms.lamp import Lamp, lamp_light
from cadtof_cli.simulation.scene.rooms.solids import Box, Interior
from cadtof_cli.simulation.scene.rooms.tracing import Transients, bin_numbers, transients

C_M_PER_NS = 0.299792458


def traced(room: Interior, lamp: Lamp, points: Float, normals: Float, *, paths: int, seed: int = 0) -> Transients:
    generator = np.random.default_rng(seed)
    light = lamp_light(room, lamp, generator)
    ends: tuple[Float32, Float32] = points.astype(np.float32), normals.astype(np.float32)
    return transients(room, lamp, light, *ends, paths=paths, generator=generator)


def all_over(box: Box, inwards: float, count: int, generator: np.random.Generator) -> tuple[Float, Float, Float]:
    """Return random points on all faces of a box, their normals, and the area that each point stands for."""
    cosine, sine = math.cos(box.turn_rad), math.sin(box.turn_rad)
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    points, normals, areas = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            places = generator.uniform(-1.0, 1.0, (3, count)) * np.asarray(box.half_m)[:, None]
            places[axis] = side * box.half_m[axis]
            normal = np.zeros((3, count))
            normal[axis] = -side if inwards else side
            points.append(turn @ places + np.asarray(box.centre_m)[:, None])
            normals.append(turn @ normal)
            areas.append(np.full(count, 4 * math.prod(box.half_m) / box.half_m[axis] / count))
    return np.concatenate(points, axis=1), np.concatenate(normals, axis=1), np.concatenate(areas)


@pytest.mark.parametrize("albedo", [0.3, 0.8])
@pytest.mark.parametrize("beam_rad", [1.0, math.pi])
def test_a_closed_room_keeps_its_light(albedo: float, beam_rad: float) -> None:
    """Surfaces receive the flux Φ from the lamp, and Φ(ρ + ρ² + …) = Φρ/(1 − ρ) from each other."""
    block = Box(centre_m=(1.2, 1.4, 2.5), half_m=(0.3, 0.4, 0.2), turn_rad=0.5, albedo=albedo)
    room = Interior(size_m=(3.0, 2.5, 4.0), albedos=(albedo,) * 6, boxes=(block,))
    lamp = Lamp(position_m=(1.5, 1.2, 0.5), axis=(0.0, 0.0, 1.0), beam_rad=beam_rad)
    generator = np.random.default_rng(1)
    walls = all_over(Box(centre_m=(1.5, 1.25, 2.0), half_m=(1.5, 1.25, 2.0)), True, 60, generator)
    faces = all_over(block, False, 20, generator)
    points, normals, areas = (np.concatenate(parts, axis=-1) for parts in zip(walls, faces, strict=True))
    light = traced(room, lamp, points, normals, paths=64)
    received = ((light.once[0] + light.later[0]).sum(axis=1) * areas).sum()
    assert received == pytest.approx(lamp.flux * albedo / (1 - albedo), rel=0.03)


def test_light_by_way_of_one_surface_is_the_integral_over_it() -> None:
    """Two walls at a right angle, all else black. The reference is independent: a sum over patches of one wall."""
    room = Interior(size_m=(3.0, 2.4, 3.0), albedos=(0.0, 0.0, 0.0, 0.0, 0.0, 0.7))
    lamp = Lamp(position_m=(1.0, 1.2, 0.4), axis=(0.0, 0.0, 1.0))
    points = np.array([[0.0, 0.0, 0.0], [1.0, 1.8, 0.3], [2.9, 2.0, 1.0]])
    normals = np.repeat(np.array([[1.0], [0.0], [0.0]]), 3, axis=1)
    light = traced(room, lamp, points, normals, paths=20_000)
    assert light.later.sum() == 0.0
    at = np.asarray(lamp.position_m)
    far = Surface(
        origin_m=(float(-at[0]), float(-at[1]), float(3.0 - at[2])),
        across=(1.0, 0.0, 0.0),
        along=(0.0, 1.0, 0.0),
        extents_m=(0.0, 3.0, 0.0, 2.4),
        albedo=0.7,
    )
    relative = points - at[:, None]
    seen = Hits(relative[:, None], normals[:, None], np.zeros((1, 3)), np.zeros((1, 3), np.intp))
    expected = bounce_by_patches(seen, far, count=400)
    total = expected.irradiance[:, 0].sum(axis=0)
    np.testing.assert_allclose(light.once[0].sum(axis=1), total, rtol=0.01)
    lengths = (expected.irradiance * expected.lengths_m)[:, 0].sum(axis=0) / total
    delays = (lengths - np.linalg.norm(relative, axis=0)) / C_M_PER_NS
    np.testing.assert_allclose(light.once[1].sum(axis=1) / light.once[0].sum(axis=1), delays, rtol=0.01)


def test_how_the_work_is_shared_between_paths_and_connections_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    room = Interior(size_m=(3.0, 2.5, 4.0), albedos=(0.6, 0.5, 0.8, 0.3, 0.4, 0.7))
    lamp = Lamp(position_m=(1.5, 1.2, 0.5), axis=(0.0, 0.0, 1.0), beam_rad=1.0)
    points = np.array([[0.05, 1.5, 2.9], [1.2, 2.5, 0.4], [3.95, 2.0, 4.0]])
    normals = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
    sums = []
    for evenness in (0.5, 40.0):
        monkeypatch.setattr(lamps, "EVENNESS", evenness)
        light = traced(room, lamp, points, normals, paths=20_000)
        sums.append(np.stack([light.later[0].sum(axis=1), light.later[1].sum(axis=1)]))
    np.testing.assert_allclose(sums[0], sums[1], rtol=0.03)


def test_black_surroundings_give_nothing_back() -> None:
    room = Interior(size_m=(3.0, 2.5, 4.0), albedos=(0.0,) * 6)
    lamp = Lamp(position_m=(1.5, 1.2, 0.5), axis=(0.0, 0.0, 1.0))
    light = traced(room, lamp, np.array([[1.5], [1.0], [4.0]]), np.array([[0.0], [0.0], [-1.0]]), paths=200)
    assert not light.once.any()
    assert not light.later.any()


def test_light_never_comes_before_the_direct_light() -> None:
    room = Interior(size_m=(3.0, 2.5, 4.0), albedos=(0.7,) * 6)
    lamp = Lamp(position_m=(1.5, 1.2, 0.5), axis=(0.0, 0.0, 1.0))
    light = traced(room, lamp, np.array([[0.01], [1.0], [4.0]]), np.array([[0.0], [0.0], [-1.0]]), paths=5000)
    assert (light.once[1] >= 0).all()
    assert (light.later[1] >= 0).all()
    assert light.later[1].sum() / light.later[0].sum() > light.once[1].sum() / light.once[0].sum()


def test_directions_about_a_normal_are_turned_and_nothing_else() -> None:
    rng = np.random.default_rng(6)
    normals, local = (rng.normal(size=(3, 500)) for _ in range(2))
    normals[:, :2] = [[0.0, 0.0], [0.0, 0.0], [1.0, -1.0]]
    normals, local = (vectors / np.linalg.norm(vectors, axis=0) for vectors in (normals, local))
    found = directions_about(normals.astype(np.float32), local.astype(np.float32))
    np.testing.assert_allclose((found * normals).sum(axis=0), local[2], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=0), 1.0, atol=1e-5)
    for normal in normals.T[:10]:
        same = directions_about(np.repeat(normal[:, None], 500, axis=1).astype(np.float32), local.astype(np.float32))
        np.testing.assert_allclose(same.T @ same, local.T @ local, atol=1e-5)


def test_bins_grow_from_the_direct_light_to_the_last() -> None:
    """The edges are evenly spread over ln(1 + delay/4 ns), from 0 to 150 ns; longer delays go into the last bin."""
    assert bin_numbers(np.array([-1e-3, 0.0])).tolist() == [0, 0]
    edges = 4.0 * np.expm1(np.arange(161) / 160 * np.log1p(150.0 / 4.0))
    middles = 0.5 * (edges[1:] + edges[:-1])
    np.testing.assert_array_equal(bin_numbers(middles), np.arange(160))
    assert bin_numbers(np.array([149.0, 151.0, 1e6])).tolist() == [159, 159, 159]
