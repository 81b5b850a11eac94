"""Paths become metres and volts: a full turn of the phase is the unambiguous range, c·T/2."""

import numpy as np
import pytest

from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.depth import DepthScale, write_block
from cadtof_cli.maps.layers import DIRECT_DEPTH, Layer, wanted_layers
from cadtof_cli.optics import LampBeside
from cadtof_cli.resolver.paths import Paths, ResolvedPaths
from tests.support.mixtures import F

METRES, VOLTS = 0.299792458 * 40.0 / (4 * np.pi), 0.2746
SCALE = DepthScale(METRES, VOLTS)


def resolved(phase_rad: F) -> ResolvedPaths:
    rng = np.random.default_rng(9)
    shape, count = phase_rad.shape, phase_rad.shape[1:]
    return ResolvedPaths(
        Paths(rng.uniform(0.1, 0.4, shape), phase_rad, rng.uniform(1e-3, 1e-2, shape)),
        rng.uniform(0.1, 0.5, count),
        np.arange(1, 7, dtype=np.uint32),
        rng.uniform(0, 9, count),
    )


def drawn(paths: int = 2) -> ResolvedPaths:
    return resolved(np.random.default_rng(8).uniform(0.5, 6.0, (paths, 6)))


def written(
    paths: ResolvedPaths,
    *,
    start: int,
    scale: DepthScale = SCALE,
    layers: tuple[Layer, ...] | None = None,
    samples: F | None = None,
) -> DepthMaps:
    """Return maps of 3 × 4 pixels with a block of six written; other pixels keep layers of −1 and a status of 99."""
    layers = layers or wanted_layers()
    maps = DepthMaps.empty(tuple(layer.name for layer in layers), (3, 4))
    maps.pages[:] = -1.0
    maps.status[:] = 99
    block = slice(start, start + 6)
    write_block(maps, block, scale.source(paths, block, samples=samples), layers=layers)
    return maps


def test_a_block_is_written_in_metres_and_volts_and_nothing_else_changes() -> None:
    paths = drawn()
    maps = written(paths, start=5)
    for name, one in (("direct", paths.paths[0]), ("mpi", paths.paths[1])):
        for what, values in (
            ("depth", one.phase_rad * METRES),
            ("amplitude", one.amplitude * VOLTS),
            ("sigma", one.sigma_rad * METRES),
        ):
            layer = maps.layer(f"{name}.{what}").ravel()
            np.testing.assert_allclose(layer[5:11], values, rtol=1e-7)
            assert (np.delete(layer, range(5, 11)) == -1.0).all()
    np.testing.assert_allclose(maps.layer("confidence").ravel()[5:11], paths.confidence * VOLTS, rtol=1e-7)
    assert maps.status.ravel().tolist() == [99] * 5 + [1, 2, 3, 4, 5, 6] + [99]


def test_field_curvature_is_subtracted_and_a_range_below_0_wraps_to_the_end() -> None:
    offset = np.linspace(0.0, 0.11, 12)
    true = np.array([0.001, 1.0, 3.0, 4.0, 5.9, 5.94])
    recorded = (true + offset[5:11]) % 5.99584916
    assert recorded[5] < 1.0
    echo = true + 6.2
    paths = resolved(np.stack([recorded, echo + offset[5:11]]) / METRES)
    before = paths.paths.phase_rad.copy()
    maps = written(paths, start=5, scale=DepthScale(METRES, VOLTS, range_offset_m=offset))
    np.testing.assert_allclose(maps.layer("direct.depth").ravel()[5:11], true, rtol=1e-5)
    # a second path beyond the unambiguous range stays beyond it
    np.testing.assert_allclose(maps.layer("mpi.depth").ravel()[5:11], echo, rtol=1e-5)
    np.testing.assert_array_equal(paths.paths.phase_rad, before)


def test_planar_depth_scales_depths_and_sigmas_after_field_curvature_is_subtracted() -> None:
    planar, offset = np.linspace(0.5, 1.0, 12), np.full(12, 0.1)
    paths = drawn(3)
    maps = written(paths, start=2, scale=DepthScale(METRES, VOLTS, planar, offset), layers=wanted_layers(paths=3))
    factor = planar[2:8]
    for name, one in zip(("direct", "mpi", "path3"), paths.paths, strict=True):
        depth = (one.phase_rad * METRES - 0.1) * factor
        np.testing.assert_allclose(maps.layer(f"{name}.depth").ravel()[2:8], depth, rtol=1e-6)
        np.testing.assert_allclose(maps.layer(f"{name}.sigma").ravel()[2:8], one.sigma_rad * METRES * factor, rtol=1e-6)
        np.testing.assert_allclose(maps.layer(f"{name}.amplitude").ravel()[2:8], one.amplitude * VOLTS, rtol=1e-6)


def test_further_layers_are_numbered_from_the_third_path_on() -> None:
    layers = wanted_layers(paths=4, searched=True, averaged=True)
    paths = drawn(4)
    maps = written(paths, start=0, layers=layers, samples=np.arange(6.0) + 2.0)
    for number, one in ((3, paths.paths[2]), (4, paths.paths[3])):
        np.testing.assert_allclose(maps.layer(f"path{number}.depth").ravel()[:6], one.phase_rad * METRES, rtol=1e-6)
    np.testing.assert_allclose(maps.layer("chi_squared").ravel()[:6], paths.chi_squared, rtol=1e-6)
    assert maps.layer("effective_pixels").ravel()[:7].tolist() == [2.0, 3.0, 4.0, 5.0, 6.0, 7.0, -1.0]
    assert (written(paths, start=0, layers=layers).layer("effective_pixels").ravel()[:6] == 1.0).all()


def test_maps_have_a_page_for_every_layer_and_one_for_the_status() -> None:
    layers = wanted_layers(paths=3, searched=True, averaged=True)
    maps = DepthMaps.empty(tuple(layer.name for layer in layers), (2, 5))
    assert maps.names == tuple(layer.name for layer in layers)
    assert maps.pages.shape == (len(layers) + 1, 2, 5)
    assert maps.values.shape == (len(layers), 2, 5)
    assert np.shares_memory(maps.layer("mpi.depth"), maps.pages[1])
    assert maps.status.shape == (2, 5)
    assert (maps.pages.dtype.name, maps.status.dtype.name) == ("float32", "uint32")


def test_no_answer_is_written_as_one_fixed_nan() -> None:
    """The sign of a NaN depends on the processor, so maps hold one fixed NaN."""
    paths = drawn()
    paths.paths.phase_rad[0, 1], paths.paths.phase_rad[0, 3] = np.nan, np.copysign(np.nan, -1.0)
    depth = written(paths, start=0).layer(DIRECT_DEPTH).ravel()
    np.testing.assert_array_equal(depth[[1, 3]].view(np.uint32), 0x7FC00000)


def test_depths_from_a_lamp_beside_the_camera_become_those_from_the_camera() -> None:
    """The lamp is .3 m ahead of the camera, so the light goes .3 m less than twice the range."""
    ahead = LampBeside(np.full(12, 0.15), 0.15)
    range_m, planar = np.linspace(1.0, 2.1, 12), np.linspace(0.8, 1.0, 12)
    half_way = range_m - 0.15
    for per_range in (None, planar):
        factor = 1.0 if per_range is None else per_range
        scale = DepthScale(METRES, VOLTS, planar_per_range=per_range, lamp=ahead)
        found = scale.from_camera((half_way * factor)[4:10], slice(4, 10))
        np.testing.assert_allclose(found, (range_m * factor)[4:10], rtol=1e-6)


def test_with_a_lamp_beside_the_camera_each_pixel_has_its_own_correction() -> None:
    rng = np.random.default_rng(4)
    ray = rng.normal(size=(3, 12)) + np.array([[0.0], [0.0], [3.0]])
    ray /= np.linalg.norm(ray, axis=0)
    offset, range_m = np.array([0.2, -0.1, 0.05]), rng.uniform(0.5, 4.0, 12)
    half_way = 0.5 * (np.linalg.norm(ray * range_m - offset[:, np.newaxis], axis=0) + range_m)
    lamp = LampBeside(0.5 * offset @ ray, 0.5 * float(np.linalg.norm(offset)))
    found = DepthScale(METRES, VOLTS, lamp=lamp).from_camera(half_way[6:], slice(6, 12))
    np.testing.assert_allclose(found, range_m[6:], rtol=1e-6)


def test_sigmas_follow_depths_from_a_lamp_beside_the_camera() -> None:
    rng = np.random.default_rng(4)
    lamp, depth, step = LampBeside(rng.uniform(-0.1, 0.1, 12), 0.15), rng.uniform(0.5, 4.0, 6), 1e-6
    block, sigma = slice(6, 12), rng.uniform(0.001, 0.01, 6)
    for planar in (None, np.linspace(0.8, 1.0, 12)):
        scale = DepthScale(METRES, VOLTS, planar_per_range=planar, lamp=lamp)
        grown = (scale.from_camera(depth + step, block) - scale.from_camera(depth, block)) / step
        np.testing.assert_allclose(scale.sigma_from_camera(sigma, depth, block), sigma * grown, rtol=1e-6)
    np.testing.assert_array_equal(SCALE.sigma_from_camera(sigma, depth, block), sigma)


@pytest.mark.parametrize("lamp_m", [8.0, 14.0])
def test_depths_are_those_of_the_shortest_ways_that_light_from_a_far_lamp_can_go(lamp_m: float) -> None:
    """The lamp is farther from the camera than the unambiguous range of 6 m. Half a way is at least half that distance, and
    seen is its remainder."""
    half_way = 0.5 * lamp_m + np.linspace(0.05, 5.94, 12)
    # to the lamp's side, so that the triangle of camera, lamp and surface has a right angle at the camera
    range_m = half_way - lamp_m**2 / (4.0 * half_way)
    np.testing.assert_allclose(np.hypot(range_m, lamp_m) + range_m, 2.0 * half_way)
    lamp = LampBeside(np.zeros(12), 0.5 * lamp_m)
    found = DepthScale(METRES, VOLTS, lamp=lamp).from_camera(half_way % (2.0 * np.pi * METRES), slice(0, 12))
    np.testing.assert_allclose(found, range_m, rtol=1e-9)
