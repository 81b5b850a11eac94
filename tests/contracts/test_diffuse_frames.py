"""Frames whose MPI is a tail, resolved as `cadtof resolve` does: cropped, split over processes, and with any kernel."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import open_frames, single_frames
from cadtof_cli.pipeline.frame import joined_parts, prepare_frame, resolve_frame, resolve_pixels
from cadtof_cli.pipeline.pixels import FramePixels
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.kernels import NUMPY
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
    pixels = prepare_frame(stored, plan=plan)
    assert pixels.tail is not None
    sent: list[FramePixels] = pickle.loads(pickle.dumps(pixels.parts(count)))
    split = joined_parts(pixels, [resolve_pixels(part, plan=plan) for part in sent])
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


def test_every_pixel_of_a_cropped_frame_has_an_answer(corner: tuple[Stored, FramePlan]) -> None:
    stored, plan = corner
    maps = resolve_frame(np.ascontiguousarray(stored[..., 3:200, 10:263]), plan=plan).maps
    assert np.isfinite(maps.layer("direct.depth")).all()
    assert ((maps.status & 2048) > 0).all()
