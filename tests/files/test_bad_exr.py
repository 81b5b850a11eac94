"""The message for an EXR file that is damaged or holds no frame says what was found in it and what was expected."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cadtof_cli.errors import FrameError
from cadtof_cli.files.exr import read_parts
from cadtof_cli.files.frames import NotAFrameError
from tests.files.forms import channels_of, known_frame
from tests.files.refusals import message
from tests.support.captures import write_exr
from tests.support.needed import needed_module


def test_maps_in_an_exr_are_not_a_frame(tmp_path: Path) -> None:
    path = write_exr(tmp_path / "maps.exr", {"direct.depth": np.zeros((5, 7), "f4")})
    text = message(path, kind=NotAFrameError)
    assert text.startswith(f"{path}: holds maps (direct.depth), expected voltages")


@pytest.mark.parametrize("missing", ["H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2"])
def test_exr_that_lacks_a_harmonic_or_channel(missing: str, tmp_path: Path) -> None:
    channels = channels_of(known_frame("f4"))
    del channels[missing]
    text = message(write_exr(tmp_path / "frame.exr", channels))
    assert f"no channel {missing}; found {', '.join(channels)}, expected H1.SC1, H1.SC2, H2.SC1, H2.SC2" in text


def test_exr_with_the_wrong_number_of_parts(tmp_path: Path) -> None:
    part = {"SC1": np.zeros((5, 7), "f4"), "SC2": np.zeros((5, 7), "f4")}
    path = tmp_path / "frame.exr"
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, dict(part), name) for name in "abc"]
    OpenEXR.File(parts, num_threads=0).write(str(path))
    assert "found 3 parts with SC1 and SC2 ('a', 'b', 'c'), expected 2, one per harmonic" in message(path)


def test_exr_parts_of_different_sizes(tmp_path: Path) -> None:
    path = tmp_path / "frame.exr"
    window = (np.zeros(2, "i4"), np.array((9, 9), "i4"))
    header = {"type": OpenEXR.scanlineimage, "displayWindow": window}
    parts = [
        OpenEXR.Part(dict(header), {"SC1": np.zeros((5, w), "f4"), "SC2": np.zeros((5, w), "f4")}, name)
        for w, name in ((7, "H1"), (8, "H2"))
    ]
    OpenEXR.File(parts, num_threads=0).write(str(path))
    assert "SC1 of part 'H2' is 8 × 5 pixels, expected 7 × 5" in message(path)


def test_exr_parts_that_show_different_pixels(tmp_path: Path) -> None:
    path = tmp_path / "frame.exr"
    parts = [
        OpenEXR.Part(
            {"dataWindow": (np.array((x, 3), "i4"), np.array((x + 6, 7), "i4"))},
            {"SC1": np.zeros((5, 7), "f4"), "SC2": np.zeros((5, 7), "f4")},
            name,
        )
        for x, name in ((1, "H1"), (2, "H2"))
    ]
    OpenEXR.File(parts, num_threads=0).write(str(path))
    assert "SC1 of part 'H2' begins at pixel 2, 3 (its data window), expected 1, 3 as SC1" in message(path)


@pytest.fixture
def few_files() -> Iterator[Callable[[], list[int]]]:
    """Let few files be open; yield a function that opens files up to this limit and returns their descriptors."""
    resource = needed_module("resource")
    limits, held = resource.getrlimit(resource.RLIMIT_NOFILE), list[int]()

    def taken() -> list[int]:
        with contextlib.suppress(OSError):
            while True:
                held.append(os.dup(0))
        return held

    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, limits[0]), limits[1]))
    yield taken
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    for descriptor in held:
        os.close(descriptor)


@pytest.mark.parametrize("spare", range(8))
def test_that_no_more_files_may_be_open_is_no_damage(
    spare: int, few_files: Callable[[], list[int]], tmp_path: Path
) -> None:
    path = write_exr(tmp_path / "frame.exr", channels_of(known_frame("f4")))
    held = few_files()
    for descriptor in (held.pop() for _ in range(spare)):
        os.close(descriptor)
    before, text = len(held), None
    try:
        read_parts(path)
    except FrameError as error:
        text = str(error)
    assert len(few_files()) - before == spare
    assert text in {None, f"{path}: cannot be read: Too many open files"}
    assert text or spare > 2


@pytest.mark.skipif(sys.platform != "linux", reason="the system has no file that cannot be read")
def test_a_disk_that_fails_is_no_damage() -> None:
    # a process has no memory at address 0: reading there fails as it does on a broken disk
    with pytest.raises(FrameError, match="/proc/self/mem: cannot be read: Input/output error"):
        read_parts(Path("/proc/self/mem"))


def test_a_tile_larger_than_any_file(tmp_path: Path) -> None:
    """The library allocates memory for a whole tile, and the header of this file promises a tile of gigabytes."""
    tile = OpenEXR.TileDescription()
    tile.xSize, tile.ySize = 32, 64
    header = {"type": OpenEXR.tiledimage, "tiles": tile}
    path = write_exr(tmp_path / "frame.exr", channels_of(known_frame("f4")), **header)
    content = bytearray(path.read_bytes())
    tiles = content.index(b"tiledesc\0") + 9 + 4
    content[tiles + 4 : tiles + 8] = (2**24 + 32).to_bytes(4, "little")
    path.write_bytes(content)
    assert "damaged header: promises 8,5" in message(path)


def test_exr_channels_of_different_types(tmp_path: Path) -> None:
    channels = channels_of(known_frame("f4"))
    channels["H2.SC2"] = channels["H2.SC2"].astype("f2")
    assert "H2.SC2 is 53 × 37 float16, expected 53 × 37 float32" in message(write_exr(tmp_path / "f.exr", channels))


def test_the_message_for_an_exr_that_ends_early_has_the_library_s_words(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_exr(tmp_path / "frame.exr", channels_of(known_frame("f4")))
    path.write_bytes(path.read_bytes()[:-50])
    text = message(path)
    assert text.startswith(f"{path}: damaged EXR: (EXR_ERR_BAD_CHUNK_LEADER) ")
    assert text.endswith("expected a complete file, try copying it again")
    assert capfd.readouterr() == ("", "")


def test_a_subsampled_exr_channel_is_refused(tmp_path: Path) -> None:
    path = write_exr(tmp_path / "frame.exr", channels_of(known_frame("f4", shape=(6, 8))))
    content = bytearray(path.read_bytes())
    # after the name: pixel type, linearity, then the sampling in x and y, four bytes each
    sampling = content.index(b"H1.SC2\0") + 7 + 8
    content[sampling : sampling + 4] = (2).to_bytes(4, "little")
    path.write_bytes(content)
    assert message(path) == f"{path}: H1.SC2 is a subsampled channel, expected one value a pixel"
