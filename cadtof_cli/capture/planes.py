"""Frames whose planes lie in files of their own."""

from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.formats import container_of
from cadtof_cli.files.frames import CHANNELS, Container, FrameLayout, FrameSource, shape_text


class PlaneFrames:
    """One frame put together from files of one plane each, all of them read on opening.

    Parameters:
        source: the frame, with its files in the order H1.SC1, H1.SC2, H2.SC1, …
        layout: harmonics of the capture.

    Raises:
        FrameError: a file is missing, cannot be read, is damaged, or its plane differs from the others.
    """

    count = 1

    def __init__(self, source: FrameSource, layout: FrameLayout) -> None:
        if len(source.paths) != layout.planes:
            raise FrameError(f"frame {source.name}: found {len(source.paths)} files, expected {layout.planes}")
        for path, name in zip(source.paths, layout.plane_names, strict=True):
            if not path.exists():
                raise FrameError(f"{path}: no such file, expected {name} of frame {source.name} there")
        self.container: Container = container_of(source.paths[0])[0]
        planes = [_read_plane(path) for path in source.paths]
        first = planes[0]
        for path, plane in zip(source.paths, planes, strict=True):
            if plane.shape != first.shape or plane.dtype != first.dtype:
                raise FrameError(
                    f"{path}: found {shape_text(plane.shape, plane.dtype)}, expected"
                    f" {shape_text(first.shape, first.dtype)} as in {source.paths[0].name}"
                )
        self.shape = (len(layout.harmonics), CHANNELS, first.shape[0], first.shape[1])
        self.dtype: np.dtype[Any] = first.dtype
        self._frame: Stored = np.stack(planes).reshape(self.shape)

    def read(self, _index: int = 0, /) -> Stored:
        """Return the frame as it is stored: shape (H, C, Y, X), C-contiguous, native byte order."""
        return self._frame


def _read_plane(path: Path) -> Stored:
    if container_of(path)[0] == "exr":
        from cadtof_cli.files.exr.frames import read_plane

        return read_plane(path)
    from cadtof_cli.files.tiff.frames import read_plane as read_tiff_plane

    return read_tiff_plane(path)
