"""Files that differ only in their pixels share an envelope; values, bytes and messages are those of each file alone."""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.layers import read_layers, stage_maps
from cadtof_cli.files.maps import DepthMaps, MapHeader
from cadtof_cli.files.system import BLOCK_BYTES
from cadtof_cli.files.tiff import layers
from cadtof_cli.files.tiff.images import TiffImages
from tests.support.captures import write_maps

LAYOUT = FrameLayout(harmonics=(1, 2))

IN_ANOTHER_FILE = (
    '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
    '<Pixels ID="Pixels:0" DimensionOrder="XYCZT" Type="uint16" SizeX="9" SizeY="6" SizeC="4" SizeZ="1" SizeT="1">'
    '<TiffData IFD="0" PlaneCount="4"><UUID FileName="frame_0.tif">urn:uuid:0</UUID></TiffData></Pixels></Image></OME>'
)
"""OME metadata by which all planes are in one of the files; it is the same in all of them."""

Result = TypeVar("Result")


def afresh(work: Callable[[], Result]) -> Result:
    """Return the result of the work in a new thread, which has kept no envelope yet."""
    found: list[Result] = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join()
    return found[0]


def frame(seed: int, dtype: str = "<u2") -> NDArray[Any]:
    return np.random.default_rng(seed).integers(0, 16384, (2, 2, 6, 9)).astype(dtype)


def read(path: Path, layout: FrameLayout = LAYOUT) -> tuple[Any, ...]:
    """Return the count, shape, types and bytes of the frame in a file, or the message."""
    try:
        with open_frames(FrameSource(path.stem, (path,)), layout) as frames:
            stored = frames.read(0)
            return frames.count, frames.shape, frames.dtype, stored.dtype, stored.tobytes()
    except FrameError as error:
        return (str(error),)


FORMS: dict[str, dict[str, Any]] = {
    "plain": {"metadata": None, "photometric": "minisblack"},
    "shaped": {"photometric": "minisblack"},
    "OME": {"ome": True, "photometric": "minisblack", "metadata": {"axes": "ZCYX"}},
    "BigTIFF": {"bigtiff": True, "photometric": "minisblack"},
    "big-endian": {"byteorder": ">", "photometric": "minisblack"},
    "deflate": {"compression": "zlib", "photometric": "minisblack"},
    "tiles": {"tile": (16, 16), "photometric": "minisblack"},
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("dtype", ["<u2", ">u2", "f4"])
def test_frames_of_a_recording_are_read_as_if_each_were_alone(form: str, dtype: str, tmp_path: Path) -> None:
    for number in range(4):
        path = tmp_path / f"frame_{number}.tif"
        tifffile.imwrite(path, frame(number, dtype), **FORMS[form])
        found = read(path)
        assert found == afresh(partial(read, path))
        assert found[-1] == frame(number, dtype).astype(np.dtype(dtype).newbyteorder("=")).tobytes()


def test_planes_that_lie_in_another_file_are_looked_for_there_in_every_file(tmp_path: Path) -> None:
    for number in range(3):
        path = tmp_path / f"frame_{number}.tif"
        tifffile.imwrite(path, frame(number), metadata=None, photometric="minisblack", description=IN_ANOTHER_FILE)
    for number in (0, 1, 2, 0):
        path = tmp_path / f"frame_{number}.tif"
        assert read(path) == afresh(partial(read, path))
    assert "spreads it over several files" in read(path.with_name("frame_1.tif"))[0]


def series(folder: Path) -> tuple[Path, Path]:
    """Return two files that differ only in their pixels; the first has been read."""
    first, second = folder / "a.tif", folder / "b.tif"
    for number, path in enumerate((first, second)):
        tifffile.imwrite(path, frame(number), **FORMS["plain"])
    read(first)
    return first, second


def test_every_changed_byte_around_the_pixels_is_noticed(tmp_path: Path) -> None:
    first, second = series(tmp_path)
    content = second.read_bytes()
    with tifffile.TiffFile(second) as file:
        start = file.pages.first.dataoffsets[0]
    around = [*range(start), *range(start + frame(0).nbytes, len(content))]
    for place in around[:: max(1, len(around) // 150)]:
        changed = bytearray(content)
        changed[place] ^= 0x41
        second.write_bytes(changed)
        read(first)
        assert read(second) == afresh(partial(read, second)), place


@pytest.mark.parametrize("change", [-100_000, -400, -1, 1, 50])
def test_a_file_that_is_cut_off_or_longer_is_read_as_if_it_were_alone(change: int, tmp_path: Path) -> None:
    first, second = series(tmp_path)
    content = second.read_bytes()
    second.write_bytes(content[:change] if change < 0 else content + bytes(change))
    read(first)
    assert read(second) == afresh(partial(read, second))


def test_a_file_that_shrinks_while_it_is_read_is_not_taken_for_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = series(tmp_path)
    content = second.read_bytes()
    read(first)
    real = np.empty

    def cut(*shape: Any, **options: Any) -> NDArray[Any]:
        second.write_bytes(content[:-200])
        return np.asarray(real(*shape, **options))

    monkeypatch.setattr(np, "empty", cut)
    found = read(second)
    monkeypatch.undo()
    assert found == afresh(partial(read, second))


def test_with_another_layout_a_file_is_read_anew(tmp_path: Path) -> None:
    first, second = series(tmp_path)
    three = FrameLayout(harmonics=(1, 2, 3))
    assert read(second, three) == afresh(partial(read, second, three))
    assert "expected 6" in read(second, three)[0]
    assert read(first)[1] == (2, 2, 6, 9)


def maps(seed: int, names: tuple[str, ...] = ("direct.depth", "confidence"), width: int = 9) -> DepthMaps:
    rng = np.random.default_rng(seed)
    status = rng.integers(0, 4096, (6, width)).astype(np.uint32)
    pages = rng.normal(size=(len(names) + 1, 6, width)).astype(np.float32)
    pages[0, 0, 0] = np.nan
    return DepthMaps(names, pages, status)


def test_maps_have_the_bytes_that_tifffile_gives_them(tmp_path: Path) -> None:
    kinds: list[dict[str, Any]] = [
        {},
        {},
        {},
        {"width": 12},
        {"width": 12},
        {"names": ("a", "b")},
        {"names": ("a", "b")},
        {},
    ]
    for seed, kind in enumerate(kinds):
        one, path, alone = maps(seed, **kind), tmp_path / f"{seed}.tif", tmp_path / "alone.tif"
        write_maps(path, one)
        afresh(partial(write_maps, alone, one))
        assert path.read_bytes() == alone.read_bytes(), seed
        layers = read_layers(path)
        np.testing.assert_array_equal(layers["status"], one.status)
        np.testing.assert_array_equal(layers[one.names[0]], one.pages[0])


def test_tifffile_reads_and_writes_the_first_file_of_a_kind_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = series(tmp_path)
    write_maps(tmp_path / "first.tif", maps(0))

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("tifffile was asked")

    monkeypatch.setattr(tifffile, "TiffFile", refuse)
    monkeypatch.setattr(tifffile, "imwrite", refuse)
    assert read(second)[-1] == frame(1).tobytes()
    assert read(first)[-1] == frame(0).tobytes()
    write_maps(tmp_path / "second.tif", maps(1))
    monkeypatch.undo()
    np.testing.assert_array_equal(read_layers(tmp_path / "second.tif")["confidence"], maps(1).pages[1])


def named_maps(folder: Path, count: int) -> list[Path]:
    """Write maps as a run does: each names its frame, which has the name of the map."""
    folder.mkdir()
    paths = [folder / f"frame_<{place}.tif" for place in range(count)]
    for place, path in enumerate(paths):
        named_map(path, maps(place), source=path.name)
    return paths


def named_map(path: Path, one: DepthMaps, *, source: str) -> None:
    stage_maps(path, one, header=MapHeader({"direct.depth": "m"}, {"source": source}), token="")[0].commit()


def test_only_the_first_map_of_each_of_two_runs_is_read_with_tifffile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = [named_maps(tmp_path / run, 3) for run in "ab"]
    opened: list[Path] = []

    def counted(path: Path, *, voltages: bool) -> TiffImages:
        opened.append(path)
        return TiffImages(path, voltages=voltages)

    monkeypatch.setattr(layers, "TiffImages", counted)
    for pair in zip(*runs, strict=True):
        for path in pair:
            found, place = read_layers(path), int(path.stem[-1])
            np.testing.assert_array_equal(found["status"], maps(place).status)
            np.testing.assert_array_equal(found["confidence"], maps(place).pages[1])
    assert opened == [run[0] for run in runs]


def test_a_map_that_is_not_like_the_last_one_in_its_folder_is_read_as_if_alone(tmp_path: Path) -> None:
    first, renamed, other, wider = named_maps(tmp_path / "run", 4)
    renamed.write_bytes(renamed.read_bytes().replace(b"confidence", b"brightness"))
    named_map(other, maps(2), source="of another name.tif")
    named_map(wider, maps(3, width=12), source=wider.name)
    for place, (path, name) in enumerate(((renamed, "brightness"), (other, "confidence"), (wider, "confidence")), 1):
        read_layers(first)
        width = 12 if path == wider else 9
        np.testing.assert_array_equal(read_layers(path)[name], maps(place, width=width).pages[1])


def test_maps_whose_pages_lie_in_an_image_have_the_same_bytes(tmp_path: Path) -> None:
    for seed in range(4):
        one, other = maps(seed), DepthMaps.empty(maps(seed).names, (6, 9))
        other.pages[:], other.status[:] = one.pages, one.status
        write_maps(tmp_path / "own.tif", other)
        afresh(partial(write_maps, tmp_path / "copied.tif", one))
        assert (tmp_path / "own.tif").read_bytes() == (tmp_path / "copied.tif").read_bytes()


def test_a_crop_of_maps_whose_pages_lie_in_an_image_is_written(tmp_path: Path) -> None:
    for seed in range(4):
        whole = DepthMaps.empty(maps(seed).names, (6, 9))
        whole.pages[:], whole.status[:] = maps(seed).pages, maps(seed).status
        write_maps(tmp_path / "cut.tif", whole.cropped((2, 1, 8, 5)))
        np.testing.assert_array_equal(
            read_layers(tmp_path / "cut.tif")["direct.depth"], maps(seed).layer("direct.depth")[1:5, 2:8]
        )


def test_the_third_map_is_one_piece_of_whole_blocks_for_the_disk(tmp_path: Path) -> None:
    header = MapHeader({"direct.depth": "m"}, {"source": "frame.tif"})
    for _ in range(3):
        made = DepthMaps.empty(("direct.depth", "confidence"), (6, 9))
        made.pages[:], made.status[:] = 1.0, 8
        parts = layers.write_maps(tmp_path / "maps.tif", made, header=header)
    (whole,) = parts
    assert (np.frombuffer(whole, np.uint8).ctypes.data % BLOCK_BYTES, whole.nbytes % BLOCK_BYTES) == (0, 0)
    assert whole == (tmp_path / "maps.tif").read_bytes()
