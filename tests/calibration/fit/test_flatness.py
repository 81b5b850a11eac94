"""Medians of blocks: shapes stay, pixels' own values go."""

import numpy as np
import pytest

from cadtof_cli.calibration.fit.flatness import block_medians, shape_rms


def test_a_block_has_the_median_of_its_pixels() -> None:
    where = np.ones((24, 36), np.bool_)  # blocks of 2 × 2
    values = np.arange(24 * 36, dtype=np.float64)
    medians = block_medians(values, where)
    assert medians.size == 12 * 18
    assert medians[0] == np.median([0.0, 1.0, 36.0, 37.0])
    where[0, 0] = False
    assert block_medians(values[1:], where).size == 12 * 18 - 1  # three pixels are not enough


def test_a_shape_stays_and_noise_goes() -> None:
    rng = np.random.default_rng(4)
    where = rng.random((240, 320)) < 0.9
    step = np.where(np.arange(320) < 160, -0.05, 0.05)[np.newaxis] * np.ones((240, 1))
    noise = rng.normal(scale=0.05, size=(240, 320))
    assert shape_rms((step + noise)[where], where) == pytest.approx(0.05, rel=0.02)
    assert shape_rms(noise[where], where) < 0.001
    assert shape_rms(np.full(where.sum(), 0.02), where) == pytest.approx(0.02)
    assert shape_rms(np.zeros(0), np.zeros((4, 4), np.bool_)) == 0.0
