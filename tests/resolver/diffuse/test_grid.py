"""The patches that a frame is cut into: their sizes, the pixels that are sampled, and the rays of these pixels."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse.grid import SHIFTS, PatchGrid, View, patch_grid, sampled_pixels

OFF_CENTRE = View(100.0, (30.5, 17.25))


def sampled_at(grid: PatchGrid, length: int, patches: int) -> list[list[int]]:
    """Return the sampled rows, or columns, of every patch: the middle one of each stride."""
    everywhere = [[pixel for pixel in range(length) if pixel // grid.side == patch] for patch in range(patches)]
    return [[pixel for pixel in pixels if pixel % grid.stride == grid.stride // 2] for pixels in everywhere]


@pytest.mark.parametrize(
    ("size", "side", "stride", "patches"),
    [
        ((240, 320), 16, 2, (15, 20)),
        ((480, 640), 32, 4, (15, 20)),
        ((1000, 1300), 64, 8, (16, 21)),
        ((120, 160), 8, 1, (15, 20)),
        ((48, 64), 4, 1, (12, 16)),
        ((9, 10), 4, 1, (3, 3)),
    ],
)
def test_a_frame_is_cut_into_about_300_squares_with_8_samples_a_side(
    size: tuple[int, int], side: int, stride: int, patches: tuple[int, int]
) -> None:
    """If 300 patches would have sides below 12 pixels, every pixel is sampled. A patch has at least 4 pixels a side."""
    grid = patch_grid(*size, OFF_CENTRE)
    assert (grid.side, grid.stride, (grid.rows, grid.columns)) == (side, stride, patches)
    assert (grid.height, grid.width, grid.view) == (*size, OFF_CENTRE)


@pytest.mark.parametrize(
    ("size", "side", "stride"), [((180, 240), 16, 2), ((207, 208), 12, 1), ((199, 217), 12, 1), ((40, 42), 4, 1)]
)
def test_from_43200_pixels_on_every_second_pixel_is_sampled(size: tuple[int, int], side: int, stride: int) -> None:
    """The limit is 43,200 pixels: 300 patches of 12 × 12."""
    grid = patch_grid(*size, OFF_CENTRE)
    assert (grid.side, grid.stride) == (side, stride)


@pytest.mark.parametrize("size", [(240, 320), (50, 70), (37, 53), (250, 330)])
def test_samples_are_spread_over_their_patch(size: tuple[int, int]) -> None:
    grid = patch_grid(*size, OFF_CENTRE)
    y, x = np.mgrid[: size[0], : size[1]]
    image = np.stack([y + 1, x + 1])
    found = grid.samples(image)
    rows, columns = sampled_at(grid, size[0], grid.rows), sampled_at(grid, size[1], grid.columns)
    per_side = grid.side // grid.stride
    assert found.shape == (2, per_side**2, grid.rows, grid.columns)
    for i, rows_inside in enumerate(rows):
        for j, across in enumerate(columns):
            expected = [(a + 1, b + 1) for a in rows_inside for b in across]
            samples = found[:, :, i, j]
            taken = samples[:, samples[0] > 0].T
            assert [tuple(pair) for pair in taken.tolist()] == expected
            assert (samples[1] > 0).tolist() == (samples[0] > 0).tolist()
    for part, length, sampled in zip(sampled_pixels(*size), size, (rows, columns), strict=True):
        assert list(range(length))[part] == [pixel for rows_inside in sampled for pixel in rows_inside]


@pytest.mark.parametrize("size", [(240, 320), (50, 70)])
def test_rays_of_samples_are_those_of_a_pinhole(size: tuple[int, int]) -> None:
    grid = patch_grid(*size, OFF_CENTRE)
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    inside = grid.samples(np.ones(size, bool))
    slope_x, slope_y = (x - 30.5) / 100.0, (y - 17.25) / 100.0
    cosine = 1.0 / np.sqrt(1.0 + slope_x**2 + slope_y**2)
    assert_allclose(grid.cosine[inside], grid.samples(cosine)[inside], rtol=1e-7)
    for middle, place, image in zip(grid.slope, grid.place, (slope_x, slope_y), strict=True):
        found = middle + place[:, None, None] * grid.stride / 100.0
        assert_allclose(found[inside], grid.samples(image)[inside])


def test_the_ray_of_a_patch_is_the_unit_vector_through_its_middle() -> None:
    grid = patch_grid(240, 320, OFF_CENTRE)
    assert_allclose(np.linalg.norm(grid.ray, axis=0), 1.0)
    middle_x, middle_y = np.arange(20) * 16 + 8.5, np.arange(15) * 16 + 8.5
    assert_allclose(grid.ray[0] / grid.ray[2], np.broadcast_to((middle_x - 30.5) / 100.0, (15, 20)), atol=0.01)
    assert_allclose(
        grid.ray[1] / grid.ray[2], np.broadcast_to((middle_y - 17.25)[:, None] / 100.0, (15, 20)), atol=0.01
    )
    assert (grid.ray[2] > 0.0).all()


@pytest.mark.parametrize("size", [(240, 320), (250, 330), (1000, 1300)])
def test_shifted_grids_sample_other_rows_and_columns_and_know_where(size: tuple[int, int]) -> None:
    grid = patch_grid(*size, OFF_CENTRE)
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    before = grid.samples(np.stack([y, x, np.ones_like(x)]))
    for shift in SHIFTS:
        other = patch_grid(*size, OFF_CENTRE, shift)
        assert (other.side, other.rows, other.columns) == (grid.side, grid.rows, grid.columns)
        rows, columns, inside = other.samples(np.stack([y, x, np.ones_like(x)]))
        both = (inside > 0) & (before[2] > 0)
        assert_allclose((before[0] - rows)[both], shift[0])
        assert_allclose((before[1] - columns)[both], shift[1])
        slopes = np.hypot(rows - OFF_CENTRE.principal_point_px[1], columns - OFF_CENTRE.principal_point_px[0]) / 100.0
        assert_allclose(other.cosine[inside > 0], (1.0 / np.sqrt(1.0 + slopes**2))[inside > 0], rtol=1e-6)
