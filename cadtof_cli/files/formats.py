"""The registry of file formats. A format is one entry here and the modules that the entry names.

Options and discovery use the registry when the program starts. So the library of a format is loaded only when a file of
that format is read or written.
"""

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

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
"""Number of first bytes that are read to recognise a format; messages show four of these bytes."""


class FrameFiles(Protocol):
    """How the frames of a format are read and written. A file that cannot be read raises a FrameError that names the file."""

    def open_frames(self, path: Path, layout: "FrameLayout", /) -> AbstractContextManager["Frames"]:
        """Open a file of whole frames (formats with `whole`); raise NotAFrameError if it holds no voltages."""

    def read_plane(self, path: Path, layout: "FrameLayout", /) -> "Stored":
        """Return the one plane of a file, shape (Y, X), native byte order."""

    def write_frame(self, path: Path, stored: "Stored", /, *, layout: "FrameLayout", compress: bool) -> None:
        """Write one frame, shape (H, C, Y, X), without loss (formats with `recording`)."""


class Compressions(Protocol):
    """How to find out whether the compression of a format's files changes values."""

    def lossy_compression(self, path: Path, dtype: "np.dtype[Any]", /) -> str | None:
        """Return the name of the file's compression if it is known to change values of type `dtype`, else None."""


class LayerFiles(Protocol):
    """How maps are written in a format, and how named layers are read from it.

    A file that cannot be read raises a FrameError, and a file without named layers a NotMapsError.
    """

    def write_maps(self, path: Path, maps: "DepthMaps", /, *, header: "MapHeader") -> Sequence[memoryview]:
        """Write the maps of a frame: layers in their order, then the status bits. The same maps give the same bytes.

        Return nothing (an empty sequence) if the file has been written, or else its parts in their order, for the
        caller to write.
        """

    def read_facts(self, path: Path, /) -> dict[str, str]:
        """Return the facts in the header of a map file, by name; empty if another program wrote the file."""

    def read_layers(self, path: Path, /) -> "dict[str, NDArray[Any]]":
        """Return the layers of a file by name, (Y, X) each, as they are stored."""


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes:
        name: the name in options and in `cadtof info`, and the suffix of files that we write.
        title: the name in messages.
        suffixes: suffixes of its files in lower case; folders are searched for them.
        magics: first bytes of its files, by which a file is recognised; empty if files can be recognised only by their
            name.
        stacks: whether a file may hold several frames.
        frames: loads the module that reads and writes frames.
        whole: whether a file may hold a whole frame; False: a file holds one plane.
        layers: loads the module that writes maps and reads layers; None: the format is not used for maps.
        recording: what the simulated camera records in this format; None: frames of this format are only read.
        compressions: loads the module that tells whether a file's compression changes values; None: no compression of
            this format is known to change values.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    magics: tuple[bytes, ...]
    stacks: bool
    frames: Callable[[], FrameFiles]
    whole: bool = True
    layers: Callable[[], LayerFiles] | None = None
    recording: Literal["volts", "counts"] | None = None
    compressions: Callable[[], Compressions] | None = None


def _module(name: str) -> Callable[[], Any]:
    """Return a function that returns a module of `files/`, and imports it when it is first called."""
    return cache(partial(import_module, f"cadtof_cli.files.{name}"))


EXR = Format(
    name="exr",
    title="EXR",
    suffixes=(".exr",),
    magics=(b"\x76\x2f\x31\x01",),
    stacks=False,
    frames=_module("exr"),
    layers=_module("exr"),
    recording="volts",
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
    recording="counts",
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
    name="raw", title="raw dump", suffixes=(".raw", ".bin", ".dat"), magics=(), stacks=True, frames=_module("raw")
)

FORMATS = (EXR, TIFF, NPY, PNG, RAW)

FRAME_SUFFIXES = tuple(suffix for one in FORMATS if one.magics and one.whole for suffix in one.suffixes)
"""Suffixes of the files that count as frames in every folder, without any metadata."""

MAP_SUFFIXES = tuple(suffix for one in FORMATS if one.layers for suffix in one.suffixes)

FRAME_FORMATS = tuple(one.name for one in reversed(FORMATS) if one.recording)
"""Names of the formats in which a simulated camera can record."""

MAP_FORMATS = tuple(one.name for one in FORMATS if one.layers)
"""Names of the formats in which maps can be written."""

AS_INPUT = "same"
"""Value of the option for the format of maps that means: the format of the frames."""

_BY_NAME = {one.name: one for one in FORMATS}
_BY_SUFFIX = {suffix: one for one in FORMATS for suffix in one.suffixes}


def format_by_name(name: str, /) -> Format:
    """Return the format of that name."""
    return _BY_NAME[name]


def format_by_suffix(path: Path, /) -> Format | None:
    """Return the format of a file by its suffix; None: unknown suffix. A name may be wrong: see `detect_format`."""
    return _BY_SUFFIX.get(path.suffix.lower())


def map_format(name: str, frame: Path, /) -> Format:
    """Return the format in which the maps of a frame are written.

    It is the format called `name`, or, if `name` is "same", the format that the suffix of the frame's file stands for.
    If that suffix is unknown, or if its format is not used for maps, it is TIFF.
    """
    if name != AS_INPUT:
        return format_by_name(name)
    found = format_by_suffix(frame)
    return found if found and found.layers else TIFF


def frame_suffixes(*, planes: bool, raw: bool) -> tuple[str, ...]:
    """Return the suffixes of the files in which a capture may be recorded.

    If `planes`, each file holds one plane, as `[layout] pattern` says. If `raw`, `[layout.raw]` says what raw dumps
    hold.
    """
    taken = (one for one in FORMATS if (one.magics or raw) and (one.whole or planes))
    return tuple(suffix for one in taken for suffix in one.suffixes)


def detect_format(path: Path, /, *, raw: bool = False) -> Format:
    """Return the format of a file by its first bytes; raise FrameError if it cannot be read, or its format is unknown.

    If `raw`, then `[layout.raw]` says what raw dumps hold: a file with the suffix of a raw dump is one, whatever its
    first bytes are.
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
    if known is not None:
        return known
    from cadtof_cli.files.named_arrays import named_arrays_refusal

    if refusal := named_arrays_refusal(path, head):
        raise refusal
    found = f"a file of another kind (first bytes {head[:4].hex(' ')})" if head else "an empty file"
    titles = ", ".join(one.title for one in FORMATS if one.magics)
    hint = ""
    if raw:
        hint = f"; the names of raw dumps end with {', '.join(RAW.suffixes)}"
    elif format_by_suffix(path) is RAW:
        hint = "; for a raw dump, give dtype and shape under [layout.raw]"
    raise FrameError(f"{path}: found {found}, expected one of {titles}{hint}")
