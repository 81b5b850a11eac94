"""Frames whose MPI is a tail, resolved as `cadtof resolve` does: cropped, split over processes, and with any kernel."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli import simulate_scene
from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import open_frames, single_frames
from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.pipeline.frame import joined_parts, prepare_frame, resolve_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.pipeline.stages import FramePixels
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.status import StatusBit
from tests.support.blocks import blocks_of
from tests.support.kernels import by_kernel

CORNER = Path(__file__).parents[2] / "sample_data" / "corner"


@pytest.fixture(scope="module")
def corner() -> tuple[Stored, FramePlan]:
    (capture,) = find_captures([CORNER])
    source = next(iter(single_frames(capture)))
    with open_frames(source, capture.layout) as frames:
        return frames.read(source.index or 0), FramePlan(metadata=capture.source.metadata)


@pytest.mark.parametrize("count", [2, 3, 7])
def test_a_frame_in_parts_has_the_same_bits(corner: tuple[Stored, FramePlan], count: int) -> None:
    """The model of the tail goes with every part to another process, so it is pickled here."""
    stored, plan = corner
    stages = stages_of(stored, plan)
    pixels = prepare_frame(stored, stages)
    assert pixels.tail is not None
    sent: list[FramePixels] = pickle.loads(pickle.dumps(pixels.parts(count)))
    split = joined_parts(pixels, [resolve_pixels(part, stages) for part in sent])
    whole = resolve_frame(stored, plan=plan)
    np.testing.assert_array_equal(split.maps.values, whole.maps.values)
    np.testing.assert_array_equal(split.maps.status, whole.maps.status)
    assert split.mpi == whole.mpi
    assert whole.mpi is not None
    assert whole.mpi.taken == "diffuse"


@pytest.mark.parametrize("block_pixels", [97, 5000])
def test_blocks_of_any_size_have_the_same_bits(corner: tuple[Stored, FramePlan], block_pixels: int) -> None:
    stored, plan = corner
    whole = resolve_frame(stored, plan=plan).maps
    with blocks_of(block_pixels):
        cut = by_kernel(NUMPY, resolve_frame, stored, plan=plan).maps
    np.testing.assert_array_equal(cut.values, whole.values)
    np.testing.assert_array_equal(cut.status, whole.status)


def test_pixels_that_always_hold_a_value_beyond_light_are_left_out_of_the_prediction(
    corner: tuple[Stored, FramePlan],
) -> None:
    """A phasor of 1.7 is impossible. The other pixels get the answers that they get without these pixels."""
    stored, plan = corner
    voltage = plan.metadata.voltage
    volts = (stored - voltage.zero) * (voltage.volts_per_count or 1.0)
    in_volts = replace(plan, metadata=replace(plan.metadata, voltage=Voltage()))
    stuck, missing = volts.copy(), volts.copy()
    stuck[0, 0, 5::40, 5::40], missing[0, 0, 5::40, 5::40] = 1.7 * plan.metadata.modulation.amplitude_v, np.nan
    found, expected = (resolve_frame(one, plan=in_volts).maps for one in (stuck, missing))
    assert (found.status.reshape(240, 320)[5::40, 5::40] & StatusBit.IMPOSSIBLE).all()
    np.testing.assert_array_equal(found.values, expected.values)


def test_a_frame_with_separate_patches_has_the_same_bits_in_blocks_without_them() -> None:
    """In four patches, the second phasor leads, which no tail explains. With three harmonics, the maps also have χ²."""
    (frame,) = simulate_scene(
        "corner", modulation={"periods_ns": (40.0, 20.0, 13.33)}, camera={"width": 160, "height": 128}
    ).frames
    voltage = frame.metadata.voltage
    assert voltage.zero_counts is not None
    assert voltage.volts_per_count is not None
    volts = (frame.stored - voltage.zero_counts) * voltage.volts_per_count
    sc1, sc2 = volts[1, :, 48:64, 48:64].copy()
    cos, sin = np.cos(0.6), np.sin(0.6)
    volts[1, :, 48:64, 48:64] = cos * sc1 - sin * sc2, sin * sc1 + cos * sc2
    plan = FramePlan(metadata=replace(frame.metadata, voltage=Voltage()))
    whole = resolve_frame(volts, plan=plan)
    assert whole.mpi is not None
    assert whole.mpi.taken == "diffuse"
    tail = (whole.maps.status & StatusBit.DIFFUSE_MPI) > 0
    assert 0.95 < tail.mean() < 1.0
    assert "chi_squared" in whole.maps.names
    with blocks_of(160):
        rows = resolve_frame(volts, plan=plan).maps
    np.testing.assert_array_equal(rows.values, whole.maps.values)
    np.testing.assert_array_equal(rows.status, whole.maps.status)


def test_every_pixel_of_a_cropped_frame_has_an_answer(corner: tuple[Stored, FramePlan]) -> None:
    stored, plan = corner
    maps = resolve_frame(np.ascontiguousarray(stored[..., 3:200, 10:263]), plan=plan).maps
    assert np.isfinite(maps.layer("direct.depth")).all()
    assert ((maps.status & 2048) > 0).all()
