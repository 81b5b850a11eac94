"""Parts of a sensor with an offset of their own."""

from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.capture.metadata import Modulation, Voltage
from cadtof_cli.doubts.camera import stepped
from cadtof_cli.doubts.frame import camera_doubts
from tests.support.boxes import AMPLITUDE_V, KNOWN, SIZE, frame


@pytest.mark.parametrize("side", ["left and right", "upper and lower"])
@pytest.mark.parametrize("offset_v", [0.02, -0.003])
def test_a_part_of_the_sensor_with_an_offset_of_its_own_is_told(side: str, offset_v: float) -> None:
    """A quarter that is 20 mV brighter was 1 to 4 m off, with a sigma of millimetres, in silence."""
    # no edge of a box in the middle
    volts = np.roll(frame(), 10, axis=3)
    assert stepped(volts, KNOWN) is None
    if side == "left and right":
        volts[..., :40] += offset_v
    else:
        volts[..., 32:, :] += offset_v
    told = stepped(volts, KNOWN)
    assert told is not None
    assert told.startswith(f"the {side} halves differ by ")
    assert told in camera_doubts(volts, KNOWN)


def test_an_edge_of_the_scene_in_the_middle_is_no_offset() -> None:
    """All columns come to the middle in turn, and so do the edges of the boxes."""
    volts = frame(n_av=1e7)
    assert all(stepped(np.roll(volts, place, axis=3), KNOWN) is None for place in range(SIZE[1]))


def test_a_step_that_one_plane_does_not_show_is_an_edge_of_the_scene() -> None:
    """An offset of a part of the sensor is the same in all planes."""
    step = np.full((3, 2, 1, 1), 0.02)
    volts = np.random.default_rng(1).normal(0.0, 5e-4, (3, 2, *SIZE))
    known = replace(KNOWN, modulation=Modulation(periods_ns=(40.0, 20.0, 40.0 / 3.0)))
    volts[..., 40:] += step
    assert stepped(volts, known) is not None
    for change in (0.012, -0.012):
        step = np.zeros((3, 2, 1, 1))
        step[1, 1] = change
        edge = volts.copy()
        edge[..., 40:] += step
        assert stepped(edge, known) is None


@pytest.mark.parametrize("rows", [slice(32), slice(32, None)])
@pytest.mark.parametrize("columns", [slice(40), slice(40, None)])
@pytest.mark.parametrize("offset_v", [0.02, 0.0016, 0.0006])
def test_a_quarter_of_the_sensor_with_an_offset_of_its_own_is_told(
    rows: slice, columns: slice, offset_v: float
) -> None:
    """From a two hundredth of the modulation amplitude: less is millimetres."""
    volts = np.roll(frame(n_av=1e6), 10, axis=3)
    volts[..., rows, columns] += offset_v
    told = stepped(volts, KNOWN)
    assert (told is not None) == (offset_v > 0.005 * AMPLITUDE_V)
    if told is not None:
        step_mv = float(told.split(" differ by ")[1].split(" mV")[0])
        assert step_mv == pytest.approx(1000.0 * (-offset_v if columns.start is None else offset_v), rel=0.1)


def test_saturated_pixels_hide_no_step() -> None:
    volts = np.roll(frame(n_av=1e6, size=(160, 80)), 10, axis=3)
    volts[..., 40:] += 0.003
    volts[0, 0, np.arange(160) % 3 > 0] = 0.25
    assert stepped(volts, KNOWN) is None
    assert stepped(volts, replace(KNOWN, voltage=Voltage(saturated_counts=(-0.25, 0.25)))) is not None


def test_values_that_rise_evenly_over_the_sensor_have_no_step() -> None:
    """As of heat from one side; a step on top is told."""
    volts = np.random.default_rng(1).normal(0.0, 5e-4, (2, 2, *SIZE)) + 2e-3 * np.arange(80)
    assert stepped(volts, KNOWN) is None
    volts[..., 40:] += 5e-3
    told = stepped(volts, KNOWN)
    assert told is not None
    assert float(told.split(" differ by ")[1].split(" mV")[0]) == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize(("width", "is_told"), [(6, True), (7, True), (5, False)])
def test_a_step_shows_from_three_columns_on_either_side(width: int, is_told: bool) -> None:
    volts = np.random.default_rng(1).normal(0.0, 5e-4, (2, 2, 64, width))
    volts[..., width // 2 :] += 0.01
    assert (stepped(volts, KNOWN) is not None) == is_told
