"""The message of a reader that refuses a file."""

from pathlib import Path

import pytest

from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout

LAYOUT = FrameLayout((1, 2))


def message(path: Path, layout: FrameLayout = LAYOUT, *, kind: type[FrameError] = FrameError) -> str:
    return message_of(FrameSource(path.stem, (path,)), layout, kind=kind)


def message_of(source: FrameSource, layout: FrameLayout = LAYOUT, *, kind: type[FrameError] = FrameError) -> str:
    with pytest.raises(FrameError) as caught, open_frames(source, layout) as frames:
        frames.read(0)
    assert type(caught.value) is kind
    return str(caught.value)
