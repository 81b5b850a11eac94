"""Frames in TIFF files, one a file or in stacks."""

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.damage import damage_as_frame_error
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, LoneFrame
from cadtof_cli.files.plane_table import plane_table
from cadtof_cli.files.tiff.envelope import Envelope
from cadtof_cli.files.tiff.images import TiffImages
from cadtof_cli.records import dataclass


class TiffFrames:
    """The frames of one TIFF file, read one by one.

    Parameters:
        path: a TIFF or BigTIFF file of either byte order.
        layout: harmonics of the capture, and frames of a stack where the metadata says it.

    Raises:
        NotAFrameError: the file holds maps, not voltages.
        FrameError: the file cannot be read, is damaged, or its planes do not make up whole frames.
    """

    format = "tif"

    def __init__(self, path: Path, layout: FrameLayout) -> None:
        self.images = images = TiffImages(path)
        try:
            self._table = plane_table(images.labels, images.sizes, layout, where=images.found, names=images.names)
        except FrameError:
            images.close()
            raise
        self.count = len(self._table)
        self.shape = (len(layout.harmonics), CHANNELS, *self.images.plane_shape)
        self.dtype: np.dtype[Any] = self.images.dtype

    def read(self, index: int = 0, /) -> Stored:
        """Return frame `index` as it is stored: shape (H, C, Y, X), C-contiguous, native byte order."""
        return self.images.planes(self._table[index].ravel()).reshape(self.shape)

    def envelope(self) -> Envelope | None:
        """Return what stands around the pixels of the only frame; None where they are not in one run, as they are read."""
        return self.images.envelope(self._table[0].ravel()) if self.count == 1 else None


@dataclass(frozen=True)
class _LoneFile:
    """What a file with one frame holds, and what stands around its pixels."""

    layout: FrameLayout
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    envelope: Envelope

    def frame_of(self, path: Path, layout: FrameLayout, /) -> LoneFrame | None:
        """Return the frame of a file that differs from this in its pixels alone; None where it does not."""
        stored = np.empty(self.shape, self.dtype)
        return LoneFrame("tif", stored) if layout == self.layout and self.envelope.read(path, stored) else None


class _Last(threading.local):
    """What was last read in a thread: the stack, whose pages are known and whose file is closed, or the file with one frame.

    The key of a stack changes when its file does.
    """

    key: object = None
    stack: TiffFrames | None = None
    file: _LoneFile | None = None


_last = _Last()


@contextmanager
def open_frames(path: Path, layout: FrameLayout, /) -> Iterator[Frames]:
    """Open a TIFF file.

    A worker that takes a stack frame by frame finds its thousands of pages once. A file that differs in its pixels alone from
    the one read before is as sound as that was, and is read at once.
    """
    with damage_as_frame_error(path, "TIFF"):
        state = path.stat()
        lone = _last.file.frame_of(path, layout) if _last.file else None
    if lone:
        yield lone
        return
    key = (path, layout, state.st_ino, state.st_size, state.st_mtime_ns)
    frames = _last.stack if _last.stack and _last.key == key else TiffFrames(path, layout)
    _last.key, _last.stack = (key, frames) if frames.count > 1 else (None, None)
    frames.images.open()
    with closing(frames.images):
        with damage_as_frame_error(path, "TIFF"):
            envelope = frames.envelope()
        _last.file = _LoneFile(layout, frames.shape, frames.dtype, envelope) if envelope else None
        yield frames


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the one plane of a TIFF file, shape (Y, X), native byte order.

    Raises:
        FrameError: the file cannot be read, is damaged, or holds more than one plane.
    """
    with closing(TiffImages(path)) as images:
        if max(images.sizes) > 1:
            raise FrameError(f"{images.found}, expected a single plane")
        plane: Stored = images.planes(np.zeros(1, np.intp))[0]
        return plane


def write_frame(path: Path, stored: Stored, /, *, layout: FrameLayout, compress: bool) -> None:
    """Write a frame, shape (H, C, Y, X), one page per plane; its axes are said as H C Y X."""
    tifffile.imwrite(
        path,
        stored,
        photometric="minisblack",
        metadata={"axes": "HCYX"},
        compression="zlib" if compress else None,
    )
