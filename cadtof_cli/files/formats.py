"""The registry of file formats. A format is one entry here and the modules that the entry names.

Options and discovery read it at start-up, so a format's library is loaded only when a file of that format is met.
"""

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from cadtof_cli.errors import FrameError
from cadtof_cli.files.reading import damage_as_frame_error, open_regular
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cadtof_cli.arrays import Stored
    from cadtof_cli.files.frames import FrameLayout, Frames
    from cadtof_cli.files.maps import DepthMaps, MapHeader

_HEAD_BYTES = 16
"""First bytes that are read to recognise a format; messages show four of them."""


class FrameReader(Protocol):
    """How the frames of a format are read. What is wrong with a file is a FrameError that names it."""

    def open_frames(self, path: Path, layout: "FrameLayout", /) -> AbstractContextManager["Frames"]:
        """Open a file of whole frames; NotAFrameError where it holds something else than voltages."""

    def read_plane(self, path: Path, layout: "FrameLayout", /) -> "Stored":
        """Return the one plane of a file, shape (Y, X), native byte order."""


class FrameWriter(Protocol):
    """How a simulated camera records frames in a format."""

    def write_frame(self, path: Path, stored: "Stored", /, *, layout: "FrameLayout", compress: bool) -> None:
        """Write one frame, shape (H, C, Y, X), without loss."""


class Compressions(Protocol):
    """How the compression of a format's files is told."""

    def lossy_compression(self, path: Path, dtype: "np.dtype[Any]", /) -> str | None:
        """Return the name of a file's compression where that changes values of a type; None where none is known to."""


class LayerFiles(Protocol):
    """How maps are written in a format, and named layers read from it."""

    def write_maps(self, path: Path, maps: "DepthMaps", /, *, header: "MapHeader") -> Sequence[memoryview]:
        """Write the maps of a frame: layers by name, then the status bits. The same maps give the same bytes.

        Return nothing after the file was written, or its bytes in parts, which the caller writes.
        """

    def read_facts(self, path: Path, /) -> dict[str, str]:
        """Return the facts in the header of a map file, by name; nothing where another program wrote it."""

    def read_layers(self, path: Path, /) -> "dict[str, NDArray[Any]]":
        """Return the layers of a file by name, (Y, X) each, as they are stored."""


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes:
        name: what options and `cadtof info` call it; files that we write end with it.
        title: what messages call it.
        suffixes: endings of its files in lower case, by which folders are searched.
        magics: first bytes of its files, by which a file is judged; none where the name has to do.
        stacks: whether a file may hold several frames.
        frames: loads the module that reads its frames.
        whole: whether a file may hold a whole frame, not one plane only.
        layers: loads the module that writes maps and reads layers; None where maps are not kept in it.
        recording: loads the module that writes frames; None where frames are only read.
        counts: whether a recording in it holds counts, not volts.
        compressions: loads the module that tells whether a file's compression changes values; None where no such is known.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    magics: tuple[bytes, ...]
    stacks: bool
    frames: Callable[[], FrameReader]
    whole: bool = True
    layers: Callable[[], LayerFiles] | None = None
    recording: Callable[[], FrameWriter] | None = None
    counts: bool = False
    compressions: Callable[[], Compressions] | None = None


def _module(name: str) -> Callable[[], Any]:
    """Return a function that imports a module of `files/` when it is first called."""
    return cache(partial(import_module, f"cadtof_cli.files.{name}"))


EXR = Format(
    name="exr",
    title="EXR",
    suffixes=(".exr",),
    magics=(b"\x76\x2f\x31\x01",),
    stacks=False,
    frames=_module("exr"),
    layers=_module("exr"),
    recording=_module("exr"),
    compressions=_module("exr"),
)

TIFF = Format(
    name="tif",
    title="TIFF",
    suffixes=(".tif", ".tiff"),
    magics=(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
    stacks=True,
    frames=_module("tiff.frames"),
    layers=_module("tiff.layers"),
    recording=_module("tiff.frames"),
    counts=True,
    compressions=_module("tiff.lossy"),
)

NPY = Format(name="npy", title="NPY", suffixes=(".npy",), magics=(b"\x93NUMPY",), stacks=True, frames=_module("npy"))

PNG = Format(
    name="png",
    title="PNG",
    suffixes=(".png",),
    magics=(b"\x89PNG\r\n\x1a\n",),
    stacks=False,
    frames=_module("png"),
    whole=False,
)

RAW = Format(
    name="raw",
    title="raw dump",
    suffixes=(".raw", ".bin", ".dat"),
    magics=(),
    stacks=True,
    frames=_module("raw"),
)

FORMATS = (EXR, TIFF, NPY, PNG, RAW)

FRAME_SUFFIXES = tuple(suffix for one in FORMATS if one.magics and one.whole for suffix in one.suffixes)
"""Endings of files that count as frames in any folder."""

MAP_SUFFIXES = tuple(suffix for one in FORMATS if one.layers for suffix in one.suffixes)

FRAME_FORMATS = tuple(one.name for one in reversed(FORMATS) if one.recording)
"""Names of the formats that a simulated camera records in, the usual one first."""

MAP_FORMATS = tuple(one.name for one in FORMATS if one.layers)
"""Names of the formats that maps are written in."""

AS_INPUT = "same"
"""Stands for the format of the frames, where that of their maps is named."""

_BY_NAME = {one.name: one for one in FORMATS}
_BY_SUFFIX = {suffix: one for one in FORMATS for suffix in one.suffixes}


def format_by_name(name: str, /) -> Format:
    """Return the format of that name."""
    return _BY_NAME[name]


def format_by_suffix(path: Path, /) -> Format | None:
    """Return the format that the ending of a file's name says; None for others. Names may be wrong: see `detect_format`."""
    return _BY_SUFFIX.get(path.suffix.lower())


def map_format(name: str, frame: Path, /) -> Format:
    """Return the format of the maps of a frame: the one named, or for `same` that of the frame.

    It is TIFF where no maps are kept in that, or the frame's name does not tell.
    """
    if name != AS_INPUT:
        return format_by_name(name)
    found = format_by_suffix(frame)
    return found if found and found.layers else TIFF


def frame_suffixes(*, planes: bool, raw: bool) -> tuple[str, ...]:
    """Return the endings of files that a capture may be recorded in.

    Args:
        planes: whether files are to hold a plane each, by `[layout] pattern`.
        raw: whether `[layout.raw]` says what raw dumps hold.
    """
    taken = (one for one in FORMATS if (one.magics or raw) and (one.whole or planes))
    return tuple(suffix for one in taken for suffix in one.suffixes)


def detect_format(path: Path, /, *, raw: bool = False) -> Format:
    """Return the format of a file by its first bytes; where `[layout.raw]` says what raw dumps hold, theirs by its name.

    Raises:
        FrameError: the file cannot be read, or is of no format that we know.
    """
    if raw and format_by_suffix(path) is RAW:
        return RAW
    with damage_as_frame_error(path, "file"):
        descriptor = open_regular(path)
        try:
            head = os.read(descriptor, _HEAD_BYTES)
        finally:
            os.close(descriptor)
    known = next((one for one in FORMATS if head.startswith(one.magics)), None)
    if known is None and head.startswith(b"MATLAB "):
        from cadtof_cli.files.matlab import matlab_refusal

        raise matlab_refusal(path, head)
    if known is None:
        found = f"first bytes {head[:4].hex(' ')}" if head else "an empty file"
        titles = ", ".join(one.title for one in FORMATS if one.magics)
        hint = ""
        if raw:
            hint = f"; the names of raw dumps end with {', '.join(RAW.suffixes)}"
        elif format_by_suffix(path) is RAW:
            hint = "; for a raw dump, give dtype and shape under [layout.raw]"
        raise FrameError(f"{path}: found {found}, expected one of {titles}{hint}")
    return known
