"""Every form in which a frame may be recorded, each with a writer of an array that the test made."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import tifffile
from numpy.typing import DTypeLike

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource
from tests.support.captures import PLANE_NAMES

Writer = Callable[[Path, Stored], FrameSource]


@dataclass(frozen=True)
class Form:
    """One way to record a frame.

    Attributes:
        name: the ID of the form in the tests' names.
        write: writes an array (H, C, Y, X) to the path, which it gives a suffix.
        dtype: type of the stored values.
        checked: True if the file has a checksum of its pixels, so that all damage to them is noticed.
    """

    name: str
    write: Writer
    dtype: DTypeLike = "u2"
    checked: bool = False


def known_frame(dtype: DTypeLike, *, shape: tuple[int, int] = (37, 53), seed: int = 0) -> Stored:
    """Return a frame of four different planes, smooth enough to be compressed and noisy enough to tell pixels apart."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(shape)
    waves = [np.sin(x / (9 + k)) * np.cos(y / (7 + seed % 5)) for k in range(4)]
    counts = 100 + 60 * np.stack(waves) + rng.integers(0, 3, (4, *shape))
    kind = np.dtype(dtype)
    scale = 1.0 if kind.itemsize == 1 else 100.0
    offset = -150.0 if kind.kind in "if" else 0.0
    return np.asarray((counts + offset) * scale / (7 if kind.kind == "f" else 1)).astype(kind).reshape(2, 2, *shape)


def tiff(**options: Any) -> Writer:
    """Return a writer of one TIFF file by one call of tifffile; `arrange` turns a frame into the array of this call."""
    arrange: Callable[[Stored], Stored] = options.pop("arrange", lambda frame: frame)
    options.setdefault("photometric", "minisblack")

    def write(path: Path, frame: Stored) -> FrameSource:
        file = path.with_suffix(".tif")
        tifffile.imwrite(file, arrange(frame), **options)
        return FrameSource(path.name, (file,))

    return write


def tiff_page_by_page(**options: Any) -> Writer:
    def write(path: Path, frame: Stored) -> FrameSource:
        file = path.with_suffix(".tif")
        with tifffile.TiffWriter(file) as writer:
            for plane in planes_of(frame):
                writer.write(plane, photometric="minisblack", **options)
        return FrameSource(path.name, (file,))

    return write


def planes_of(frame: Stored) -> Stored:
    return frame.reshape(-1, *frame.shape[2:])


def _channel_first(frame: Stored) -> Stored:
    return np.ascontiguousarray(frame.transpose(1, 0, 2, 3))


def _channel_last(frame: Stored) -> Stored:
    return np.ascontiguousarray(np.moveaxis(frame, 1, -1))


def _planes_last(frame: Stored) -> Stored:
    return np.ascontiguousarray(np.moveaxis(planes_of(frame), 0, -1))


def channels_of(frame: Stored) -> dict[str, Stored]:
    return {name: plane.copy() for name, plane in zip(PLANE_NAMES, planes_of(frame), strict=True)}


def exr(**header: Any) -> Writer:
    """Return a writer of one EXR part with the channels H1.SC1 to H2.SC2."""

    def write(path: Path, frame: Stored) -> FrameSource:
        file = path.with_suffix(".exr")
        OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels_of(frame), num_threads=0).write(str(file))
        return FrameSource(path.name, (file,))

    return write


def exr_at(left: int, top: int, *, cropped: bool = False) -> Writer:
    """Return a writer of an EXR file whose data window begins at (left, top).

    The display window is the data window. If `cropped`, it begins at (0, 0).
    """

    def write(path: Path, frame: Stored) -> FrameSource:
        high = (left + frame.shape[3] - 1, top + frame.shape[2] - 1)
        window = (np.array((left, top), np.int32), np.array(high, np.int32))
        shown = (np.zeros(2, np.int32), window[1]) if cropped else window
        return exr(dataWindow=window, displayWindow=shown)(path, frame)

    return write


def exr_planes(names: Sequence[str]) -> Writer:
    """Return a writer of an EXR file with one part per plane, in the order of the names; its channel is Y."""

    def write(path: Path, frame: Stored) -> FrameSource:
        file = path.with_suffix(".exr")
        channels = channels_of(frame)
        parts = [
            OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"Y": channels[name.upper().replace("_", ".")]}, name)
            for name in names
        ]
        OpenEXR.File(parts, num_threads=0).write(str(file))
        return FrameSource(path.name, (file,))

    return write


def exr_parts(names: Mapping[str, tuple[str, str]]) -> Writer:
    """Return a writer of an EXR file with one part per harmonic; `names` maps a part's name to its two channels."""

    def write(path: Path, frame: Stored) -> FrameSource:
        file = path.with_suffix(".exr")
        header = {"type": OpenEXR.scanlineimage}
        parts = [
            OpenEXR.Part(
                dict(header), {channel: plane.copy() for channel, plane in zip(channels, pair, strict=True)}, name
            )
            for (name, channels), pair in zip(names.items(), frame, strict=True)
        ]
        OpenEXR.File(parts, num_threads=0).write(str(file))
        return FrameSource(path.name, (file,))

    return write


def plane_files(suffix: str, **options: Any) -> Writer:
    """Return a writer of one file per plane."""

    def write(path: Path, frame: Stored) -> FrameSource:
        files = tuple(path.with_name(f"{path.name}_{name}{suffix}") for name in PLANE_NAMES)
        for file, plane in zip(files, planes_of(frame), strict=True):
            if suffix == ".tif":
                tifffile.imwrite(file, plane, photometric="minisblack", **options)
            elif suffix == ".png":
                file.write_bytes(imagecodecs.png_encode(plane))
            else:
                OpenEXR.File({}, {"Y": plane.copy()}, num_threads=0).write(str(file))
        return FrameSource(path.name, files)

    return write


def npy(path: Path, frame: Stored) -> FrameSource:
    """Write an NPY file."""
    file = path.with_suffix(".npy")
    np.save(file, frame)
    return FrameSource(path.name, (file,))


_PAGES = {"arrange": planes_of, "metadata": None}

TIFF_FORMS = [
    Form("shaped-HCYX", tiff(metadata={"axes": "HCYX"})),
    Form("shaped-CHYX", tiff(metadata={"axes": "CHYX"}, arrange=_channel_first)),
    Form("shaped-unlabelled", tiff()),
    Form("shaped-planes", tiff(arrange=planes_of)),
    Form("shaped-one-page", tiff(metadata={"axes": "HCYX"}, volumetric=False, truncate=True)),
    Form("pages", tiff(**_PAGES)),
    Form("pages-one-by-one", tiff_page_by_page(metadata=None)),
    Form("series-one-by-one", tiff_page_by_page()),
    Form("ome-ZC", tiff(ome=True, metadata={"axes": "ZCYX"})),
    Form("ome-CZ", tiff(ome=True, metadata={"axes": "CZYX"}, arrange=_channel_first)),
    Form("ome-CT", tiff(ome=True, metadata={"axes": "CTYX"}, arrange=_channel_first)),
    Form("ome-C4", tiff(ome=True, metadata={"axes": "CYX"}, arrange=planes_of)),
    Form("imagej-ZC", tiff(imagej=True, metadata={"axes": "ZCYX"})),
    Form("imagej-TC", tiff(imagej=True, metadata={"axes": "TCYX"}), "f4"),
    Form("imagej-C4", tiff(imagej=True, metadata={"axes": "CYX"}, arrange=planes_of), "u1"),
    Form("big-endian", tiff(byteorder=">", **_PAGES)),
    Form("bigtiff", tiff(bigtiff=True, **_PAGES), "f8"),
    Form("bigtiff-big-endian-shaped", tiff(bigtiff=True, byteorder=">"), "i4"),
    Form("strips", tiff(rowsperstrip=5, **_PAGES)),
    Form("tiles", tiff(tile=(16, 32), **_PAGES), "i2"),
    Form("samples-channel", tiff(arrange=_channel_last, metadata=None, planarconfig="contig")),
    Form("samples-planes", tiff(arrange=_planes_last, metadata=None, planarconfig="contig")),
    Form("samples-separate", tiff(arrange=planes_of, metadata=None, planarconfig="separate")),
    Form("deflate", tiff(compression="zlib", **_PAGES), checked=True),
    Form("deflate-strips", tiff(compression="zlib", rowsperstrip=8, metadata={"axes": "HCYX"}), "f4", checked=True),
    Form("deflate-tiles-big-endian", tiff(compression="zlib", tile=(16, 16), byteorder=">"), checked=True),
    Form("ome-deflate", tiff(ome=True, compression="zlib", metadata={"axes": "ZCYX"}), checked=True),
    Form(
        "samples-separate-deflate", tiff(arrange=planes_of, planarconfig="separate", compression="zlib"), checked=True
    ),
]

CODEC_FORMS = [
    Form("lzw", tiff(compression="lzw", **_PAGES)),
    Form("lzw-predictor", tiff(compression="lzw", predictor=True, rowsperstrip=6, **_PAGES), "f4"),
    Form("zstd", tiff(compression="zstd", **_PAGES)),
    Form("deflate-predictor", tiff(compression="zlib", predictor=True, **_PAGES), checked=True),
]

EXR_FORMS = [
    Form("zip", exr(compression=OpenEXR.ZIP_COMPRESSION), "f4"),
    Form("zips-half", exr(compression=OpenEXR.ZIPS_COMPRESSION), "f2"),
    Form("piz-uint", exr(compression=OpenEXR.PIZ_COMPRESSION), "u4"),
    Form("rle", exr(compression=OpenEXR.RLE_COMPRESSION), "f4"),
    Form("none", exr(compression=OpenEXR.NO_COMPRESSION), "f4"),
    Form("pxr24-half", exr(compression=OpenEXR.PXR24_COMPRESSION), "f2"),
    Form("tiled", exr(type=OpenEXR.tiledimage, tiles=OpenEXR.TileDescription()), "f4"),
    Form("offset-window", exr_at(-7, 11), "f4"),
    Form("cropped", exr_at(7, 11, cropped=True), "f4"),
    Form("parts", exr_parts({"H1": ("SC1", "SC2"), "h2": ("sc1", "sc2")}), "f4"),
    Form("parts-full-names", exr_parts({"a": ("H1.SC1", "H1.SC2"), "b": ("H2.SC1", "H2.SC2")}), "f2"),
    Form("parts-of-a-plane", exr_planes(("H2.SC2", "H1.SC1", "h2_sc1", "H1.SC2")), "f4"),
    Form("parts-counted", exr_parts({"first": ("SC1", "SC2"), "second": ("SC1", "SC2")}), "u4"),
]

ARRAY_FORMS = [Form("npy", npy)]

PLANE_FORMS = [
    Form("planes-tif", plane_files(".tif")),
    Form("planes-tif-plain", plane_files(".tif", metadata=None, byteorder=">"), "f4"),
    Form("planes-exr", plane_files(".exr"), "f2"),
]

PNG_FORMS = [Form("planes-png", plane_files(".png"), checked=True)]

FORMS = TIFF_FORMS + CODEC_FORMS + EXR_FORMS + ARRAY_FORMS + PLANE_FORMS + PNG_FORMS
