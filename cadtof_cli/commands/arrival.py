"""Paths on stdin, handed on as they arrive.

They come from `find`, which writes many paths and ends, or from a program that watches a folder for days.
"""

import os
import time
from collections.abc import Iterator
from pathlib import Path

from cadtof_cli.files.system import has_more, path_of

PAUSE_S = 0.5
"""Seconds without a new path after which the paths that have arrived count as all paths that there are at present."""

SETTLED_S = 5.0
"""Seconds after which a batch of paths is handed on, even if more paths keep coming."""

_READ_BYTES = 2**16


def paths_as_they_arrive(descriptor: int, /, *, separator: bytes) -> Iterator[tuple[Path, ...]]:
    """Yield paths in batches: each batch as soon as nothing more can be read, the last one when the writer has ended.

    If paths end with a line feed, empty lines are skipped, and the carriage return of a line that Windows wrote is removed. With
    any other `separator`, each name is taken as it is.
    """
    rest, first, as_lines = b"", True, separator == b"\n"
    while True:
        content, ended = _read_batch(descriptor, pause_s=PAUSE_S if first else 0.0)
        *whole, rest = (rest + content).split(separator)
        if ended and rest:
            whole.append(rest)
        names = [name.removesuffix(b"\r") for name in whole if name.strip()] if as_lines else filter(None, whole)
        if paths := tuple(map(path_of, names)):
            first = False
            yield paths
        if ended:
            return


def _read_batch(descriptor: int, *, pause_s: float) -> tuple[bytes, bool]:
    """Wait for something to read; return everything up to the next pause, and whether the input has ended."""
    content, until = os.read(descriptor, _READ_BYTES), time.monotonic() + SETTLED_S
    ended = not content
    while not ended and time.monotonic() < until and has_more(descriptor, pause_s=pause_s):
        piece = os.read(descriptor, _READ_BYTES)
        ended = not piece
        content += piece
    return content, ended
