"""What the libraries of OpenEXR, PNG and JPEG XR print, caught before it reaches the terminal.

On damaged files they write to file descriptors 1 and 2 from C++ and to `sys.stdout` from a Python binding, and may then hand back
fewer parts, or wrong pixels, as if nothing had happened. What they print is the only sign.
"""

import contextlib
import io
import os
import re
import sys
import threading
from collections.abc import Iterator

from cadtof_cli.files.system import flush_c_streams, read_at

_DESCRIPTORS = (1, 2)
"""Standard output, on which a pipeline reads our JSON, and standard error."""

_LIBRARY_LINES = re.compile(r"EXR|ojph|^Warning: |^PNG |WMPTag", re.IGNORECASE)
"""The libraries' own, and those of OpenJPH, by which one reads HTJ2K."""

_lock = threading.Lock()
"""The descriptors belong to the process, so threads take turns."""


@contextlib.contextmanager
def library_output() -> Iterator[list[str]]:
    """Collect the lines that a library prints within the block; the list is filled when the block ends.

    Lines that other threads print meanwhile, such as a progress bar, are passed on.
    """
    said: list[str] = []
    with _lock, contextlib.ExitStack() as opened:
        printed = io.StringIO()
        unprinted: dict[int, bytes] = {}
        single_thread = threading.active_count() == 1
        kept: dict[int, tuple[int, int]] = {}
        for descriptor in filter(_is_open, _DESCRIPTORS):
            # none is left open where no more may be
            file = _closed_with(opened, _unnamed_file())
            kept[descriptor] = file, _closed_with(opened, os.dup(descriptor))
        flush_c_streams()
        try:
            for descriptor, (file, _) in kept.items():
                os.dup2(file, descriptor)
            with contextlib.redirect_stdout(printed):
                yield said
        finally:
            flush_c_streams()
            for descriptor, (file, before) in kept.items():
                os.dup2(before, descriptor)
                unprinted[descriptor] = read_at(file, os.fstat(file).st_size, 0)
            if any(unprinted.values()) or printed.tell():
                out, err = (unprinted.get(descriptor, b"").decode(errors="replace") for descriptor in _DESCRIPTORS)
                _separate(
                    said, printed.getvalue() + out, err, single_thread=single_thread and threading.active_count() == 1
                )


def _closed_with(opened: contextlib.ExitStack, descriptor: int) -> int:
    opened.callback(os.close, descriptor)
    return descriptor


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def _unnamed_file() -> int:
    """Return a descriptor of a file that nobody else sees; a pipe would block when it is full."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("cadtof")
    # with random and shutil, more than a hundredth of the time that a command takes to start
    import tempfile

    with tempfile.TemporaryFile() as stream:
        return os.dup(stream.fileno())


def _separate(said: list[str], printed: str, unprinted: str, *, single_thread: bool) -> None:
    """Keep the library's lines, and write those of other threads, where there were any, to where they were going."""
    for text, stream in ((unprinted, sys.stderr), (printed, sys.stdout)):
        for line in text.splitlines(keepends=True):
            if single_thread or _LIBRARY_LINES.search(line):
                said.append(line.strip())
            else:
                stream.write(line)
