"""Second paths that change over the view bend surfaces, and two paths make them smooth again; tails of rooms do not."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Bool
from cadtof_cli.resolver.diffuse import smoothness
from cadtof_cli.resolver.diffuse.grid import PatchGrid, View, patch_grid
from cadtof_cli.resolver.diffuse.light import PatchLight, PatchMeans, patch_means, sampled_light
from cadtof_cli.resolver.diffuse.smoothness import are_smoothed_by_two_paths
from cadtof_cli.resolver.kernels import available_kernels
from tests.support.diffuse_frames import OMEGA, F, Tail, Z, corner_range, phasors_of, variance, wall_range
from tests.support.diffuse_patches import traits_of
from tests.support.kernels import by_kernel

HEIGHT, WIDTH, FOCAL_PX = 96, 128, 110.0

SIDE = 6
"""Side of a patch of such a frame, in pixels."""


def wall(tilt: tuple[float, float] = (0.2, 0.1), distance_m: float = 2.0) -> F:
    return wall_range(HEIGHT, WIDTH, FOCAL_PX, distance_m, tilt)


def changing_paths(block_px: int, *, share: float = 0.3, seed: int = 1) -> dict[int, Z]:
    """Return the MPI of second paths, 3 to 12 ns late, whose delays and shares are random for every block of pixels."""
    rng = np.random.default_rng(seed)
    rows, columns = (np.arange(side) // block_px * block_px for side in (HEIGHT, WIDTH))
    drawn = rng.uniform(size=(2, HEIGHT, WIDTH))[:, rows[:, None], columns]
    delay_ns, shares = 3.0 + 9.0 * drawn[0], share * (0.1 + 0.9 * drawn[1])
    return {h: np.asarray(shares * np.exp(1j * h * OMEGA * delay_ns)) for h in (1, 2)}


def patches_of(
    range_m: F, mpi: dict[int, Z] | dict[int, complex] | None, *, n_av: float = 1e6
) -> tuple[PatchLight, PatchMeans, PatchGrid]:
    """Return the light of a frame, its means, and its grid of patches."""
    phasors = phasors_of(range_m, mpi, n_av=n_av)
    grid = patch_grid(HEIGHT, WIDTH, View(FOCAL_PX, ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)))
    assert (grid.side, grid.stride) == (SIDE, 1)
    light = sampled_light(phasors, np.ones((HEIGHT, WIDTH), bool), grid, harmonics=(1, 2))
    return light, patch_means(light, light.seen, traits_of((1, 2), variance(n_av))), grid


def is_smoothed(frame: tuple[PatchLight, PatchMeans, PatchGrid], lit: Bool | None = None) -> bool:
    light, means, grid = frame
    every = np.ones(means.amplitude.shape, np.bool_)
    given = light, means, every if lit is None else lit
    answers = {
        by_kernel(kernel, are_smoothed_by_two_paths, *given, traits_of((1, 2), 0.0, grid))
        for kernel in available_kernels()
    }
    assert len(answers) == 1
    return answers.pop()


@pytest.mark.parametrize("block_px", [1, 6, 12, 24])
@pytest.mark.parametrize("seed", range(3))
def test_second_paths_that_change_over_the_view_are_taken_for_two_paths(block_px: int, seed: int) -> None:
    """They change from pixel to pixel within patches, from patch to patch, or over two or four patches."""
    assert is_smoothed(patches_of(wall(), changing_paths(block_px, seed=seed)))


@pytest.mark.parametrize("range_m", [wall(), corner_range(HEIGHT, WIDTH, FOCAL_PX)])
@pytest.mark.parametrize("tail", [Tail(0.15, 3.0, 6.0), Tail(0.3, 3.0, 10.0), Tail(0.5, 5.0, 8.0)])
@pytest.mark.parametrize("n_av", [1e4, 1e6])
def test_a_smooth_tail_is_not_taken_for_two_paths(range_m: F, tail: Tail, n_av: float) -> None:
    """This includes a tail that is stronger by half in the middle of the view."""
    down, across = np.mgrid[-1 : 1 : HEIGHT * 1j, -1 : 1 : WIDTH * 1j]
    bump = 1.0 + 0.5 * np.exp(-3.0 * (down**2 + across**2))
    for scale in (np.ones_like(bump), bump):
        assert not is_smoothed(patches_of(range_m, {h: np.asarray(scale * tail.phasor(h)) for h in (1, 2)}, n_av=n_av))


@pytest.mark.parametrize("seed", range(3))
def test_tails_that_change_from_patch_to_patch_are_not_taken_for_two_paths(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = (np.arange(side) // SIDE * SIDE for side in (HEIGHT, WIDTH))
    scale = rng.uniform(0.5, 1.5, (HEIGHT, WIDTH))[np.ix_(rows, columns)]
    assert not is_smoothed(patches_of(wall(), {h: np.asarray(scale * Tail(0.3, 3.0, 10.0).phasor(h)) for h in (1, 2)}))


def test_noise_and_no_light_are_not_taken_for_two_paths() -> None:
    assert not is_smoothed(patches_of(wall(), None))
    assert not is_smoothed(patches_of(wall(), None, n_av=2e3))
    assert not is_smoothed(patches_of(wall(), changing_paths(1), n_av=100.0))
    light, means, grid = patches_of(wall(), changing_paths(1))
    nothing = PatchLight(np.zeros_like(light.seen), 0 * light.phase_rad, 0 * light.weighted)
    assert not is_smoothed((nothing, means, grid), np.zeros(means.amplitude.shape, np.bool_))


@pytest.mark.parametrize("distance_m", [0.5, 2.9, 4.5])
def test_the_inverse_depth_of_a_flat_wall_has_no_bends_at_any_distance(distance_m: float) -> None:
    _, means, grid = patches_of(wall((0.4, -0.3), distance_m), None, n_av=1e12)
    inverse_depth = smoothness._inverse_depth(means.phase_rad, traits_of((1, 2), 0.0, grid))
    everywhere = np.ones(inverse_depth.shape, np.bool_)
    bends = smoothness._bends(inverse_depth, everywhere, 2)
    # for patches that extend beyond the frame, the mean is not that of the middle
    assert np.median(np.abs(bends)) < 0.01 * np.median(np.abs(smoothness._bends(means.phase_rad, everywhere, 2)))
    rows, columns = inverse_depth.shape
    assert bends.size == (rows - 4) * columns + rows * (columns - 4)


@pytest.mark.parametrize("distance", [1, 2])
def test_bends_are_second_differences_where_all_three_values_are_seen(distance: int) -> None:
    image = np.arange(8.0)[:, None] ** 2 + 10.0 * np.arange(5.0) ** 2
    seen_here = np.ones(image.shape, np.bool_)
    assert set(smoothness._bends(image, seen_here, distance)) == {2.0 * distance**2, 20.0 * distance**2}
    seen_here[2 * distance, 2] = False
    bends = smoothness._bends(image, seen_here, distance)
    lost_down = sum(0 <= 2 * distance - k * distance <= 7 - 2 * distance for k in range(3))
    lost_across = sum(0 <= 2 - k * distance <= 4 - 2 * distance for k in range(3))
    assert bends.size == (8 - 2 * distance) * 5 + 8 * (5 - 2 * distance) - lost_down - lost_across


@pytest.mark.parametrize(("left_share", "expected"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("count", [63, 64])
def test_at_most_a_share_of_the_median_square_is_left_of_at_least_64_bends(
    left_share: float, expected: bool, count: int
) -> None:
    bends = np.where(np.arange(count) % 2, 1.0, -1.0)
    assert smoothness._are_smoother(np.sqrt(0.1 * left_share) * bends, bends, 0.1) is (expected and count == 64)


def test_each_distance_of_patches_has_its_own_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only lit patches count. The last limit is for the pixels of their middle rows."""
    light, means, grid = patches_of(wall(), changing_paths(6))
    limits = []

    def recording(direct: F, recorded: F, limit: float) -> bool:
        assert direct.size == recorded.size
        limits.append((direct.size, limit))
        return False

    monkeypatch.setattr(smoothness, "_are_smoother", recording)
    rows, columns = means.amplitude.shape
    lit = np.ones((rows, columns), np.bool_)
    lit[:, -1] = False
    columns -= 1
    assert not are_smoothed_by_two_paths(light, means, lit, traits_of((1, 2), 0.0, grid))
    # a third of the last column of patches lies in the view
    pixels = int(light.seen[: SIDE - 2, lit].sum())
    between = [(rows - 2 * distance) * columns + rows * (columns - 2 * distance) for distance in (1, 2)]
    assert limits == [(between[0], 0.08), (between[1], 0.04), (pixels, 0.1)]


def test_surfaces_at_the_camera_count_as_five_centimetres_away() -> None:
    _, means, grid = patches_of(wall(), None)
    nothing = np.full(means.amplitude.shape, 1e-9)
    assert_allclose(smoothness._inverse_depth(nothing, traits_of((1, 2), 0.0, grid)) * grid.ray[2], 20.0)


@pytest.mark.parametrize("row", range(SIDE))
def test_the_middle_row_of_each_patch_is_used(row: int) -> None:
    """The wall's phase is just below π, and MPI turns half of the pixels beyond π, where phases jump by a full turn."""
    light, means, _ = patches_of(np.full((HEIGHT, WIDTH), 2.89), changing_paths(1))
    assert 0.4 < np.mean(light.phase_rad[:, :, :-1] < 0.0) < 0.6
    hidden = (np.arange(len(light.seen)) // SIDE == row)[:, None, None]
    every = np.ones(means.amplitude.shape, np.bool_)
    with np.errstate(all="ignore"):
        answer = smoothness._smoothed_within_patches(replace(light, seen=light.seen & ~hidden), every)
    assert answer is (row != SIDE // 2)


def test_within_patches_only_pixels_that_are_seen_count() -> None:
    """Pixels whose neighbours are hot or saturated give no bends; all other pixels of the middle rows do."""
    light, means, _ = patches_of(wall(), changing_paths(1))
    column, every = np.arange(len(light.seen)) % SIDE, np.ones(means.amplitude.shape, np.bool_)

    def is_smoothed_with(columns: Bool, lit: Bool) -> bool:
        with np.errstate(all="ignore"):
            return smoothness._smoothed_within_patches(replace(light, seen=light.seen & columns[:, None, None]), lit)

    assert is_smoothed_with(column < 3, every)
    assert not is_smoothed_with(column < 3, ~every)
    assert not is_smoothed_with(column % 3 != 1, every)
