"""NPY files, PNG planes and raw dumps, written by numpy, OpenCV, Pillow, scikit-image, imageio and GDAL."""

import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import scipy.io
import tifffile

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import FrameSource, open_frames, read_stored
from cadtof_cli.errors import CaptureError, FrameError
from cadtof_cli.files.frames import FrameLayout, NotAFrameError, RawLayout
from tests.files.forms import known_frame
from tests.files.refusals import message, message_of
from tests.support.captures import TOML, layers_of, record
from tests.support.run_cadtof import cadtof

LAYOUT = FrameLayout((1, 2))


def _read(path: Path, layout: FrameLayout = LAYOUT, index: int = 0) -> Stored:
    with open_frames(FrameSource(path.stem, (path,)), layout) as frames:
        return frames.read(index)


@pytest.mark.parametrize("dtype", ["u1", ">u2", "<i2", ">f4", "f8", "f2"])
@pytest.mark.parametrize(
    "arrange",
    [lambda f: f, lambda f: f.reshape(4, 37, 53), np.asfortranarray, lambda f: f[np.newaxis]],
    ids=["HCYX", "planes", "fortran", "THCYX"],
)
def test_npy_frames_of_any_type_and_arrangement_are_read(
    dtype: str, arrange: Callable[[Stored], Stored], tmp_path: Path
) -> None:
    recorded = known_frame(np.dtype(dtype).newbyteorder("="))
    np.save(tmp_path / "frame.npy", arrange(recorded.astype(dtype)))
    found = _read(tmp_path / "frame.npy")
    assert found.dtype.isnative
    assert found.flags.c_contiguous
    np.testing.assert_array_equal(found, recorded)


def test_npy_stacks_are_read_frame_by_frame(tmp_path: Path) -> None:
    recorded = np.stack([known_frame("u2", seed=seed) for seed in range(3)])
    np.save(tmp_path / "stack.npy", recorded)
    np.testing.assert_array_equal(_read(tmp_path / "stack.npy", index=2), recorded[2])
    np.save(tmp_path / "planes.npy", recorded.reshape(-1, 37, 53))
    assert "--stack-frames 3" in message(tmp_path / "planes.npy")
    np.testing.assert_array_equal(_read(tmp_path / "planes.npy", FrameLayout((1, 2), 3), 1), recorded[1])


@pytest.mark.parametrize("harmonics", [2, 3])
@pytest.mark.parametrize(
    "axes",
    [
        *("YXHC", "YXCH", "HYXC", "CYXH", "HCTYX", "TYXHC", "YXHCT", "CHTYX", "YXP", "TYXP", "PTYX"),
        *("XYHC", "XYCH", "HXYC", "TXYCH", "XYP", "TXYP"),
    ],
)
def test_npy_of_other_axes_is_refused_with_the_call_that_mends_it(axes: str, harmonics: int, tmp_path: Path) -> None:
    layout, path = FrameLayout(tuple(range(1, harmonics + 1))), tmp_path / "frame.npy"
    lengths = {"T": 3, "H": harmonics, "C": 2, "P": 2 * harmonics, "Y": 37, "X": 53}
    ours = "".join(axis for axis in "THCPYX" if axis in axes)
    recorded = np.random.default_rng(4).integers(0, 2**14, [lengths[axis] for axis in ours], "u2")
    np.save(path, recorded.transpose([ours.index(axis) for axis in axes]))
    text = message(path, layout)
    shown = " ".join(axes).replace("P", str(2 * harmonics))
    assert text.startswith(
        f"{path}: found an array of {' × '.join(str(lengths[axis]) for axis in axes)}, expected axes [T] H C Y X"
    )
    (call,) = re.findall(
        rf"if its axes are {shown}: numpy\.save\(PATH, numpy\.load\(PATH\)\.transpose\(([\d, ]+)\)\)", text
    )
    np.save(path, np.load(path).transpose(tuple(map(int, call.split(", ")))))
    stack = FrameLayout(layout.harmonics, 3) if "T" in axes and "P" in axes else layout
    expected = recorded.reshape(-1, harmonics, 2, 37, 53)[-1]
    np.testing.assert_array_equal(_read(path, stack, index=2 if "T" in axes else 0), expected)


@pytest.mark.parametrize("axes", ["YXHC", "HYXC", "YXP", "TYXP"])
def test_tiff_of_an_array_of_other_axes_is_refused_with_the_call_that_mends_it(axes: str, tmp_path: Path) -> None:
    """Pages of 2 or 4 columns would have passed for a stack of dozens of frames, had --stack-frames been given as advised."""
    path, lengths = tmp_path / "frame.tif", {"T": 3, "H": 2, "C": 2, "P": 4, "Y": 37, "X": 53}
    ours = "".join(axis for axis in "THCPYX" if axis in axes)
    recorded = np.random.default_rng(4).integers(0, 2**14, [lengths[axis] for axis in ours], "u2")
    tifffile.imwrite(path, recorded.transpose([ours.index(axis) for axis in axes]), photometric="minisblack")
    shown = re.escape(" ".join(axes).replace("P", "4"))
    (call,) = re.findall(
        rf"if its axes are {shown}: (tifffile\.imwrite\(PATH, .*?, photometric='minisblack'\))", message(path)
    )
    eval(call, {"tifffile": tifffile, "PATH": path})
    stack = FrameLayout((1, 2), 3) if "T" in axes else LAYOUT
    np.testing.assert_array_equal(
        _read(path, stack, index=2 if "T" in axes else 0), recorded.reshape(-1, 2, 2, 37, 53)[-1]
    )


def test_planes_of_several_frames_on_the_last_axis_are_no_stack_of_slender_frames(tmp_path: Path) -> None:
    path = tmp_path / "frame.npy"
    np.save(path, np.zeros((36, 53, 12), "u2"))
    assert message(path).endswith("if its axes are Y X 12: numpy.save(PATH, numpy.load(PATH).transpose(2, 0, 1))")


def test_columns_before_rows_are_suggested_only_for_upright_frames(tmp_path: Path) -> None:
    np.save(tmp_path / "landscape.npy", np.zeros((37, 53, 2, 2), "u2"))
    assert "X Y" not in message(tmp_path / "landscape.npy")
    np.save(tmp_path / "portrait.npy", np.zeros((53, 37, 2, 2), "u2"))
    text = message(tmp_path / "portrait.npy")
    assert re.findall("axes are ([A-Z ]+): ", text) == ["X Y H C", "X Y C H", "Y X H C", "Y X C H"]


@pytest.mark.parametrize("axes", ["YXCH", "YXHC", "HCYX"])
def test_a_matlab_file_is_refused_with_the_call_that_saves_its_array(axes: str, tmp_path: Path) -> None:
    recorded, path = known_frame("u2"), tmp_path / "it's.mat"
    arranged = recorded.transpose(["HCYX".index(axis) for axis in axes])
    scipy.io.savemat(path, {"about": "a frame", "gain": 2.0, "F1": arranged})
    text = message(path)
    assert text.startswith(f"{path}: found a MATLAB file, expected its array in a format that is read here: ")
    ways = dict(re.findall(r"if its axes are ([A-Z ]+): (numpy\.save\([^;]*\))", text))
    as_it_is = re.findall(r"read here: (numpy\.save\(.*?\)), with axes \[T\] H C Y X", text)
    assert len(ways) + len(as_it_is) == (1 if axes == "HCYX" else 2)
    eval(ways.get(" ".join(axes)) or as_it_is[0], {"numpy": np, "scipy": scipy})
    np.testing.assert_array_equal(_read(tmp_path / "it's.npy"), recorded)


@pytest.mark.parametrize("word", ["a{b}", "{}", "{:1500000000}"])
def test_braces_in_the_name_of_a_matlab_file_stay_as_they_are(word: str, tmp_path: Path) -> None:
    """A name in braces ended the command, or took 1.5 GB."""
    path = tmp_path / f"{word}.mat"
    scipy.io.savemat(path, {"voltages": np.zeros((24, 32, 2, 2))})
    text = message(path)
    assert f"scipy.io.loadmat({str(path)!r})['voltages'].transpose(" in text
    assert len(text.replace(str(path), "")) < 1000


def test_matlab_files_without_an_array_that_can_be_saved(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"dark": 1.0, "plane": np.zeros((37, 53))})
    assert "no array in it has three axes or more" in message(path)
    path.write_bytes(path.read_bytes()[:140])
    assert message(path) == f"{path}: cannot be read: could not read bytes"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    assert f"h5py.File({str(path)!r})['NAME'][()].swapaxes(-1, -2)" in message(path)
    with pytest.raises(CaptureError, match=r"found a\.mat; `cadtof info .*a\.mat` says how to save an array"):
        find_captures([tmp_path])


@pytest.mark.parametrize("axes", ["HCYX", "YXHC"])
def test_an_npz_file_is_refused_with_the_call_that_saves_its_array(axes: str, tmp_path: Path) -> None:
    recorded, path = known_frame("u2"), tmp_path / "it's.npz"
    np.savez_compressed(path, dark=np.zeros((37, 53)), volts=recorded.transpose(["HCYX".index(axis) for axis in axes]))
    text = message(path)
    assert text.startswith(f"{path}: found an NPZ file, expected its array in a format that is read here: ")
    label = "read here" if axes == "HCYX" else f"axes are {' '.join(axes)}"
    (call,) = re.findall(rf"{label}: (numpy\.save\([^;]*?\))(?:, with axes|;|$)", text)
    eval(call, {"numpy": np})
    np.testing.assert_array_equal(_read(tmp_path / "it's.npy"), recorded)
    (tmp_path / "it's.npy").unlink()
    with pytest.raises(CaptureError, match=r"no frames: .*; `cadtof info .*\.npz` says how to save an array"):
        find_captures([tmp_path])


def test_npz_files_without_an_array_that_can_be_saved(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, plane=np.zeros((37, 53)))
    assert "no array in it has three axes or more" in message(path)
    path.write_bytes(path.read_bytes()[:200])
    assert message(path).startswith(f"{path}: damaged NPZ: ")
    with zipfile.ZipFile(path, "w") as other:
        other.writestr("letter.xml", "words")
    assert message(path).startswith(f"{path}: found a file of another kind (first bytes 50 4b 03 04)")


def test_an_hdf5_file_is_refused_with_a_call_that_saves_a_dataset(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n".ljust(96, b"\0"))
    assert message(path) == (
        f"{path}: found an HDF5 file, expected its array in a format that is read here: numpy.save("
        f"{str(path.with_suffix('.npy'))!r}, h5py.File({str(path)!r})['NAME'][()]), with axes [T] H C Y X, saves the dataset NAME"
    )


def test_a_dump_of_matlab_is_refused_with_the_call_that_mends_it(tmp_path: Path) -> None:
    recorded, path = known_frame("u2"), tmp_path / "frame.raw"
    path.write_bytes(b"head" + recorded.transpose(2, 3, 1, 0).tobytes(order="F"))
    text = message(path, FrameLayout((1, 2), raw=RawLayout("uint16", (37, 53, 2, 2), 4)))
    (call,) = re.findall(r"if its axes are Y X C H: (numpy\.save\(.*?\)), or order='F' for a dump of MATLAB", text)
    names = {"numpy": np, "PATH": path, "NPY": tmp_path / "frame.npy"}
    eval(call.replace("order='C'", "order='F'"), names)
    np.testing.assert_array_equal(_read(tmp_path / "frame.npy"), recorded)


def test_several_arrays_in_a_file_are_refused_but_zeros_after_one_are_not(tmp_path: Path) -> None:
    path = tmp_path / "frame.npy"
    with path.open("wb") as file:
        for _ in range(3):
            np.save(file, known_frame("u2"))
    assert message(path) == (
        f"{path}: found several arrays, one after the other, expected one: call numpy.load for each of them, with the same open "
        "file, then numpy.save(PATH, numpy.stack(FRAMES))"
    )
    np.save(path, known_frame("u2"))
    with path.open("ab") as file:
        # a device that writes whole blocks leaves zeros at the end
        file.write(bytes(100))
    np.testing.assert_array_equal(read_stored(FrameSource("frame", (path,)), LAYOUT), known_frame("u2"))


def test_values_that_the_header_of_a_npy_leaves_out_are_not_passed_over(tmp_path: Path) -> None:
    path, frame = tmp_path / "frame.npy", known_frame("u2")
    np.save(path, frame)
    rows, columns = frame.shape[2:]
    # one digit of the header is damaged, so each row would begin one value too early
    path.write_bytes(path.read_bytes().replace(f", {columns})".encode(), f", {columns - 1})".encode(), 1))
    assert message(path).startswith(
        f"{path}: found further values after the array of 2 × 2 × {rows} × {columns - 1} that its header describes, "
    )


def test_npy_that_is_no_frame(tmp_path: Path) -> None:
    path = tmp_path / "frame.npy"
    np.save(path, np.array([{"not": "numbers"}], object), allow_pickle=True)
    assert message(path).startswith(f"{path}: found an array of Python objects, expected one of numbers: ")
    np.save(path, np.zeros((4, 5, 7), np.complex64))
    assert "found values of type complex64, expected one of float16" in message(path)
    np.save(path, np.float32(3))
    assert "found an array of one value, expected planes" in message(path)
    np.save(path, np.zeros((3, 5, 7), "u2"))
    assert "found 3 planes of 7 × 5 uint16, expected 4 for one frame" in message(path)
    np.save(path, known_frame("u2"))
    path.write_bytes(path.read_bytes()[:-1])
    assert message(path).startswith(f"{path}: damaged NPY: ")


@pytest.mark.parametrize(("dtype", "offset"), [("uint16", 0), (">u2", 512), ("<f4", 7), ("float64", 1)])
def test_raw_dumps_are_read_from_their_offset_on(dtype: str, offset: int, tmp_path: Path) -> None:
    recorded = known_frame(np.dtype(dtype).newbyteorder("="))
    path = tmp_path / "frame.raw"
    path.write_bytes(b"x" * offset + recorded.astype(dtype).tobytes())
    layout = FrameLayout((1, 2), raw=RawLayout(dtype, (2, 2, 37, 53), offset))
    np.testing.assert_array_equal(_read(path, layout), recorded)
    path.write_bytes(path.read_bytes()[:-1])
    text = message(path, layout)
    assert (
        f"found {offset + recorded.nbytes - 1:,} bytes, expected {offset + recorded.nbytes:,}: 2 × 2 × 37 × 53" in text
    )
    assert "for a raw dump, give dtype and shape under [layout.raw]" in message(path)
    elsewhere = path.rename(tmp_path / "frame.img")
    text = message(elsewhere, FrameLayout((1, 2), raw=RawLayout("uint16", (2, 2, 37, 53))))
    assert text.endswith("; the names of raw dumps end with .raw, .bin, .dat")


@pytest.mark.parametrize("left", [1, 2])
@pytest.mark.parametrize("suffix", [".npy", ".tif"])
def test_a_stack_that_became_shorter_fails_with_a_reason(suffix: str, left: int, tmp_path: Path) -> None:
    """Its frames were counted when it was longer, and an earlier file may have the layout of a single frame."""
    path, one = tmp_path / f"stack{suffix}", tmp_path / f"one{suffix}"
    for file, count in ((one, 1), (path, left)):
        stored = np.stack([known_frame("u2", seed=seed) for seed in range(count)])
        if suffix == ".npy":
            np.save(file, stored)
        else:
            tifffile.imwrite(file, stored.reshape(-1, *stored.shape[3:]), photometric="minisblack", metadata=None)
    _read(one)
    with pytest.raises(FrameError, match=r"\[2\]: was cut off or replaced while it was read"):
        read_stored(FrameSource("stack", (path,), 2), FrameLayout((1, 2), left if left > 1 else None))


def test_raw_dumps_of_several_frames_are_a_stack(tmp_path: Path) -> None:
    recorded = np.stack([known_frame("u2", seed=seed) for seed in range(3)])
    recorded.tofile(tmp_path / "stack.bin")
    layout = FrameLayout((1, 2), raw=RawLayout("uint16", (2, 2, 37, 53)))
    with open_frames(FrameSource("stack", (tmp_path / "stack.bin",)), layout) as frames:
        assert frames.count == 3
        np.testing.assert_array_equal(frames.read(1), recorded[1])


_CUT_OFF_WHILE_IT_IS_READ = """
import os, sys
from pathlib import Path
from cadtof_cli.capture.frames import FrameSource, open_frames, read_stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout, RawLayout
path = Path(sys.argv[1])
with open_frames(FrameSource("frame", (path,)), FrameLayout((1, 2), raw=RawLayout("uint16", (2, 2, 37, 53)))) as frames:
    os.truncate(path, 9000)
    try:
        frames.read(0)
    except FrameError as error:
        print(error)
"""


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("name", ["frame.npy", "frame.raw"])
def test_a_file_that_is_cut_off_while_it_is_read(name: str, order: Literal["C", "F"], tmp_path: Path) -> None:
    """The system ends a process that reads mapped memory beyond the end of its file; the reader must not read there."""
    path, recorded = tmp_path / name, np.array(known_frame("u2"), order=order)
    if name.endswith(".npy"):
        np.save(path, recorded)
    else:
        recorded.tofile(path)
    command = [sys.executable, "-c", _CUT_OFF_WHILE_IT_IS_READ, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{path}: was cut off or replaced while it was read; expected a complete file\n"


def test_a_npy_header_that_is_too_long_is_refused(tmp_path: Path) -> None:
    """Python takes four seconds to find that these brackets are never closed."""
    path = tmp_path / "frame.npy"
    np.save(path, known_frame("u2"))
    content = path.read_bytes()
    header = content[10:128].rstrip().replace(b"(2,", b"[" * 8000).ljust(9_990)
    path.write_bytes(content[:8] + len(header).to_bytes(2, "little") + header + content[128:])
    assert message(path).startswith(f"{path}: damaged NPY: Header info length")


def test_the_message_on_a_damaged_npy_header_is_the_same_in_every_run(tmp_path: Path) -> None:
    """numpy names the object of Python that it did not expect there, with its address in memory."""
    path = tmp_path / "frame.npy"
    np.save(path, known_frame("u2"))
    path.write_bytes(path.read_bytes().replace(b"False", b"Talse"))
    told = "damaged NPY: malformed node or string on line 1; expected a complete file, try copying it again"
    assert message(path) == f"{path}: {told}"


def _opencv(path: Path, plane: Stored) -> None:
    cv2 = pytest.importorskip("cv2")
    assert cv2.imwrite(str(path), plane)


def _pillow(path: Path, plane: Stored) -> None:
    from PIL import Image

    Image.fromarray(plane).save(path)


def _skimage(path: Path, plane: Stored) -> None:
    pytest.importorskip("skimage.io").imsave(path, plane, check_contrast=False)


def _imageio(path: Path, plane: Stored) -> None:
    pytest.importorskip("imageio.v3").imwrite(path, plane)


def _gdal(path: Path, plane: Stored) -> None:
    rasterio = pytest.importorskip("rasterio")
    size: dict[str, Any] = {"height": plane.shape[0], "width": plane.shape[1], "count": 1}
    with rasterio.open(path, "w", driver="PNG", dtype=plane.dtype.name, **size) as file:
        file.write(plane, 1)


@pytest.mark.parametrize("dtype", ["u2", "u1"])
@pytest.mark.parametrize("write", [_opencv, _pillow, _skimage, _imageio, _gdal])
@pytest.mark.filterwarnings("ignore")
def test_png_planes_of_any_program_are_a_frame(
    write: Callable[[Path, Stored], None], dtype: str, tmp_path: Path
) -> None:
    recorded = known_frame(dtype)
    files = tuple(tmp_path / f"plane_{index}.png" for index in range(4))
    for file, plane in zip(files, recorded.reshape(4, 37, 53), strict=True):
        write(file, np.ascontiguousarray(plane))
    with open_frames(FrameSource("frame", files), LAYOUT) as frames:
        np.testing.assert_array_equal(frames.read(0), recorded)
        assert frames.dtype == recorded.dtype


def test_png_that_holds_no_plane(tmp_path: Path) -> None:
    from PIL import Image

    path = tmp_path / "picture.png"
    Image.fromarray(np.zeros((5, 7, 3), "u1")).save(path)
    source = FrameSource("frame", (path,) * 4)
    assert "holds a colour picture (RGB), expected one plane" in message_of(source, kind=NotAFrameError)
    Image.fromarray(np.zeros((5, 7), "u2")).save(path, transparency=8000)
    assert "holds a colour picture (one grey is transparent)" in message_of(source, kind=NotAFrameError)
    Image.fromarray(np.zeros((5, 7), "u2")).save(path)
    assert "holds one plane of 7 × 5, 16 bits; expected 4 planes per frame" in message(path, kind=NotAFrameError)
    path.write_bytes(path.read_bytes()[:-20])
    assert "truncated PNG" in message(path)
    path.write_bytes(path.read_bytes()[:12])
    assert "damaged PNG: found 12 bytes, expected a header" in message_of(source)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_png_whose_exif_says_that_it_is_turned(orientation: int, tmp_path: Path) -> None:
    """Refused, as in TIFF: libraries decode the rows as stored, so that depths would be in wrong pixels, unnoticed."""
    from PIL import Image

    path, (plane, *_) = tmp_path / "plane.png", known_frame("u2").reshape(4, 37, 53)
    exif = Image.Exif()
    exif[271], exif[274] = "a camera", orientation
    Image.fromarray(plane).save(path, exif=exif)
    source = FrameSource("frame", (path,) * 4)
    if orientation > 1:
        assert message_of(source).startswith(f"{path}: found orientation {orientation}, so rows or columns are turned")
    else:
        with open_frames(source, LAYOUT) as frames:
            np.testing.assert_array_equal(frames.read(0)[0, 0], plane)


@pytest.mark.parametrize("exif", [b"II*\0", b"MM\0*\xff\xff\xff\xff", b"MM\0*\0\0\0\x08\xff\xff\x01\x12", b"a text"])
def test_a_png_whose_exif_says_nothing_is_read(exif: bytes, tmp_path: Path) -> None:
    """The check sum is right, so the plane is what was written, even if the Exif data are damaged."""
    from PIL import Image

    path, (plane, *_) = tmp_path / "plane.png", known_frame("u2").reshape(4, 37, 53)
    Image.fromarray(plane).save(path, exif=exif)
    with open_frames(FrameSource("frame", (path,) * 4), LAYOUT) as frames:
        np.testing.assert_array_equal(frames.read(0)[0, 0], plane)


def test_every_byte_of_a_png_is_checked(tmp_path: Path) -> None:
    """Our code checks them, not the library, which loses memory at each failure and aborts after some thousands."""
    path = tmp_path / "plane.png"
    _pillow(path, known_frame("u2")[0, 0])
    whole = path.read_bytes()
    source = FrameSource("frame", (path,) * 4)
    for length in (33, 34, 40, len(whole) // 2, len(whole) - 20, len(whole) - 12, len(whole) - 8):
        path.write_bytes(whole[:length])
        assert message_of(source).startswith(f"{path}: truncated PNG: reaches to byte ")
    for place in (30, 45, len(whole) // 2, len(whole) - 14):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert "damaged PNG: the checksum of bytes " in message_of(source)


@pytest.mark.parametrize("form", ["npy", "png", "raw"])
def test_captures_of_every_format_give_the_same_maps(form: str, tmp_path: Path) -> None:
    import tifffile
    from PIL import Image

    capture = record(tmp_path / "tif")
    pages = tifffile.imread(capture.files[0])
    folder = tmp_path / form
    folder.mkdir()
    extra = ""
    if form == "npy":
        np.save(folder / "frame_0.npy", pages)
    elif form == "raw":
        (folder / "frame_0.raw").write_bytes(b"head" + pages.tobytes())
        extra = '[layout.raw]\ndtype = "uint16"\nshape = [2, 2, 24, 32]\noffset_bytes = 4\n'
    else:
        extra = '[layout]\npattern = "{frame}_h{harmonic}_sc{channel}.png"\n'
        for index, page in enumerate(pages):
            Image.fromarray(page).save(folder / f"frame_0_h{1 + index // 2}_sc{1 + index % 2}.png")
    (folder / "capture.toml").write_text(TOML["tif"] + extra)
    maps = []
    for one in (capture.folder, folder):
        out = tmp_path / f"maps-{one.name}"
        done = cadtof("resolve", one, "-o", out, "--jobs", "1", "--format", "tif")
        assert done.status == 0, done.err
        maps.append(layers_of(out / "frame_0.tif"))
    for name, values in maps[0].items():
        np.testing.assert_array_equal(maps[1][name], values)
    assert cadtof("info", folder, "--jobs", "1").status == 0


def test_raw_dumps_by_options_alone(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form="tif")
    import tifffile

    tifffile.imread(capture.files[0]).tofile(capture.folder / "dump.bin")
    capture.files[0].unlink()
    options = ("--raw-dtype", "uint16", "--raw-shape", "2,2,24,32")
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "maps", "--jobs", "1", *options)
    assert done.status == 0, done.err
    refused = cadtof("resolve", capture.folder, "-o", tmp_path / "no", "--raw-dtype", "uint16")
    assert "--raw-dtype: layout.raw_dtype: found 'uint16', expected layout.raw_shape beside it" in refused.err
    refused = cadtof(
        "resolve", capture.folder, "-o", tmp_path / "no", "--raw-dtype", "words", "--raw-shape", "2,2,24,32"
    )
    assert "expected a type such as uint16" in refused.err
