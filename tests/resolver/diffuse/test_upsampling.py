"""From patches to pixels: a joint bilateral filter of the four nearest patches."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.grid import PatchGrid, assumed_view, patch_grid
from cadtof_cli.resolver.diffuse.upsampling import Upsampler, bands_of, upsampler
from tests.support.diffuse_frames import F

SIZES = [(1, 1), (5, 3), (37, 53), (48, 64), (240, 320), (61, 600)]


def ramp(grid: PatchGrid) -> Upsampler:
    """Return an upsampler of the planes 1, y and x of the patches' middles, in pixels; all patches are at 2 m."""
    y, x = np.mgrid[: grid.rows, : grid.columns] * grid.side + (grid.side - 1) / 2
    planes = np.stack([np.ones_like(y), y, x]).astype(np.float32)
    return upsampler(planes, np.full(y.shape, 2.0), np.ones(y.shape, bool), grid)


def everywhere(up: Upsampler, range_m: F) -> F:
    height, width = up.grid.height, up.grid.width
    whole = up.joint(slice(0, height * width), range_m.ravel().astype(np.float32))
    return whole.reshape(-1, height, width).astype(np.float64)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("step", [1, 7, 100, 19200])
def test_bands_cover_every_pixel_once_in_order(size: tuple[int, int], step: int) -> None:
    if size[0] * size[1] > 1000 * step:
        step *= 97
    up = ramp(patch_grid(*size, assumed_view(*size)))
    pixels = []
    for start in range(0, size[0] * size[1], step):
        for band in bands_of(up.grid, start, min(start + step, size[0] * size[1])):
            rows, columns = np.mgrid[band.top : band.bottom, band.left : band.right]
            assert {band.patch_row} == {int(np.floor((y + 0.5) / up.grid.side + 0.5)) for y in rows[:, 0]}
            places = (rows * size[1] + columns).ravel()
            np.testing.assert_array_equal(places, start + np.arange(band.pixels.start, band.pixels.stop))
            pixels.append(places)
    np.testing.assert_array_equal(np.concatenate(pixels), np.arange(size[0] * size[1]))


@pytest.mark.parametrize("size", SIZES)
def test_a_ramp_of_patches_is_a_ramp_of_pixels_between_their_middles(size: tuple[int, int]) -> None:
    up = ramp(patch_grid(*size, assumed_view(*size)))
    found = everywhere(up, np.full(size, 2.0))
    np.testing.assert_allclose(found[0], 1.0, rtol=1e-5)
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    last = [(n - 1) * up.grid.side + (up.grid.side - 1) / 2 for n in (up.grid.rows, up.grid.columns)]
    first = (up.grid.side - 1) / 2
    for plane, expected in ((found[1], np.clip(y, first, last[0])), (found[2], np.clip(x, first, last[1]))):
        np.testing.assert_allclose(plane, expected, atol=0.01 * up.grid.side)


def test_a_pixel_uses_patches_at_its_own_depth() -> None:
    grid = patch_grid(48, 64, assumed_view(48, 64))
    near = np.arange(grid.columns) < grid.columns // 2
    values = np.where(near, 1.0, 5.0) * np.ones((grid.rows, 1))
    range_m = np.where(near, 1.0, 3.0) * np.ones((grid.rows, 1))
    up = upsampler(values[None].astype(np.float32), range_m, np.ones(values.shape, bool), grid)
    edge = grid.columns // 2 * grid.side
    pixels = np.where(np.arange(64) < edge + 1, 1.0, 3.0) * np.ones((48, 1))
    found = everywhere(up, pixels)[0]
    np.testing.assert_allclose(found[:, : edge + 1], 1.0, atol=0.05)
    np.testing.assert_allclose(found[:, edge + 1 :], 5.0, atol=0.05)


def test_patches_without_a_surface_are_not_used() -> None:
    grid = patch_grid(48, 64, assumed_view(48, 64))
    valid = np.ones((grid.rows, grid.columns), bool)
    valid[3:5, 2:7] = False
    values = np.where(valid, 1.0, 99.0)
    up = upsampler(values[None].astype(np.float32), np.full(valid.shape, 2.0), valid, grid)
    near_hole = everywhere(up, np.full((48, 64), 2.0))[0, 2 * grid.side]
    np.testing.assert_allclose(near_hole, 1.0, atol=1e-3)


def patches_around(place: float, count: int) -> tuple[int, int, float]:
    """Return the patches before and after a position in units of patches, and how far it lies between them, 0 to 1.

    Beyond the edge, both are the patch at the edge.
    """
    before = int(np.floor(place))
    return max(before, 0), min(before + 1, count - 1), place - before


@pytest.mark.parametrize("size", [(13, 21), (37, 53)])
def test_weights_of_the_four_patches_follow_the_definition(size: tuple[int, int]) -> None:
    """The weights are (bilinear weight + .001)/(1 + (difference of range/.1 range)²)².

    `linear` uses the bilinear weights alone.
    """
    grid, rng = patch_grid(*size, assumed_view(*size)), np.random.default_rng(8)
    shape = (grid.rows, grid.columns)
    planes, range_m = rng.normal(size=(3, *shape)), rng.uniform(1.0, 3.0, shape)
    valid = rng.random(shape) < 0.9
    pixels = rng.uniform(1.0, 3.0, size)
    up = upsampler(planes.astype(np.float32), range_m, valid, grid)
    joint, known = everywhere(up, pixels), np.where(valid, range_m, 1000.0)
    linear = up.linear(1, slice(0, size[0] * size[1])).reshape(size)
    for row, column in np.ndindex(size):
        above, below, down = patches_around((row + 0.5) / grid.side - 0.5, shape[0])
        left, right, across = patches_around((column + 0.5) / grid.side - 0.5, shape[1])
        corners = [(above, left), (above, right), (below, left), (below, right)]
        bilinear = np.array([(1 - down) * (1 - across), (1 - down) * across, down * (1 - across), down * across])
        assert linear[row, column] == pytest.approx(bilinear @ [planes[1][corner] for corner in corners], abs=1e-5)
        differences = np.array([known[corner] - pixels[row, column] for corner in corners]) / (
            0.1 * pixels[row, column]
        )
        weights = (bilinear + 1e-3) / (1.0 + differences**2) ** 2
        expected = sum(w * planes[:, i, j] for w, (i, j) in zip(weights, corners, strict=True)) / weights.sum()
        np.testing.assert_allclose(joint[:, row, column], expected, atol=1e-4)
