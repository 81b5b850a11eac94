"""A contract for every reader: it returns the recorded values, bit for bit, in the order H C Y X."""

import pickle
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.files.formats import FORMATS, detect_format
from cadtof_cli.files.frames import FrameLayout
from tests.files.forms import FORMS, Form, exr, known_frame, tiff

LAYOUT = FrameLayout((1, 2))

SAMPLE_TYPES = ("u1", "u2", "u4", "i2", "i4", "f2", "f4", "f8")


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_frame_comes_back_bit_for_bit(form: Form, tmp_path: Path) -> None:
    recorded = known_frame(form.dtype)
    source = form.write(tmp_path / "frame_0000", recorded)
    with open_frames(source, LAYOUT) as frames:
        frame = frames.read(0)
        assert (frames.count, frames.shape, frames.dtype) == (1, recorded.shape, recorded.dtype)
    _assert_same(frame, recorded)


def _assert_same(frame: Stored, recorded: Stored) -> None:
    assert frame.dtype == recorded.dtype
    assert frame.dtype.isnative
    assert frame.flags.c_contiguous
    assert frame.shape == recorded.shape
    assert frame.tobytes() == recorded.tobytes()


def test_every_format_keeps_the_contract(tmp_path: Path) -> None:
    written = {form.write(tmp_path / form.name, known_frame(form.dtype)).paths[0] for form in FORMS}
    lost = {one.name for one in FORMATS if one.magics} - {detect_format(path).name for path in written}
    assert not lost, f"tests/files/forms.py, FORMS, needs a form of {', '.join(lost)}: all readers are tested with them"


@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("dtype", SAMPLE_TYPES)
def test_every_sample_type_of_either_byte_order_is_read(dtype: str, byteorder: Any, tmp_path: Path) -> None:
    recorded = known_frame(dtype)
    source = tiff(byteorder=byteorder, metadata={"axes": "HCYX"})(tmp_path / "frame", recorded)
    with open_frames(source, LAYOUT) as frames:
        _assert_same(frames.read(0), recorded)


@pytest.mark.parametrize(("write", "dtype"), [(tiff(), "f4"), (exr(), "f4"), (exr(), "f2")])
def test_nan_and_infinities_stay_as_they_are(write: Callable[..., FrameSource], dtype: str, tmp_path: Path) -> None:
    recorded = known_frame(dtype)
    recorded[0, 0, 0, :3] = np.nan, np.inf, -np.inf
    with open_frames(write(tmp_path / "frame", recorded), LAYOUT) as frames:
        _assert_same(frames.read(0), recorded)


@pytest.mark.parametrize("harmonics", [(1,), (1, 2, 3)])
def test_frames_of_any_number_of_harmonics_are_read(harmonics: tuple[int, ...], tmp_path: Path) -> None:
    recorded = np.arange(len(harmonics) * 2 * 5 * 7, dtype="u2").reshape(-1, 2, 5, 7)
    source = tiff(metadata=None)(tmp_path / "frame", recorded.reshape(-1, 5, 7))
    with open_frames(source, FrameLayout(harmonics)) as frames:
        _assert_same(frames.read(0), recorded)


def test_one_harmonic_needs_no_number_in_exr(tmp_path: Path) -> None:
    recorded = known_frame("f4")[:1]
    path = tmp_path / "frame.exr"
    OpenEXR.File({}, {"SC1": recorded[0, 0].copy(), "SC2": recorded[0, 1].copy()}, num_threads=0).write(str(path))
    with open_frames(FrameSource("frame", (path,)), FrameLayout((1,))) as frames:
        _assert_same(frames.read(0), recorded)


@pytest.mark.parametrize("names", [("H1", "H3"), ("H1", "H2")], ids=["numbers", "places"])
def test_harmonics_in_exr_are_called_by_number_or_place(names: tuple[str, str], tmp_path: Path) -> None:
    recorded = known_frame("f4")
    path = tmp_path / "frame.exr"
    channels = {f"{names[h]}.SC{c + 1}": recorded[h, c].copy() for h in range(2) for c in range(2)}
    channels["H5.SC1"] = channels["confidence"] = np.zeros_like(recorded[0, 0])
    OpenEXR.File({}, channels, num_threads=0).write(str(path))
    with open_frames(FrameSource("frame", (path,)), FrameLayout((1, 3))) as frames:
        _assert_same(frames.read(0), recorded)


def test_the_format_follows_from_the_content_of_a_file_not_from_its_name(tmp_path: Path) -> None:
    recorded = known_frame("f4")
    source = exr()(tmp_path / "frame", recorded)
    disguised = source.paths[0].rename(tmp_path / "frame.tif")
    with open_frames(FrameSource("frame", (disguised,)), LAYOUT) as frames:
        _assert_same(frames.read(0), recorded)


Arrange = Callable[[Stored], Stored]

STACKS: list[tuple[str, dict[str, Any], Arrange, int | None]] = [
    ("shaped-THCYX", {"metadata": {"axes": "THCYX"}}, lambda s: s, None),
    ("shaped-HCTYX", {"metadata": {"axes": "HCTYX"}}, lambda s: np.moveaxis(s, 0, 2), None),
    ("shaped-unlabelled", {}, lambda s: s, None),
    ("shaped-planes", {}, lambda s: s.reshape(len(s), 4, *s.shape[3:]), None),
    ("shaped-tiles-deflate", {"tile": (16, 16), "compression": "zlib"}, lambda s: s, None),
    ("pages", {"metadata": None}, lambda s: s.reshape(-1, *s.shape[3:]), 3),
    ("pages-deflate", {"metadata": None, "compression": "zlib"}, lambda s: s.reshape(-1, *s.shape[3:]), 3),
    ("ome-TZC", {"ome": True, "metadata": {"axes": "TZCYX"}}, lambda s: s, None),
    ("ome-CZT", {"ome": True, "metadata": {"axes": "CZTYX"}}, lambda s: np.moveaxis(s, (0, 1), (2, 1)), None),
    ("imagej-TZC", {"imagej": True, "metadata": {"axes": "TZCYX"}}, lambda s: s, None),
    (
        "samples",
        {"metadata": None, "planarconfig": "contig"},
        lambda s: np.moveaxis(s.reshape(3, 4, 37, 53), 1, -1),
        None,
    ),
]


@pytest.mark.parametrize(("options", "arrange", "frames"), [case[1:] for case in STACKS], ids=[c[0] for c in STACKS])
def test_frames_of_a_stack_come_back_one_by_one(
    options: dict[str, Any], arrange: Arrange, frames: int | None, tmp_path: Path
) -> None:
    recorded = np.stack([known_frame("u2", seed=seed) for seed in range(3)])
    path = tmp_path / "stack.tif"
    tifffile.imwrite(path, np.ascontiguousarray(arrange(recorded)), photometric="minisblack", **options)
    layout = FrameLayout((1, 2), frames)
    with open_frames(FrameSource("stack", (path,)), layout) as stack:
        assert (stack.count, stack.shape) == (3, recorded.shape[1:])
        sources = FrameSource("stack", (path,)).expanded(stack.count)
    assert [source.name for source in sources] == ["stack_0000", "stack_0001", "stack_0002"]
    for source in reversed(sources):
        with open_frames(source, layout) as stack:
            assert source.index is not None
            _assert_same(stack.read(source.index), recorded[source.index])


def test_a_stack_that_is_written_anew_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    for seed, dtype in enumerate(("u2", "f4", "u1")):
        recorded = np.stack([known_frame(dtype, seed=seed), known_frame(dtype, seed=seed + 9)])
        tifffile.imwrite(path.with_suffix(".new"), recorded, photometric="minisblack")
        path.with_suffix(".new").rename(path)
        with open_frames(FrameSource("stack", (path,), 1), LAYOUT) as stack:
            _assert_same(stack.read(1), recorded[1])


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}], ids=["raw", "deflate"])
def test_one_frame_of_a_stack_takes_the_memory_of_one_frame(options: dict[str, Any], tmp_path: Path) -> None:
    recorded = np.random.default_rng(0).integers(0, 2**12, (40, 2, 2, 64, 64)).astype("u2")
    path = tmp_path / "stack.tif"
    tifffile.imwrite(path, recorded, photometric="minisblack", metadata={"axes": "THCYX"}, **options)
    tracemalloc.start()
    try:
        with open_frames(FrameSource("stack", (path,), 33), LAYOUT) as stack:
            frame = stack.read(33)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    _assert_same(frame, recorded[33])
    assert peak < recorded.nbytes / 2


def test_sources_and_layouts_cross_processes() -> None:
    source = FrameSource("frame", (Path("frame.tif"),), 7)
    assert pickle.loads(pickle.dumps((source, LAYOUT))) == (source, LAYOUT)
