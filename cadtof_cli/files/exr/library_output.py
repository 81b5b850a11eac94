"""What the OpenEXR library prints, caught before it reaches the terminal.

On damaged files the library writes to file descriptor 2 from C++ and to `sys.stdout` from its Python binding, and then
hands back fewer parts, or wrong pixels, as if nothing had happened. What it prints is the only sign.
"""

import contextlib
import io
import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator

_STDERR = 2

_ITS_WORDS = re.compile(r"EXR|^Warning: ", re.IGNORECASE)

_lock = threading.Lock()
"""Standard error belongs to the process, so threads take turns."""


@contextlib.contextmanager
def library_output() -> Iterator[list[str]]:
    """Collect the lines that the library prints within the block; the list is filled when the block ends.

    Lines that other threads print meanwhile, such as a progress bar, are passed on.
    """
    said: list[str] = []
    with _lock:
        printed = io.StringIO()
        unprinted = b""
        kept = _unnamed_file()
        stderr = os.dup(_STDERR)
        try:
            os.dup2(kept, _STDERR)
            with contextlib.redirect_stdout(printed):
                yield said
        finally:
            os.dup2(stderr, _STDERR)
            os.close(stderr)
            unprinted = os.pread(kept, os.fstat(kept).st_size, 0)
            os.close(kept)
            if unprinted or printed.tell():
                _sort_out(said, printed.getvalue(), unprinted.decode(errors="replace"))


def _unnamed_file() -> int:
    """Return a descriptor of a file that nobody else sees; a pipe would block when it is full."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("cadtof")
    with tempfile.TemporaryFile() as stream:
        return os.dup(stream.fileno())


def _sort_out(said: list[str], printed: str, unprinted: str) -> None:
    """Keep the library's lines, and write those of other threads to where they were going."""
    alone = threading.active_count() == 1
    for text, stream in ((unprinted, sys.stderr), (printed, sys.stdout)):
        for line in text.splitlines(keepends=True):
            if alone or _ITS_WORDS.search(line):
                said.append(line.strip())
            else:
                stream.write(line)
