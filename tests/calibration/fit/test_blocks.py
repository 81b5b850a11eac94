"""Medians of blocks keep shapes over the array, and average out the values of single pixels."""

import numpy as np
import pytest

from cadtof_cli.calibration.fit.robust import blocks, shape_rms


def test_a_block_has_the_median_of_its_pixels() -> None:
    where = np.ones((24, 36), np.bool_)  # blocks of 2 × 2
    values = np.arange(24 * 36, dtype=np.float64)
    medians = [np.median(values[block]) for block in blocks(where)]
    assert len(medians) == 12 * 18
    assert medians[0] == np.median([0.0, 1.0, 36.0, 37.0])
    where[0, 0] = False
    assert len(blocks(where)) == 12 * 18 - 1  # three pixels are not enough


@pytest.mark.parametrize(("shorter", "side"), [(24, 2), (25, 3), (12, 2), (120, 10), (121, 11)])
def test_the_shorter_side_has_at_most_twelve_blocks_of_at_least_two_pixels(shorter: int, side: int) -> None:
    """The values are the numbers of their columns, so every median occurs once per row of blocks."""
    where = np.ones((shorter, 132), np.bool_)
    values = np.broadcast_to(np.arange(132.0), where.shape).ravel()
    medians = [np.median(values[block]) for block in blocks(where)]
    columns = sorted({float(median) for median in medians})
    assert columns[1] - columns[0] == side
    # the last row of blocks counts if its blocks have at least four pixels
    assert len(medians) // len(columns) in {shorter // side, -(-shorter // side)}


def test_the_noise_of_medians_and_three_deviations_of_it_are_subtracted() -> None:
    """The shape is as large as the noise of the medians, in 144 blocks of 100 pixels.

    The variance of a median is π/2 times that of a mean. Three standard deviations of this estimate are subtracted too.
    """
    noise = np.pi / 2 / 100
    shape = np.sqrt(noise) * np.where(np.arange(120) // 10 % 2, 1.0, -1.0)
    squares = []
    for seed in range(60):
        values = shape + np.random.default_rng(seed).normal(size=(120, 120))
        squares.append(shape_rms(values.ravel(), np.ones((120, 120), np.bool_)) ** 2)
    assert np.mean(squares) / noise == pytest.approx(1.0 - 3.0 * np.sqrt(2.0 / 144), abs=0.08)


def test_a_shape_is_kept_and_noise_is_averaged_out() -> None:
    rng = np.random.default_rng(4)
    where = rng.random((240, 320)) < 0.9
    step = np.where(np.arange(320) < 160, -0.05, 0.05)[np.newaxis] * np.ones((240, 1))
    noise = rng.normal(scale=0.05, size=(240, 320))
    assert shape_rms((step + noise)[where], where) == pytest.approx(0.05, rel=0.02)
    assert shape_rms(noise[where], where) < 0.001
    assert shape_rms(np.full(where.sum(), 0.02), where) == pytest.approx(0.02)
    assert shape_rms(np.zeros(0), np.zeros((4, 4), np.bool_)) == 0.0


@pytest.mark.parametrize("half_m", [0.0, 0.3, 0.8])
def test_the_noise_of_medians_follows_from_the_unbiased_variance_within_blocks(half_m: float) -> None:
    """In blocks of 2 × 2 pixels, two values are `half_m` above a median of 1, and two as far below.

    Their unbiased variance is 4/3·half_m².
    """
    values = 1.0 + half_m * np.where(np.arange(24) % 2, 1.0, -1.0)[np.newaxis] * np.ones((24, 1))
    chance = np.pi / 2 * (4.0 / 3.0 * half_m**2) / 4.0
    expected = 1.0 - (1.0 + 3.0 * np.sqrt(2.0 / 144)) * chance
    assert shape_rms(values.ravel(), np.ones((24, 24), np.bool_)) == pytest.approx(np.sqrt(expected))
