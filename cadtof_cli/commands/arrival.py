"""Paths on stdin, handed on as they arrive: from `find`, which writes many and ends, or from what watches a folder for days."""

import os
import select
import time
from collections.abc import Iterator
from pathlib import Path

PAUSE_S = 0.5
"""Time without a new path after which the paths that came are taken to be all that there are at present."""

SETTLED_S = 5.0
"""After so long the first paths are handed on, even where more keep coming."""

_READ_BYTES = 2**16


def paths_as_they_arrive(descriptor: int, /, *, separator: bytes = b"\n") -> Iterator[tuple[Path, ...]]:
    """Yield paths in batches, each as soon as nothing more is there to be read; the last when the writer has ended.

    Args:
        descriptor: of what is read, such as stdin's.
        separator: what ends a path.
    """
    rest, first = b"", True
    while True:
        content, ended = _read_batch(descriptor, pause_s=PAUSE_S if first else 0.0)
        *whole, rest = (rest + content).split(separator)
        if ended and rest:
            whole.append(rest)
        if paths := tuple(Path(os.fsdecode(name.removesuffix(b"\r"))) for name in whole if name.strip()):
            first = False
            yield paths
        if ended:
            return


def _read_batch(descriptor: int, *, pause_s: float) -> tuple[bytes, bool]:
    """Wait for something to read; return it with all that follows before a pause, and whether that is the end."""
    content, until = os.read(descriptor, _READ_BYTES), time.monotonic() + SETTLED_S
    ended = not content
    while not ended and time.monotonic() < until and _has_more(descriptor, pause_s):
        piece = os.read(descriptor, _READ_BYTES)
        ended = not piece
        content += piece
    return content, ended


def _has_more(descriptor: int, pause_s: float) -> bool:
    """Wait until there is more to read, or for the pause; no pipe can be waited for so on Windows: one piece is all then."""
    try:
        return bool(select.select([descriptor], [], [], pause_s)[0])
    except OSError:
        return False
