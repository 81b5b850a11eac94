"""Field curvature from ranges that are known: walls by intersecting rays, curvature added by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray

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
) -> WallRanges:
    """Return the noisy ranges of the plane n·p = D with n = (nx, ny, 1), bent by the curvature."""
    y, x = np.mgrid[: PIXELS[0], : PIXELS[1]].astype(np.float64)
    rays = np.stack([(x - 39.5) / focal_px, (y - 29.5) / focal_px, np.ones(PIXELS)])
    times = distance_m / np.tensordot(np.array([*normal, 1.0]), rays, axes=1)
    rho2 = ((x - 39.5) ** 2 + (y - 29.5) ** 2) / (40.0**2 + 30.0**2)
    noise = np.random.default_rng(seed).normal(0.0, SIGMA_M, PIXELS)
    ranges = times * np.linalg.norm(rays, axis=0) + K2_M * rho2 + K4_M * rho2**2 + noise
    return WallRanges(ranges % RANGE_M, np.full(PIXELS, SIGMA_M), distance_m if known else None)


def fitted(*walls: WallRanges, optics: Optics = OPTICS) -> PetzvalCalibration:
    origin = Origin(
        captures=tuple(f"wall_{index}" for index in range(len(walls))),
        frames=len(walls),
        pixels=PIXELS,
        periods_ns=(40.0, 20.0),
        waveform="sine",
    )
    return fit_petzval(walls, optics=optics, unambiguous_m=RANGE_M, origin=origin)


def deviations(found: PetzvalCalibration) -> tuple[float, float]:
    """Return how many standard errors the coefficients are off."""
    return (
        abs(found.k2_m - K2_M) / found.quality.k2_stderr_m,
        abs(found.k4_m - K4_M) / found.quality.k4_stderr_m,
    )


def test_two_tilted_walls_at_unknown_distances() -> None:
    found = fitted(measured_wall(1.0, seed=1), measured_wall(3.0, seed=2, normal=(-0.04, 0.07)))
    assert max(deviations(found)) < 3.0
    assert found.quality.rms_after_m < 1.1 * SIGMA_M
    assert found.quality.rms_before_m > 2.0 * found.quality.rms_after_m
    assert found.quality.walls[0].slopes == pytest.approx((0.05, -0.03), abs=2e-3)
    assert found.quality.walls[1].distance_m == pytest.approx(3.0, abs=1e-3)


def test_standard_errors_are_those_of_repetitions() -> None:
    runs = [fitted(measured_wall(1.0, seed=2 * s), measured_wall(3.0, seed=2 * s + 1)) for s in range(25)]
    scatter = np.std([run.k2_m for run in runs])
    assert scatter == pytest.approx(runs[0].quality.k2_stderr_m, rel=0.4)


def test_a_known_distance_stays_and_narrows_the_error() -> None:
    free = fitted(measured_wall(1.0, seed=1))
    known = fitted(measured_wall(1.0, seed=1, known=True))
    assert known.quality.walls[0].distance_m == 1.0
    assert known.quality.walls[0].distance_known
    assert known.quality.k2_stderr_m < free.quality.k2_stderr_m
    assert max(deviations(known)) < 3.0


def spoilt(ranges: NDArray[np.float64], kind: str) -> NDArray[np.float64]:
    """Return ranges with what a real wall has beside noise."""
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
def test_what_is_not_wall_has_no_say(kind: str) -> None:
    walls = [measured_wall(distance, seed=seed) for seed, distance in ((3, 1.0), (4, 3.0))]
    found = fitted(*(WallRanges(spoilt(wall.range_m, kind), wall.sigma_m, None) for wall in walls))
    assert max(deviations(found)) < 3.5


def test_ranges_that_wrap_at_the_end_of_the_unambiguous_range() -> None:
    wall = measured_wall(5.5, seed=5)
    assert (wall.range_m < 2.0).any()
    assert max(deviations(fitted(wall, measured_wall(1.0, seed=6)))) < 3.0


def test_without_optics_two_distances_give_the_focal_length_too() -> None:
    found = fitted(measured_wall(1.0, seed=1), measured_wall(3.0, seed=2), optics=Optics())
    assert found.quality.focal_length_px == pytest.approx(70.0, rel=5e-3)
    assert max(deviations(found)) < 3.0
    assert any("no focal length given: fitted" in text for text in found.quality.findings)


@pytest.mark.parametrize("distances", [(1.0,), (1.0, 1.1)])
def test_without_optics_one_distance_is_refused(distances: tuple[float, ...]) -> None:
    with pytest.raises(SettingsError, match=r"the optics are unknown.*set focal_length_px under \[optics\]"):
        fitted(*(measured_wall(d, seed=1) for d in distances), optics=Optics())


def test_a_wall_in_a_narrow_part_of_the_view_warns_with_the_numbers() -> None:
    """In the middle ± 8 px of 80, ρ² hardly changes: distance, tilt and curvature go together."""
    wall = measured_wall(1.0, seed=1)
    ranges = np.full(PIXELS, np.nan)
    ranges[22:38, 32:48] = wall.range_m[22:38, 32:48]
    found = fitted(WallRanges(ranges, wall.sigma_m, None))
    warned = [text for text in found.quality.findings if text.startswith("warning: curvature, distance and tilt")]
    assert len(warned) == 1
    assert f"± {found.quality.k2_stderr_m:.4f} m" in warned[0]
    assert "condition" in warned[0]


def test_a_wall_seen_by_few_pixels_is_refused() -> None:
    wall = measured_wall(1.0, seed=1)
    ranges = np.full(PIXELS, np.nan)
    ranges[:2, :20] = wall.range_m[:2, :20]
    with pytest.raises(
        SettingsError, match=r"wall 1 \(wall_0\): found 40 pixels with a single path, expected at least 50"
    ):
        fitted(WallRanges(ranges, wall.sigma_m, None))
