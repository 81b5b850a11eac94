"""Field curvature from known ranges: rays are intersected with walls here, and curvature is added."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cadtof_cli.calibration.fit.petzval import WallRanges, fit_petzval
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.petzval import PetzvalCalibration
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.errors import SettingsError

PIXELS = (60, 80)
OPTICS = Optics(focal_length_px=70.0, principal_point_px=(39.5, 29.5))
K2_M, K4_M = 0.06, -0.02
SIGMA_M = 0.003
RANGE_M = 5.99584916


def measured_wall(
    distance_m: float,
    *,
    seed: int,
    normal: tuple[float, float] = (0.05, -0.03),
    known: bool = False,
    focal_px: float = 70.0,
    sigma_m: float = SIGMA_M,
) -> WallRanges:
    """Return noisy ranges of the plane n·p = D, n = (nx, ny, 1), with the field curvature added."""
    y, x = np.mgrid[: PIXELS[0], : PIXELS[1]].astype(np.float64)
    rays = np.stack([(x - 39.5) / focal_px, (y - 29.5) / focal_px, np.ones(PIXELS)])
    times = distance_m / np.tensordot(np.array([*normal, 1.0]), rays, axes=1)
    rho2 = ((x - 39.5) ** 2 + (y - 29.5) ** 2) / (40.0**2 + 30.0**2)
    noise = np.random.default_rng(seed).normal(0.0, sigma_m, PIXELS)
    ranges = times * np.linalg.norm(rays, axis=0) + K2_M * rho2 + K4_M * rho2**2 + noise
    return WallRanges(ranges % RANGE_M, np.full(PIXELS, sigma_m), distance_m if known else None)


def fitted(*walls: WallRanges, optics: Optics = OPTICS) -> PetzvalCalibration:
    origin = Origin(
        captures=tuple(f"wall_{index}" for index in range(len(walls))),
        frames=len(walls),
        pixels=PIXELS,
        periods_ns=(40.0, 20.0),
        waveform="sine",
    )
    return fit_petzval(walls, optics=optics, origin=origin)


def errors_of(found: PetzvalCalibration) -> list[float]:
    """Return the standard errors of the coefficients, then those of the distances of the walls."""
    curvature, walls = found.curvature, found.quality.walls
    return [curvature.k2_stderr_m, curvature.k4_stderr_m, *(wall.distance_stderr_m for wall in walls)]


def deviations(found: PetzvalCalibration) -> tuple[float, float]:
    """Return how many standard errors the coefficients are off."""
    return (
        abs(found.curvature.k2_m - K2_M) / found.curvature.k2_stderr_m,
        abs(found.curvature.k4_m - K4_M) / found.curvature.k4_stderr_m,
    )


def test_curvature_is_found_from_two_tilted_walls_at_unknown_distances() -> None:
    found = fitted(measured_wall(1.0, seed=1), measured_wall(3.0, seed=2, normal=(-0.04, 0.07)))
    assert max(deviations(found)) < 3.0
    assert found.quality.rms_after_m < 1.1 * SIGMA_M
    assert found.quality.rms_before_m > 2.0 * found.quality.rms_after_m
    assert found.quality.walls[0].slopes == pytest.approx((0.05, -0.03), abs=2e-3)
    assert found.quality.walls[1].distance_m == pytest.approx(3.0, abs=1e-3)


def test_the_curvature_lengthens_the_way_of_the_light_of_a_lamp_beside_the_camera() -> None:
    """Close to the camera, the range grows faster than half that way: by a tenth at 10 cm, with this lamp."""
    offset, optics = np.array([0.07, 0.0, 0.0]), replace(OPTICS, lamp_offset_m=(0.07, 0.0, 0.0))
    y, x = np.mgrid[: PIXELS[0], : PIXELS[1]].astype(np.float64)
    rays = np.stack([(x - 39.5) / 70.0, (y - 29.5) / 70.0, np.ones(PIXELS)])
    rays /= np.linalg.norm(rays, axis=0)
    added = measured_wall(1.0, seed=0, sigma_m=0.0).range_m - 1.0 / np.tensordot([0.05, -0.03, 1.0], rays, axes=1)
    walls, sigma_m = [], 1e-4
    for seed, distance_m in enumerate((0.1, 0.2)):
        surface = rays * (distance_m / np.tensordot([0.05, -0.03, 1.0], rays, axes=1))
        to_lamp = np.linalg.norm(surface - offset[:, np.newaxis, np.newaxis], axis=0)
        half_way = 0.5 * (np.linalg.norm(surface, axis=0) + to_lamp) + added
        half_way += np.random.default_rng(seed).normal(0.0, sigma_m, PIXELS)
        along = 0.5 * np.tensordot(offset, rays, axes=1)
        ranges = (half_way**2 - 0.035**2) / (half_way - along)
        walls.append(WallRanges(ranges, sigma_m * (2.0 * half_way - ranges) / (half_way - along), None))
    found = fitted(*walls, optics=optics)
    assert max(deviations(found)) < 3.0
    assert found.quality.rms_after_m == pytest.approx(sigma_m, rel=0.03)
    for wall, distance_m in zip(found.quality.walls, (0.1, 0.2), strict=True):
        assert abs(wall.distance_m - distance_m) < 3.0 * wall.distance_stderr_m
        assert wall.slopes == pytest.approx((0.05, -0.03), abs=5e-4)


def test_standard_errors_with_a_lamp_beside_the_camera_follow_from_finite_differences() -> None:
    """As of walls 10 and 20 cm before the camera, where the range grows by up to a tenth more than half the way of the light."""
    offset, optics = np.array([0.07, 0.0, 0.0]), replace(OPTICS, lamp_offset_m=(0.07, 0.0, 0.0))
    y, x = np.mgrid[: PIXELS[0], : PIXELS[1]].astype(np.float64)
    rays = np.stack([(x - 39.5) / 70.0, (y - 29.5) / 70.0, np.ones(PIXELS)])
    rays /= np.linalg.norm(rays, axis=0)
    rho2 = ((x - 39.5) ** 2 + (y - 29.5) ** 2) / (40.0**2 + 30.0**2)

    def half_ways(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        k2, k4, *planes = parameters
        ways = []
        for distance, *slopes in (planes[:3], planes[3:]):
            surface = rays * (distance / np.tensordot([*slopes, 1.0], rays, axes=1))
            to_lamp = np.linalg.norm(surface - offset[:, np.newaxis, np.newaxis], axis=0)
            ways.append(0.5 * (np.linalg.norm(surface, axis=0) + to_lamp) + k2 * rho2 + k4 * rho2**2)
        return np.stack(ways)

    truth, sigma_m = np.array([K2_M, K4_M, 0.1, 0.05, -0.03, 0.2, -0.04, 0.07]), 1e-5
    along, walls = 0.5 * np.tensordot(offset, rays, axes=1), []
    for seed, way in enumerate(half_ways(truth)):
        half_way = way + np.random.default_rng(seed).normal(0.0, sigma_m, PIXELS)
        ranges = (half_way**2 - 0.035**2) / (half_way - along)
        walls.append(WallRanges(ranges, sigma_m * (2.0 * half_way - ranges) / (half_way - along), None))
    made = fitted(*walls, optics=optics)
    slopes = least_squares(lambda p: half_ways(p).ravel(), truth, jac="3-point", max_nfev=1).jac
    errors = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))[[0, 1, 2, 5]]
    found = np.array(errors_of(made))
    np.testing.assert_allclose(found / found[0], errors / errors[0], rtol=1e-3)


def test_the_standard_error_is_the_scatter_of_repetitions() -> None:
    runs = [fitted(measured_wall(1.0, seed=2 * s), measured_wall(3.0, seed=2 * s + 1)) for s in range(25)]
    scatter = np.std([run.curvature.k2_m for run in runs])
    assert scatter == pytest.approx(runs[0].curvature.k2_stderr_m, rel=0.4)


def test_a_known_distance_is_kept_and_makes_the_standard_error_smaller() -> None:
    free = fitted(measured_wall(1.0, seed=1))
    known = fitted(measured_wall(1.0, seed=1, known=True))
    assert known.quality.walls[0].distance_m == 1.0
    assert known.quality.walls[0].distance_known
    assert known.quality.walls[0].distance_stderr_m == 0.0
    assert known.curvature.k2_stderr_m < free.curvature.k2_stderr_m
    assert max(deviations(known)) < 3.0


def spoilt(ranges: NDArray[np.float64], kind: str) -> NDArray[np.float64]:
    """Return ranges with one kind of error that a real wall has besides noise."""
    ranges = ranges.copy()
    rng = np.random.default_rng(9)
    if kind == "object in view":
        ranges[20:45, 50:70] -= 0.4
    elif kind == "MPI at the borders":
        ranges[:6] += rng.exponential(0.1, (6, 80))
        ranges[:, -6:] += rng.exponential(0.1, (60, 6))
    elif kind == "hot pixels":
        bad = rng.random(PIXELS) < 0.02
        ranges[bad] = rng.uniform(0.0, RANGE_M, int(bad.sum()))
    else:
        ranges[rng.random(PIXELS) < 0.3] = np.nan
    return ranges


@pytest.mark.parametrize("kind", ["object in view", "MPI at the borders", "hot pixels", "pixels without an answer"])
def test_pixels_that_do_not_show_the_wall_do_not_count(kind: str) -> None:
    walls = [measured_wall(distance, seed=seed) for seed, distance in ((3, 1.0), (4, 3.0))]
    found = fitted(*(WallRanges(spoilt(wall.range_m, kind), wall.sigma_m, None) for wall in walls))
    assert max(deviations(found)) < 3.5


def test_ranges_that_wrap_at_the_end_of_the_unambiguous_range_are_no_outliers() -> None:
    wall = measured_wall(5.5, seed=5)
    assert (wall.range_m < 2.0).any()
    found = fitted(wall, measured_wall(1.0, seed=6))
    assert max(deviations(found)) < 3.0
    # hardly any Gaussian residual is an outlier, and ranges that wrap are no outliers either
    for fit in found.quality.walls:
        assert fit.pixels > 0.999 * PIXELS[0] * PIXELS[1]
    assert found.quality.walls[0].distance_m == pytest.approx(5.5, abs=2e-3)
    assert found.quality.rms_after_m < 1.1 * SIGMA_M


def test_the_distance_is_that_of_the_middle_if_most_of_a_wall_wraps() -> None:
    found = fitted(measured_wall(5.7, seed=1))
    assert found.quality.walls[0].distance_m == pytest.approx(5.7, abs=2e-3)
    assert max(deviations(found)) < 3.0


def test_without_a_principal_point_the_middle_of_the_array_is_used_and_reported() -> None:
    """The principal point of these walls is at column 39.5 and row 29.5, the middle of 80 × 60 pixels."""
    found = fitted(measured_wall(1.0, seed=1), measured_wall(3.0, seed=2), optics=Optics(focal_length_px=70.0))
    assert found.curvature.principal_point_px == (39.5, 29.5)
    assert max(deviations(found)) < 3.0
    assert any("column 39.5 and row 29.5, is taken" in text for text in found.quality.findings)


def test_without_optics_two_distances_also_give_the_focal_length() -> None:
    found = fitted(measured_wall(1.0, seed=1), measured_wall(3.0, seed=2), optics=Optics())
    assert found.quality.focal_length_px == pytest.approx(70.0, rel=5e-3)
    assert max(deviations(found)) < 3.0
    assert any("no focal length given: fitted" in text for text in found.quality.findings)


def test_without_optics_distances_a_fifth_apart_are_enough() -> None:
    """Given distances of 2 and 2.4 m are a fifth apart to the bit."""
    for far_m, known in ((2.45, False), (2.4, True)):
        walls = (measured_wall(d, seed=1, sigma_m=1e-4, known=known) for d in (2.0, far_m))
        assert fitted(*walls, optics=Optics()).quality.focal_length_px == pytest.approx(70.0, rel=5e-3)


@pytest.mark.parametrize("distances", [(1.0,), (1.0, 1.15)])
def test_without_optics_one_distance_is_refused(distances: tuple[float, ...]) -> None:
    with pytest.raises(SettingsError, match=r"the focal length is unknown.*set focal_length_px under \[optics\]"):
        fitted(*(measured_wall(d, seed=1) for d in distances), optics=Optics())


def test_a_wall_in_a_narrow_part_of_the_view_warns_with_the_numbers() -> None:
    """Within ± 8 px of the middle of 80, ρ² hardly changes: distance, tilt and curvature are hard to separate."""
    wall = measured_wall(1.0, seed=1)
    ranges = np.full(PIXELS, np.nan)
    ranges[22:38, 32:48] = wall.range_m[22:38, 32:48]
    found = fitted(WallRanges(ranges, wall.sigma_m, None))
    warned = [text for text in found.quality.findings if text.startswith("warning: curvature, distance and tilt")]
    assert len(warned) == 1
    assert f"± {found.curvature.k2_stderr_m:.4f} m" in warned[0]
    assert "condition" in warned[0]


def test_a_wall_seen_by_few_pixels_is_refused() -> None:
    wall = measured_wall(1.0, seed=1)
    ranges = np.full(PIXELS, np.nan)
    ranges[:2, :20] = wall.range_m[:2, :20]
    with pytest.raises(
        SettingsError, match=r"wall 1 \(wall_0\): found 40 pixels with a single path, expected at least 50"
    ):
        fitted(WallRanges(ranges, wall.sigma_m, None))


def two_walls() -> tuple[WallRanges, WallRanges]:
    return measured_wall(1.0, seed=1), measured_wall(3.0, seed=2, normal=(-0.04, 0.07))


def test_a_good_fit_has_no_findings_and_residuals_of_the_predicted_noise() -> None:
    quality = fitted(*two_walls()).quality
    assert quality.findings == ()
    assert quality.noise_rms_m == pytest.approx(SIGMA_M)
    assert quality.rms_after_m == pytest.approx(SIGMA_M, rel=0.05)
    assert quality.focal_length_px == pytest.approx(70.0)
    assert quality.focal_length_known
    assert 0.7 < quality.correlation < 0.999
    for wall in quality.walls:
        assert not wall.distance_known
        assert wall.noise_rms_m == pytest.approx(SIGMA_M)
        assert wall.rms_after_m == pytest.approx(SIGMA_M, rel=0.05)
        assert wall.rms_before_m > 2.0 * SIGMA_M


def test_distances_tilts_and_standard_errors_agree_with_repetitions() -> None:
    runs = [
        fitted(measured_wall(1.0, seed=50 + 2 * s), measured_wall(3.0, seed=51 + 2 * s)).quality.walls
        for s in range(25)
    ]
    for wall, distance in ((0, 1.0), (1, 3.0)):
        found = np.array([run[wall].distance_m for run in runs])
        assert found.std() == pytest.approx(runs[0][wall].distance_stderr_m, rel=0.4)
        assert found.mean() == pytest.approx(distance, abs=4 * runs[0][wall].distance_stderr_m / 5)
        slopes = np.array([run[wall].slopes for run in runs])
        np.testing.assert_allclose(slopes.mean(axis=0), [0.05, -0.03], atol=1e-3)


@pytest.mark.parametrize(("share", "warned"), [(0.04, False), (0.07, True)])
def test_pixels_off_the_walls_are_reported_from_a_twentieth_on(share: float, warned: bool) -> None:
    walls = []
    for wall in two_walls():
        ranges = wall.range_m.copy()
        ranges[np.random.default_rng(4).random(PIXELS) < share] -= 0.5
        walls.append(WallRanges(ranges, wall.sigma_m, None))
    found = fitted(*walls)
    texts = [text for text in found.quality.findings if "do not lie on the walls and were left out" in text]
    assert len(texts) == warned
    kept = sum(wall.pixels for wall in found.quality.walls) / (2 * PIXELS[0] * PIXELS[1])
    assert kept == pytest.approx(1 - share, abs=0.01)


@pytest.mark.parametrize(("factor", "warned"), [(1.4, False), (1.7, True)])
def test_residuals_beyond_one_and_a_half_times_the_noise_are_warned_of(factor: float, warned: bool) -> None:
    walls = [WallRanges(wall.range_m, wall.sigma_m / factor, None) for wall in two_walls()]
    found = fitted(*walls)
    assert any(text.startswith("warning: the residual, 3.0") for text in found.quality.findings) == warned
    # the standard error follows the observed scatter, not the predicted noise
    assert found.curvature.k2_stderr_m == pytest.approx(fitted(*two_walls()).curvature.k2_stderr_m, rel=0.02)


def test_pixels_with_more_noise_have_less_weight() -> None:
    """The lower half of both walls has much more noise. k2 is nearly the same as without that half."""
    walls, halves = [], []
    for index, wall in enumerate(two_walls()):
        ranges, sigma = wall.range_m.copy(), wall.sigma_m.copy()
        ranges[30:] += np.random.default_rng(70 + index).normal(0.0, 0.2, (30, 80))
        sigma[30:] = 0.2
        walls.append(WallRanges(ranges, sigma, None))
        half = wall.range_m.copy()
        half[30:] = np.nan
        halves.append(WallRanges(half, wall.sigma_m, None))
    found, expected = fitted(*walls), fitted(*halves)
    assert found.curvature.k2_m == pytest.approx(expected.curvature.k2_m, abs=0.3 * expected.curvature.k2_stderr_m)
    assert max(deviations(found)) < 3.0


@pytest.mark.parametrize(("sigma_m", "warned"), [(0.04, False), (0.075, True)])
def test_standard_errors_above_a_centimetre_are_warned_of(sigma_m: float, warned: bool) -> None:
    found = fitted(measured_wall(1.0, seed=1, sigma_m=sigma_m), measured_wall(3.0, seed=2, sigma_m=sigma_m))
    largest = max(found.curvature.k2_stderr_m, found.curvature.k4_stderr_m)
    assert (0.01 < largest < 0.02) == warned
    assert any(text.startswith("warning: curvature, distance and tilt") for text in found.quality.findings) == warned


def test_rms_before_is_the_residual_of_walls_without_curvature() -> None:
    """The expected residual comes from scipy's least squares for distance and tilts alone."""
    quality = fitted(*two_walls()).quality
    y, x = np.mgrid[: PIXELS[0], : PIXELS[1]].astype(np.float64)
    u, v = (x - 39.5) / 70.0, (y - 29.5) / 70.0
    squares, count = 0.0, 0
    for wall, found in zip(two_walls(), quality.walls, strict=True):

        def residuals(values: NDArray[np.float64], wall: WallRanges = wall) -> NDArray[np.float64]:
            distance, alpha, beta = values
            model = distance * np.sqrt(1.0 + u * u + v * v) / (1.0 + alpha * u + beta * v)
            return np.asarray((wall.range_m - model).ravel())

        best = least_squares(residuals, [found.distance_m, 0.0, 0.0], loss="soft_l1", f_scale=0.05)
        mean_square = float(np.mean(residuals(best.x) ** 2))
        assert found.rms_before_m == pytest.approx(np.sqrt(mean_square), rel=0.1)
        squares, count = squares + mean_square, count + 1
    assert quality.rms_before_m == pytest.approx(np.sqrt(squares / count), rel=0.1)


def ranges_of(parameters: NDArray[np.float64], focal_px: float | None) -> NDArray[np.float64]:
    """Return the ranges of two walls, one after the other.

    The parameters are k2 and k4, the focal length if it is not known, and for each wall its distance and the slopes of
    its normal.
    """
    k2, k4, *rest = parameters
    focal = rest.pop(0) if focal_px is None else focal_px
    y, x = np.mgrid[: PIXELS[0], : PIXELS[1]].astype(np.float64)
    u, v = (x - 39.5) / focal, (y - 29.5) / focal
    rho2 = ((x - 39.5) ** 2 + (y - 29.5) ** 2) / (40.0**2 + 30.0**2)
    flat = [
        distance * np.sqrt(1.0 + u * u + v * v) / (1.0 + slope_x * u + slope_y * v)
        for distance, slope_x, slope_y in (rest[:3], rest[3:])
    ]
    return np.stack([wall + k2 * rho2 + k4 * rho2**2 for wall in flat]).ravel()


@pytest.mark.parametrize("focal_px", [70.0, None])
def test_standard_errors_and_correlation_follow_from_finite_differences(focal_px: float | None) -> None:
    """The expected covariance comes from scipy's finite differences of the ranges by all parameters."""
    walls = measured_wall(1.0, seed=1, sigma_m=1e-5), measured_wall(3.0, seed=2, normal=(-0.04, 0.07), sigma_m=1e-5)
    made = fitted(*walls, optics=replace(OPTICS, focal_length_px=focal_px))
    truth = [K2_M, K4_M, *([70.0] if focal_px is None else []), 1.0, 0.05, -0.03, 3.0, -0.04, 0.07]
    slopes = least_squares(lambda p: ranges_of(p, focal_px), truth, jac="3-point", max_nfev=1).jac
    covariance = np.linalg.inv(slopes.T @ slopes)
    errors = np.sqrt(np.diag(covariance))
    found = errors_of(made)
    expected = errors[[0, 1, -6, -3]]
    np.testing.assert_allclose(np.array(found) / found[0], expected / expected[0], rtol=1e-3)
    assert found[0] == pytest.approx(1e-5 * errors[0], rel=0.06)
    correlation = np.abs(covariance / np.outer(errors, errors))[:2, 2:].max()
    assert made.quality.correlation == pytest.approx(correlation, rel=1e-4)


def walls_with_columns_off(columns: int, off_m: float) -> tuple[WallRanges, WallRanges]:
    """Return two walls; in the second, so many of the 16 columns of blocks are nearer or farther by `off_m`."""
    first, second = measured_wall(1.0, seed=1), measured_wall(3.0, seed=2)
    ranges = second.range_m.copy()
    for number in range(columns):
        column = 2 * number % 15
        ranges[:, 5 * column : 5 * column + 5] += off_m if number % 2 else -off_m
    return first, WallRanges(ranges, second.sigma_m, None)


@pytest.mark.parametrize(("columns", "share"), [(6, None), (7, "56%"), (9, "44%")])
def test_three_fifths_of_the_blocks_must_lie_on_the_wall(columns: int, share: str | None) -> None:
    walls = walls_with_columns_off(columns, 0.3)
    if share is None:
        assert max(deviations(fitted(*walls))) < 3.5
        return
    message = (
        rf"wall 2 \(wall_1\): {share} of the parts with a single path lie on a flat wall, within 20 mm and noise, "
        "expected 60% or"
    )
    with pytest.raises(SettingsError, match=message):
        fitted(*walls)


def test_just_three_fifths_of_the_blocks_are_enough() -> None:
    """Without the last column of blocks, 6 of 15 are off."""
    first, second = walls_with_columns_off(6, 0.3)
    second.range_m[:, 75:] = np.nan
    assert max(deviations(fitted(first, second))) < 3.5


@pytest.mark.parametrize(("off_m", "flat"), [(0.021, True), (0.025, False)])
def test_blocks_lie_on_the_wall_within_two_centimetres_and_noise(off_m: float, flat: bool) -> None:
    """The noise of a pixel is 3 mm."""
    if flat:
        fitted(*walls_with_columns_off(8, off_m))
        return
    with pytest.raises(SettingsError, match=r"wall 2 .* it is not a flat wall"):
        fitted(*walls_with_columns_off(8, off_m))


def test_a_wall_of_scattered_pixels_is_not_tested_for_flatness() -> None:
    """No block has enough pixels for a median, so that flatness is not tested."""
    assert max(deviations(fitted(*(every_fifth(wall) for wall in two_walls())))) < 3.5


def every_fifth(wall: WallRanges, pixels: int = 192) -> WallRanges:
    """Return every fifth pixel of every fifth row, at most `pixels` of them."""
    ranges = np.full(PIXELS, np.nan)
    ranges[::5, ::5] = wall.range_m[::5, ::5]
    chosen = np.random.default_rng(1).permutation(np.flatnonzero(np.isfinite(ranges)))
    ranges.reshape(-1)[chosen[pixels:]] = np.nan
    return WallRanges(ranges, wall.sigma_m, wall.distance_m)


@pytest.mark.parametrize("pixels", [49, 50])
def test_a_wall_needs_fifty_pixels(pixels: int) -> None:
    near, far = two_walls()
    if pixels == 50:
        assert max(deviations(fitted(near, every_fifth(far, pixels)))) < 3.0
        return
    with pytest.raises(
        SettingsError, match=r"wall 2 \(wall_1\): found 49 pixels with a single path, expected at least 50"
    ):
        fitted(near, every_fifth(far, pixels))


@pytest.mark.parametrize(("focal_px", "distance_m"), [(25.0, 2.4), (20.0, 2.0), (35.0, 3.3)])
def test_a_wide_lens_may_see_a_wall_over_the_whole_unambiguous_range(focal_px: float, distance_m: float) -> None:
    """The corners of the view are more than twice as far away as its middle."""
    walls = [measured_wall(d, seed=1, focal_px=focal_px) for d in (distance_m, 0.5)]
    assert np.max(walls[0].range_m) > 5.0
    found = fitted(*walls, optics=replace(OPTICS, focal_length_px=focal_px))
    assert found.quality.walls[0].distance_m == pytest.approx(distance_m, abs=2e-3)
    assert max(deviations(found)) < 3.0


def test_pixels_half_the_unambiguous_range_behind_a_wall_are_left_out() -> None:
    """A tenth of the pixels is farther by half the unambiguous range; a whole unambiguous range makes no difference."""
    wall = measured_wall(1.0, seed=1)
    ranges = wall.range_m.copy()
    behind = np.random.default_rng(11).random(PIXELS) < 0.1
    ranges[behind] += 0.5 * RANGE_M
    quality = fitted(WallRanges(ranges, wall.sigma_m, None)).quality
    assert quality.walls[0].pixels == pytest.approx((~behind).sum(), rel=2e-3)
    ranges[behind] += 0.5 * RANGE_M
    assert fitted(WallRanges(ranges, wall.sigma_m, None)).quality.walls[0].pixels > 0.999 * behind.size


def test_without_optics_a_wall_without_any_answer_is_refused_and_named() -> None:
    nothing = WallRanges(np.full(PIXELS, np.nan), np.full(PIXELS, np.nan), None)
    with pytest.raises(SettingsError, match=r"wall 2 \(wall_1\): found 0 pixels"):
        fitted(measured_wall(1.0, seed=1), nothing, optics=Optics())


@pytest.mark.parametrize("seed", range(4))
def test_a_very_long_focal_length_is_refused_or_fitted_positive(seed: int) -> None:
    """With such a narrow view, the range of a wall depends on the pixel by less than noise."""
    walls = [
        measured_wall(distance, seed=10 * seed + index, focal_px=5000.0) for index, distance in enumerate((1.0, 3.0))
    ]
    if seed in {0, 1}:
        with pytest.raises(SettingsError, match=r"cannot be found from the walls: .* set focal_length_px"):
            fitted(*walls, optics=Optics())
        return
    found = fitted(*walls, optics=Optics())
    assert found.quality.focal_length_px > 0.0
    assert np.isfinite([wall.slopes for wall in found.quality.walls]).all()


def test_a_single_row_of_pixels_shows_the_curvature_of_a_wall_that_leans_along_it() -> None:
    across, row = np.arange(320) - 159.5, (1, 320)
    optics = Optics(focal_length_px=280.0)
    rho2 = across**2 / (0.25 * (320.0**2 + 1.0))
    ray = across / 280.0
    walls = []
    for seed, (distance_m, slope) in enumerate(((1.0, 0.05), (3.0, -0.04))):
        noise = np.random.default_rng(seed).normal(0.0, SIGMA_M / 10, row)
        ranges = distance_m * np.sqrt(1.0 + ray**2) / (1.0 + slope * ray) + K2_M * rho2 + K4_M * rho2**2 + noise
        walls.append(WallRanges(ranges, np.full(row, SIGMA_M / 10), None))
    origin = Origin(captures=("a", "b"), frames=2, pixels=row, periods_ns=(40.0, 20.0), waveform="sine")
    found = fit_petzval(walls, optics=optics, origin=origin)
    assert max(deviations(found)) < 3.0
    assert found.quality.walls[0].slopes == pytest.approx((0.05, 0.0), abs=2e-3)


@pytest.mark.parametrize("wrong_m", [-0.04, 0.014, 0.04])
def test_a_given_distance_that_the_frames_contradict_is_refused(wrong_m: float) -> None:
    """A wall at 1 m whose distance was given as 1.04 m made k2 -0.15 ± 0.001 m in place of 0.06 m."""
    known = replace(measured_wall(1.0, seed=1), distance_m=1.0 + wrong_m)
    message = (
        rf"wall_0\): the frames show it at 1\.00\d m, expected its given distance of {1.0 + wrong_m:g} m, within 10 mm"
    )
    with pytest.raises(SettingsError, match=message):
        fitted(known, measured_wall(3.0, seed=2))


def test_of_several_given_distances_the_contradicted_one_is_refused() -> None:
    """If the distance is far off, all of that wall's ranges are outliers: "a wall or distance has no usable pixels" was said."""
    for wrong_m in (2.04, 1.4):
        walls = [measured_wall(distance_m, seed=seed, known=True) for seed, distance_m in enumerate((1.0, 2.0, 3.0))]
        walls[1] = replace(walls[1], distance_m=wrong_m)
        message = rf"wall 2 \(wall_1\): the frames show it at 2\.00\d m, .* given distance of {wrong_m:g} m"
        with pytest.raises(SettingsError, match=message):
            fitted(*walls)


@pytest.mark.parametrize("wrong_m", [-0.004, 0.0, 0.004])
def test_a_given_distance_that_is_a_few_millimetres_off_is_taken(wrong_m: float) -> None:
    found = fitted(replace(measured_wall(1.0, seed=1), distance_m=1.0 + wrong_m), measured_wall(3.0, seed=2))
    assert found.quality.walls[0].distance_m == 1.0 + wrong_m
    assert found.quality.walls[0].distance_known
    told = [finding for finding in found.quality.findings if "mm from its given distance" in finding]
    assert len(told) == (wrong_m != 0.0)
    if told:
        (wall, shown_m, apart_mm, k2_m) = re.findall(r"wall (\d) at (\S+) m, (\S+) mm .* k2 would be (\S+) m", told[0])[
            0
        ]
        assert wall == "1"
        assert (float(shown_m), float(apart_mm)) == pytest.approx((1.0, 4.0), abs=0.5)
        assert float(k2_m) == pytest.approx(K2_M, abs=0.003)


@pytest.mark.parametrize(
    ("true_m", "given_m"), [((1.0,), (1.0 + RANGE_M,)), ((7.5,), (7.5 - RANGE_M,)), ((1.0, 2.5), (7.0, 8.5))]
)
def test_given_distances_that_are_wrong_by_the_unambiguous_range_are_refused(
    true_m: tuple[float, ...], given_m: tuple[float, ...]
) -> None:
    """The phases are right, but no lens has the curvature of 1.5 m that makes up for it."""
    walls = [measured_wall(distance, seed=seed) for seed, distance in enumerate(true_m)]
    message = r"k2 = -?1\.\d\d\d m is more than any lens has, expected 0\.5 m at most: .* range of 5\.996 m"
    with pytest.raises(SettingsError, match=message):
        fitted(*(replace(wall, distance_m=given) for wall, given in zip(walls, given_m, strict=True)))


def test_a_given_distance_beyond_the_unambiguous_range_is_taken() -> None:
    assert max(deviations(fitted(measured_wall(7.5, seed=1, known=True, normal=(0.0, 0.0))))) < 3.0
