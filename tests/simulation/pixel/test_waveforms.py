"""The series of the modulation add up to the waves, which are written here as straight lines."""

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Waveform
from cadtof_cli.simulation.pixel.waveforms import (
    highest_order,
    mean_square,
    phasor_series,
    product_series,
    sampled_pair,
    square_series,
)

PHASES = np.linspace(-np.pi, np.pi, 721)


def straight_lines(phases: Float) -> Float:
    """A triangle that peaks at 0 with 1 and falls to −1 at ±π."""
    wrapped = np.mod(phases + np.pi, 2 * np.pi) - np.pi
    return np.asarray(1.0 - 2.0 * np.abs(wrapped) / np.pi)


def test_triangle_phasor_series_adds_up_to_two_triangles_a_quarter_apart() -> None:
    total = sum(c * np.exp(1j * n * PHASES) for n, c in phasor_series("triangle", 4001))
    np.testing.assert_allclose(np.real(total), straight_lines(PHASES), atol=3e-4)
    np.testing.assert_allclose(np.imag(total), straight_lines(PHASES - np.pi / 2), atol=3e-4)


def test_sine_phasor_series_is_one_turn() -> None:
    assert list(phasor_series("sine", 99)) == [(1, 1.0)]


def test_triangle_square_series_adds_up_to_its_square() -> None:
    total = mean_square("triangle") + sum(np.real(c) * np.cos(n * PHASES) for n, c in square_series("triangle", 8000))
    np.testing.assert_allclose(total, straight_lines(PHASES) ** 2, atol=2e-4)


@pytest.mark.parametrize(
    ("waveform", "first", "second"),
    [
        ("sine", np.cos(PHASES), np.sin(PHASES)),
        ("triangle", straight_lines(PHASES), straight_lines(PHASES - np.pi / 2)),
    ],
)
def test_product_series_adds_up_to_the_product(waveform: Waveform, first: Float, second: Float) -> None:
    total = np.zeros_like(PHASES)
    for n, coefficient in product_series(waveform, 2000):
        total += np.real(coefficient) * np.sin(n * PHASES)
    np.testing.assert_allclose(total, first * second, atol=1e-6)


@pytest.mark.parametrize("number", [np.float32, np.float64])
def test_sampled_triangles_are_straight_lines(number: type[np.float32] | type[np.float64]) -> None:
    phases: Float = np.linspace(0, 6 * np.pi, 1000).astype(number)
    first, second = sampled_pair("triangle", phases.copy())
    assert first.dtype == number
    np.testing.assert_allclose(first, straight_lines(phases), atol=3e-6)
    np.testing.assert_allclose(second, straight_lines(phases - np.pi / 2), atol=3e-6)


def test_orders_end_where_the_pulse_extinguishes_them() -> None:
    assert highest_order((1, 2), "sine", 0.0) == 4
    wide, narrow = highest_order((1, 2), "triangle", 0.113), highest_order((1, 2), "triangle", 0.0113)
    assert np.exp(-((wide * 0.113) ** 2) / 2) < 1e-16
    assert narrow == pytest.approx(10 * wide, rel=0.02)
