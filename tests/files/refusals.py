"""The message of a reader that refuses a file, and writers of files to be refused."""

from pathlib import Path
from typing import Any

import OpenEXR
import pytest
import tifffile

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout

LAYOUT = FrameLayout((1, 2))


def message(path: Path, layout: FrameLayout = LAYOUT, *, kind: type[FrameError] = FrameError) -> str:
    return message_of(FrameSource(path.stem, (path,)), layout, kind=kind)


def message_of(source: FrameSource, layout: FrameLayout = LAYOUT, *, kind: type[FrameError] = FrameError) -> str:
    with pytest.raises(FrameError) as caught, open_frames(source, layout) as frames:
        frames.read()
    assert type(caught.value) is kind
    return str(caught.value)


def write_exr(path: Path, channels: dict[str, Stored], **header: Any) -> Path:
    OpenEXR.File(header, channels, num_threads=0).write(str(path))
    return path


def write_pages(path: Path, pages: Stored, **options: Any) -> Path:
    tifffile.imwrite(path, pages, photometric="minisblack", **{"metadata": None, **options})
    return path
