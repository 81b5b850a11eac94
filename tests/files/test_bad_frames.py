"""The message for a frame that cannot be read names the file, what was found there and what was expected."""

import builtins
import logging
import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile

from cadtof_cli.capture.frames import open_frames
from cadtof_cli.errors import FrameError, UnreadableError
from cadtof_cli.files.frames import FrameLayout, NotAFrameError
from cadtof_cli.files.reading import in_brief
from tests.files.forms import known_frame, plane_files, planes_of, tiff
from tests.files.refusals import LAYOUT, message, message_of
from tests.support.captures import KNOWN_FORMATS, write_exr, write_pages


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "an empty file"),
        (b"\x89PNG\r\n", "a file of another kind (first bytes 89 50 4e 47)"),
        (b"[modulation]\n", "a file of another kind (first bytes 5b 6d 6f 64)"),
    ],
)
def test_a_file_of_no_known_format_is_refused(content: bytes, found: str, tmp_path: Path) -> None:
    path = tmp_path / "frame.tif"
    path.write_bytes(content)
    text = message(path)
    assert text == f"{path}: found {found}, expected one of {KNOWN_FORMATS}"


def test_a_file_that_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "gone.tif"
    assert message(path, kind=UnreadableError) == f"{path}: cannot be read: No such file or directory"


def test_a_folder_in_place_of_a_file(tmp_path: Path) -> None:
    assert message(tmp_path, kind=UnreadableError).endswith("cannot be read: Is a directory")


def test_a_frame_without_permission_to_read_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    path = tmp_path / "frame.exr"
    path.touch()
    monkeypatch.setattr("os.open", refuse)
    assert message(path, kind=UnreadableError) == f"{path}: cannot be read: Permission denied"


@pytest.mark.parametrize(
    ("pages", "frames", "expected"),
    [
        (3, None, "found 3 pages of 7 × 5 uint16, expected 4 for one frame (H1.SC1, H1.SC2, H2.SC1, H2.SC2)"),
        (1, None, "; if each plane has a file of its own, give their names by [layout] pattern, such as "),
        (12, None, "if this is a stack of 3 frames, say so: --stack-frames 3, or frames = 3 under [layout]"),
        (12, 2, "found 12 pages of 7 × 5 uint16, expected 8: layout.frames = 2 frames of 4 planes"),
        (4, 2, "; this may be 1 frame: correct it (--stack-frames 1), or move such files into a folder of their own, "),
        (
            12,
            2,
            "; this may be 3 frames: correct it (--stack-frames 3), or move such files into a folder of their own, ",
        ),
        (10, 3, "found 10 pages of 7 × 5 uint16, expected 12: layout.frames = 3 frames"),
    ],
)
def test_a_wrong_number_of_pages_says_what_is_expected(
    pages: int, frames: int | None, expected: str, tmp_path: Path
) -> None:
    path = write_pages(tmp_path / "frame.tif", np.zeros((pages, 5, 7), "u2"))
    text = message(path, FrameLayout((1, 2), frames))
    assert text.startswith(f"{path}: found {pages} page")
    assert expected in text


def test_a_number_of_pages_that_is_no_multiple_gets_no_advice(tmp_path: Path) -> None:
    path = write_pages(tmp_path / "frame.tif", np.zeros((10, 5, 7), "u2"))
    assert "--stack-frames" not in message(path, FrameLayout((1, 2), 3))


def test_axes_in_an_order_that_could_mean_two_things(tmp_path: Path) -> None:
    path = write_pages(tmp_path / "frame.tif", np.zeros((4, 3, 5, 7), "u2"), metadata={"axes": "QZYX"})
    text = message(path)
    assert "found an array of 4 × 3 × 5 × 7, expected axes [T] H C Y X" in text
    assert "if its axes are 4 T Y X: tifffile.imwrite(PATH, tifffile.imread(PATH).transpose(1, 0, 2, 3), " in text


def test_pages_that_differ_are_counted_by_their_form(tmp_path: Path) -> None:
    path = tmp_path / "frame.tif"
    with tifffile.TiffWriter(path) as writer:
        for width in (7, 7, 7, 8):
            writer.write(np.zeros((5, width), "u2"), metadata=None, photometric="minisblack")
    text = message(path)
    assert "found different pages (3 of 7 × 5 uint16; 1 of 8 × 5 uint16)" in text


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ({"extratags": [(274, 3, 1, 4, True)]}, "found orientation 4"),
        ({"photometric": "miniswhite"}, "found min-is-white pages"),
        ({"photometric": 32844}, "holds a colour picture (LogL)"),
    ],
)
@pytest.mark.parametrize("odd", [0, 3])
def test_one_page_that_is_stored_in_another_way(odd: int, options: dict[str, Any], found: str, tmp_path: Path) -> None:
    path = tmp_path / "frame.tif"
    with tifffile.TiffWriter(path) as writer:
        for place in range(4):
            changed = options if place == odd else {}
            writer.write(np.zeros((5, 7), "u2"), **{"photometric": "minisblack", "metadata": None, **changed})
    kind = NotAFrameError if "photometric" in options and "Log" in found else FrameError
    assert found in message(path, kind=kind)


@pytest.mark.parametrize("dtype", ["i1", "i8", "c8"])
def test_a_sample_type_that_is_not_supported(dtype: str, tmp_path: Path) -> None:
    path = write_pages(tmp_path / "frame.tif", np.zeros((4, 5, 7), dtype))
    text = message(path)
    assert f"found {8 * np.dtype(dtype).itemsize} bits a sample" in text
    assert "expected one of float16, float32, float64, int16" in text


def test_tiff_that_ends_early(tmp_path: Path) -> None:
    source = tiff(arrange=planes_of, metadata={"axes": "IYX"})(tmp_path / "frame", known_frame("u2"))
    path = source.paths[0]
    content = path.read_bytes()
    path.write_bytes(content[:-100])
    text = message(path)
    assert text.startswith(f"{path}: damaged or truncated TIFF")
    assert f"found no page there in a file of {len(content) - 100:,} bytes" in text


def test_tiff_whose_pixels_come_last_and_end_early(tmp_path: Path) -> None:
    path = write_pages(tmp_path / "frame.tif", planes_of(known_frame("u2")), metadata={}, truncate=True)
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    size = len(content)
    assert f"truncated TIFF: 4 pages reach to byte {size:,}, found a file of {size - 1:,} bytes" in message(path)


def test_a_width_that_is_no_whole_number(tmp_path: Path) -> None:
    samples = np.moveaxis(planes_of(known_frame("u2")), 0, -1)
    path = write_pages(tmp_path / "frame.tif", samples, planarconfig="contig", compression="zlib")
    with tifffile.TiffFile(path) as tiff:
        width = tiff.pages.first.tags[256].offset
    content = bytearray(path.read_bytes())
    # the tag gets the type 11 (float), the count 1 and this value
    struct.pack_into("<HIf", content, width + 2, 11, 1, 5e-39)
    path.write_bytes(content)
    assert "damaged TIFF: 'float' object cannot be interpreted as an integer" in message(path)


def test_a_message_that_a_decoder_prints_is_damage(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = write_pages(tmp_path / "frame.tif", planes_of(known_frame("u2")), compression="jpegxr")
    with tifffile.TiffFile(path) as tiff:
        (begin, *_) = tiff.pages.first.dataoffsets
    content = bytearray(path.read_bytes())
    # the fifth tag, a resolution that nobody needs, gets a code that the library does not know
    (tags,) = struct.unpack_from("<I", content, begin + 4)
    struct.pack_into("<H", content, begin + tags + 2 + 4 * 12, 1)
    path.write_bytes(content)
    imagecodecs.jpegxr_decode(content[begin:])
    if "Unrecognized WMPTag" not in capfd.readouterr().err:
        pytest.skip("this version of the decoder takes any tag for known, and prints nothing")
    assert "damaged TIFF: Unrecognized WMPTag: 1(0x1)" in message(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("colours", [1, 2])
def test_a_jpeg_xr_header_at_which_the_library_ends_the_process(colours: int, tmp_path: Path) -> None:
    path = write_pages(tmp_path / "frame.tif", planes_of(known_frame("u2")), compression="jpegxr")
    content = bytearray(path.read_bytes())
    # the upper four bits of this byte say YUV 4:2:0 or 4:2:2 instead of grey
    content[content.rindex(b"WMPHOTO\0") + 11] |= colours << 4
    path.write_bytes(content)
    assert message(path) == (f"{path}: damaged TIFF: its JPEG XR data declares YUV colours, expected one value a pixel")


@pytest.mark.parametrize(
    ("remarks", "text"),
    [
        (["no strip", "no strip"], "no strip"),
        (["no strip", "no tile", "no tag"], "no strip (and 2 more remarks)"),
        ([KeyError("x" * 10_000)], f"'{'x' * 299} …"),
    ],
)
def test_a_message_is_short_however_much_a_library_says(remarks: list[object], text: str) -> None:
    assert in_brief(remarks) == text


@pytest.mark.parametrize("header", [b"II*\0\0\0\0\0", b"MM\0+\0\x08\0\0" + bytes(8)])
def test_a_file_without_a_page(header: bytes, tmp_path: Path) -> None:
    (tmp_path / "frame.tif").write_bytes(header)
    assert "damaged TIFF: it ends before its first page" in message(tmp_path / "frame.tif")


def test_pages_in_a_circle(tmp_path: Path) -> None:
    path = write_pages(tmp_path / "frame.tif", np.zeros((4, 5, 7), "u2"))
    with tifffile.TiffFile(path) as file:
        first, last = file.pages[0].offset, file.pages[3].offset
    content = bytearray(path.read_bytes())
    tags = int.from_bytes(content[last : last + 2], "little")
    end = last + 2 + 12 * tags
    content[end : end + 4] = first.to_bytes(4, "little")
    path.write_bytes(content)
    assert "page 4 points back to an earlier page" in message(path)


def test_a_compression_without_a_decoder_is_refused(tmp_path: Path) -> None:
    path = write_pages(tmp_path / "frame.tif", planes_of(known_frame("u2")), compression="zlib")
    with tifffile.TiffFile(path, mode="r+") as file:
        for index in range(4):
            page = file.pages.get(index)
            assert isinstance(page, tifffile.TiffPage)
            page.tags["Compression"].overwrite(32809)
    text = message(path)
    assert text.startswith(f"{path}: its compression cannot be read here (")
    assert text.endswith("rewrite it, such as by tiffcp -c zip")


def test_maps_in_a_tiff_are_not_a_frame(tmp_path: Path) -> None:
    path = tmp_path / "maps.tif"
    names = ["direct.depth", "mpi.depth", "confidence", "status"]
    tifffile.imwrite(
        path, np.zeros((4, 5, 7), "f4"), ome=True, photometric="minisblack",
        metadata={"axes": "CYX", "Channel": {"Name": names}},
    )  # fmt: skip
    text = message(path, kind=NotAFrameError)
    assert text == f"{path}: holds maps (direct.depth, mpi.depth, confidence, status), expected voltages"


@pytest.mark.parametrize(("pages", "samples"), [(2, 2), (4, 2), (1, 4), (1, 5)])
def test_opacity_is_no_voltage(pages: int, samples: int, tmp_path: Path) -> None:
    path, extra = tmp_path / "frame.tif", ("unspecified",) * (samples - 2) + ("unassalpha",)
    write_pages(path, np.zeros((pages, 5, 7, samples), "u2"), planarconfig="contig", extrasamples=extra)
    text = message(path, kind=NotAFrameError)
    assert text.startswith(
        f"{path}: holds grey and opacity, {samples} samples a pixel, expected voltages; write a page"
    )


def _of_an_unknown_planar_configuration(path: Path) -> Path:
    write_pages(path, planes_of(known_frame("u2")), planarconfig="separate", compression="zlib")
    content = bytearray(path.read_bytes())
    content[content.index(struct.pack("<HHI", 284, 3, 1)) + 8] = 128
    path.write_bytes(content)
    return path


@pytest.fixture
def tifffile_log() -> Iterator[logging.Logger]:
    log = logging.getLogger("tifffile")
    before, disabled = log.level, logging.root.manager.disable
    yield log
    log.disabled = False
    log.setLevel(before)
    logging.disable(disabled)


@pytest.mark.parametrize(
    "silence",
    [
        lambda log: log.setLevel(logging.CRITICAL + 1),
        lambda _: logging.disable(logging.CRITICAL),
        lambda log: setattr(log, "disabled", True),
    ],
    ids=["its level", "all logging", "by a configuration of logging"],
)
def test_an_error_that_tifffile_logs_is_damage_even_if_logging_is_silenced(
    silence: Callable[[logging.Logger], object], tmp_path: Path, tifffile_log: logging.Logger
) -> None:
    path = _of_an_unknown_planar_configuration(tmp_path / "frame.tif")
    silence(tifffile_log)
    assert "incorrect StripByteCounts count (4 != 1)" in message(path)
    assert not tifffile_log.isEnabledFor(logging.ERROR)


def test_an_error_that_tifffile_logs_is_damage_and_is_kept_from_the_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = _of_an_unknown_planar_configuration(tmp_path / "frame.tif")
    assert "incorrect StripByteCounts count (4 != 1)" in message(path)
    assert caplog.records == []
    logging.getLogger("tifffile").error("to another user of tifffile")
    assert caplog.messages == ["to another user of tifffile"]


def test_a_plane_of_another_size(tmp_path: Path) -> None:
    source = plane_files(".tif")(tmp_path / "frame", known_frame("u2"))
    tifffile.imwrite(source.paths[2], np.zeros((5, 7), "u2"))
    expected = f"{source.paths[2]}: found 7 × 5 uint16, expected 53 × 37 uint16 as in {source.paths[0].name}"
    assert message_of(source) == expected


def test_a_plane_file_with_more_than_a_plane(tmp_path: Path) -> None:
    source = plane_files(".tif")(tmp_path / "frame", known_frame("u2"))
    tifffile.imwrite(source.paths[1], np.zeros((2, 37, 53), "u2"), photometric="minisblack")
    assert "found 2 pages of 53 × 37 uint16, expected a single plane" in message_of(source)
    write_exr(source.paths[1], {"A": np.zeros((5, 7), "f4"), "B": np.zeros((5, 7), "f4")})
    assert "found channels A, B, expected a single plane" in message_of(source)


def test_an_exception_of_the_caller_is_left_as_it_is(tmp_path: Path) -> None:
    source = tiff()(tmp_path / "frame", known_frame("u2"))
    with pytest.raises(ZeroDivisionError), open_frames(source, LAYOUT):
        _ = 1 / 0


def test_a_reader_imports_only_the_library_that_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tiff()(tmp_path / "frame", known_frame("u2"))
    imported = builtins.__import__

    def refuse(name: str, *args: Any, **options: Any) -> Any:
        assert name != "OpenEXR"
        return imported(name, *args, **options)

    for name in ("OpenEXR", "cadtof_cli.files.exr"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setattr(builtins, "__import__", refuse)
    with open_frames(source, LAYOUT) as frames:
        assert frames.read(0).dtype == np.uint16
