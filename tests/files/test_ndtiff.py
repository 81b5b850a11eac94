"""NDTiff files: the index beside a file says which page is which plane; without a fitting index the file is refused."""

import json
import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource, read_stored
from cadtof_cli.errors import UnreadableError
from tests.files.forms import known_frame
from tests.files.refusals import LAYOUT, message

Axes = Mapping[str, int | str]

SHUFFLED = ((1, 1), (0, 0), (1, 0), (0, 1))
"""Harmonic and channel of each page, counted from 0, in the order of acquisition."""

PLACES: dict[str, Sequence[Axes]] = {
    "numbers": [{"z": h, "channel": c} for h, c in SHUFFLED],
    "names": [{"channel": f"H{h + 1}.SC{c + 1}"} for h, c in SHUFFLED],
    "names of channels": [{"z": h, "channel": f"SC{c + 1}"} for h, c in SHUFFLED],
    "frequencies": [{"frequency": f"{25 * (h + 1)} MHz", "channel": f"SC{c + 1}"} for h, c in SHUFFLED],
}


def _write(folder: Path, pages: Sequence[Stored], places: Sequence[Axes], *, listed_as: str = "frame.tif") -> Path:
    """Write pages, uint16 (Y, X), one after the other as NDTiffStorage does, and the index that describes them."""
    path, index = folder / "frame.tif", b""
    # versions 3 and 0, and a summary without content
    content = b"II*\0" + struct.pack("<6I", 38, 483729, 3, 0, 2355492, 10) + b'{"a": "b"}'
    for number, (page, axes) in enumerate(zip(pages, places, strict=True), start=1):
        height, width = page.shape
        begin = len(content) + 2 + 12 * 10 + 4
        sizes = ((256, width), (257, height), (258, 16), (259, 1), (262, 1), (273, begin), (277, 1), (278, height))
        tags = [struct.pack("<HHII", tag, 4, 1, value) for tag, value in (*sizes, (279, page.nbytes))]
        # the metadata of a page: the 10 bytes of the summary, which begins at byte 28
        tags.append(struct.pack("<HHII", 51123, 2, 10, 28))
        content += struct.pack("<H", len(tags)) + b"".join(tags)
        content += struct.pack("<I", begin + page.nbytes if number < len(pages) else 0) + page.tobytes()
        for text in (json.dumps(axes).encode(), listed_as.encode()):
            index += struct.pack("<I", len(text)) + text
        index += struct.pack("<IiiiiIii", begin, width, height, 1, 0, 0, 0, 0)
    path.write_bytes(content)
    (folder / "NDTiff.index").write_bytes(index)
    return path


def _acquired(frame: Stored) -> list[Stored]:
    return [frame[h, c] for h, c in SHUFFLED]


@pytest.mark.parametrize("kind", PLACES)
def test_planes_are_those_that_the_index_says(kind: str, tmp_path: Path) -> None:
    frame = known_frame("u2")
    path = _write(tmp_path, _acquired(frame), PLACES[kind])
    np.testing.assert_array_equal(read_stored(FrameSource("frame", (path,)), LAYOUT), frame)


def test_files_with_the_same_pages_are_read_each_by_its_own_index(tmp_path: Path) -> None:
    frame = known_frame("u2")
    for name, places in (("a", [{"channel": f"H{h}.SC{c}"} for h in (1, 2) for c in (1, 2)]), ("b", PLACES["names"])):
        (tmp_path / name).mkdir()
        _write(tmp_path / name, _acquired(frame), places)
    as_acquired, meant = (read_stored(FrameSource(one, (tmp_path / one / "frame.tif",)), LAYOUT) for one in "ab")
    np.testing.assert_array_equal(as_acquired.reshape(-1, *frame.shape[2:]), _acquired(frame))
    np.testing.assert_array_equal(meant, frame)


def test_a_file_without_its_index_is_refused(tmp_path: Path) -> None:
    path = _write(tmp_path, _acquired(known_frame("u2")), PLACES["numbers"])
    (tmp_path / "NDTiff.index").unlink()
    assert message(path).startswith(
        f"{path}: found an NDTiff file without NDTiff.index, which says which page is which plane"
    )


def test_an_index_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    pages = _acquired(known_frame("u2"))
    path = _write(tmp_path, pages, PLACES["numbers"], listed_as="other.tif")
    assert "NDTiff.index spreads it over other.tif too, expected all planes in one file" in message(path)
    _write(tmp_path, pages, [*PLACES["numbers"][:3], {"z": 2**31 - 1, "channel": 1}])
    assert "NDTiff.index lists 4 planes, its axes promise 4294967296" in message(path)
    _write(tmp_path, pages, PLACES["numbers"])
    (tmp_path / "NDTiff.index").unlink()
    os.mkfifo(tmp_path / "NDTiff.index")
    assert message(path, kind=UnreadableError) == f"{path}: cannot be read: found a FIFO, expected a file"
