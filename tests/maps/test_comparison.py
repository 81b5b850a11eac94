"""Differences between two maps, compared with numpy over all values at once."""

import numpy as np
import pytest

from cadtof_cli.maps.comparison import MagnitudeTally, changed_bits, difference
from cadtof_cli.maps.evaluation import SequenceTally
from cadtof_cli.resolver.status import StatusBit


@pytest.mark.parametrize(("exact", "within"), [(10**6, 1e-6), (100, 4e-4)])
def test_quantiles_of_magnitudes_are_close_to_those_of_all_values(exact: int, within: float) -> None:
    rng = np.random.default_rng(0)
    tally, everything = MagnitudeTally(exact=exact), []
    for scale in (1e-4, 1.0, 30.0):
        values = rng.normal(scale=scale, size=(400, 500))
        values[0, :3] = np.nan, np.inf, 0.0
        tally.add(values)
        everything.append(values[np.isfinite(values)])
    sizes = np.abs(np.concatenate(everything))
    found = tally.summary()
    assert found.median_abs == pytest.approx(np.median(sizes), rel=within)
    assert found.p90_abs == pytest.approx(np.quantile(sizes, 0.9), rel=within)
    assert found.max_abs == pytest.approx(sizes.max(), rel=1e-7)


def test_values_beyond_float32_do_not_count() -> None:
    tally = MagnitudeTally()
    tally.add(np.array([1.5, -1e39, 1e300]))
    assert vars(tally.summary()) == dict.fromkeys(("median_abs", "p90_abs", "max_abs"), 1.5)


@pytest.mark.parametrize("sizes", [(5, 5), (1, 9), (10,), (3, 0, 7)])
def test_quantiles_are_exact_until_there_are_more_values_than_are_kept(sizes: tuple[int, ...]) -> None:
    """Between 1 and 2, a bin is 1/4096 of its value wide, and 1.3 is not the middle of a bin."""
    tally = MagnitudeTally(exact=10)
    for size in sizes:
        tally.add(np.full(size, -1.3))
    assert vars(tally.summary()) == {name: np.float32(1.3) for name in ("median_abs", "p90_abs", "max_abs")}
    tally.add(np.array([1.3]))
    found = tally.summary()
    assert found.median_abs is not None
    assert 1e-6 < abs(found.median_abs - 1.3) < 1.3 / 4096
    assert found.max_abs == np.float32(1.3)
    # from here on values are counted in bins, so later values are counted too
    for _ in range(3):
        tally.add(np.full(10, 2.6))
    assert tally.summary().median_abs == pytest.approx(2.6, rel=1 / 4096)


@pytest.mark.parametrize("exact", [10**6, 10])
def test_equal_maps_differ_by_0(exact: int) -> None:
    tally = MagnitudeTally(exact=exact)
    plane = np.full((5, 6), 2.5, np.float32)
    tally.add(difference(plane, plane))
    assert vars(tally.summary()) == {"median_abs": 0.0, "p90_abs": 0.0, "max_abs": 0.0}
    assert vars(MagnitudeTally().summary()) == {"median_abs": None, "p90_abs": None, "max_abs": None}


def test_gained_and_lost_status_bits_are_counted() -> None:
    before = np.array([[8, 16, 8], [1, 16, 0]], np.uint32)
    after = np.array([[8, 8, 24], [1, 2048, 0]], np.uint32)
    changes = changed_bits(before, after)
    assert {bit: (one.gained, one.lost) for bit, one in changes.items() if one.gained or one.lost} == {
        StatusBit.ONE_PATH: (1, 0),
        StatusBit.TWO_PATHS: (1, 2),
        StatusBit.DIFFUSE_MPI: (1, 0),
    }


def test_mean_scatter_and_sigma_over_time_are_those_of_numpy() -> None:
    rng = np.random.default_rng(2)
    depths = 3.0 + rng.normal(scale=1e-3, size=(7, 4, 5))
    depths[rng.random(depths.shape) < 0.4] = np.nan
    depths[:, 0, 0] = np.nan
    depths[1:, 0, 1], depths[0, 0, 1] = np.nan, 2.0
    sigmas = rng.uniform(1e-3, 2e-3, depths.shape)
    tally = SequenceTally((4, 5))
    for depth, sigma in zip(depths, sigmas, strict=True):
        tally.add(depth, sigma)
    found = tally.summary()
    count = np.isfinite(depths).sum(axis=0)
    np.testing.assert_array_equal(found.frames, count)
    for y, x in np.ndindex(4, 5):
        known = np.isfinite(depths[:, y, x])
        some, predicted = depths[known, y, x], sigmas[known, y, x]
        assert found.mean[y, x] == pytest.approx(some.mean() if count[y, x] else np.nan, rel=1e-6, nan_ok=True)
        assert found.std[y, x] == pytest.approx(some.std(ddof=1) if count[y, x] > 1 else np.nan, rel=1e-5, nan_ok=True)
        rms = np.sqrt(np.mean(predicted**2)) if count[y, x] else np.nan
        assert found.sigma[y, x] == pytest.approx(rms, rel=1e-6, nan_ok=True)
