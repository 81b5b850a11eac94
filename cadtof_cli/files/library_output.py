"""Catches the text that the libraries of OpenEXR, PNG and JPEG XR print, before it reaches the terminal.

When a file is damaged, these libraries print to file descriptors 1 and 2 from C++, and to `sys.stdout` from a Python
binding. Then they may return fewer parts, or wrong pixels, without any error. The printed text is the only sign of the
damage.
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
"""Standard output, from which other programs read our JSON, and standard error."""

_LIBRARY_LINES = re.compile(r"EXR|ojph|^Warning: |^PNG |WMPTag", re.IGNORECASE)
"""Lines that come from these libraries, or from OpenJPH, with which OpenEXR decodes HTJ2K."""

_lock = threading.Lock()
"""All threads of the process share the descriptors, so only one thread at a time may redirect them."""


@contextlib.contextmanager
def library_output() -> Iterator[list[str]]:
    """Collect the lines that a library prints within the block; the list is filled when the block ends.

    Lines that other threads print at the same time, such as a progress bar, are printed after the block.
    """
    lines: list[str] = []
    with _lock, contextlib.ExitStack() as opened:
        from_python = io.StringIO()
        from_c: dict[int, bytes] = {}
        single_thread = threading.active_count() == 1
        kept: dict[int, tuple[int, int]] = {}
        for descriptor in filter(_is_open, _DESCRIPTORS):
            # all are closed again, even if the process may open no more files
            file = _closed_with(opened, _unnamed_file())
            kept[descriptor] = file, _closed_with(opened, os.dup(descriptor))
        flush_c_streams()
        try:
            for descriptor, (file, _) in kept.items():
                os.dup2(file, descriptor)
            with contextlib.redirect_stdout(from_python):
                yield lines
        finally:
            flush_c_streams()
            for descriptor, (file, before) in kept.items():
                os.dup2(before, descriptor)
                from_c[descriptor] = read_at(file, os.fstat(file).st_size, 0)
            if any(from_c.values()) or from_python.tell():
                out, err = (from_c.get(descriptor, b"").decode(errors="replace") for descriptor in _DESCRIPTORS)
                single_thread = single_thread and threading.active_count() == 1
                _separate(lines, from_python.getvalue() + out, err, single_thread=single_thread)


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
    """Return a descriptor of a file without a name; a pipe in its place would block when it is full."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("cadtof")
    # imported here, because this module, with random and shutil, takes more than 1 % of the time that a command takes
    # to start
    import tempfile

    with tempfile.TemporaryFile() as stream:
        return os.dup(stream.fileno())


def _separate(lines: list[str], out: str, err: str, *, single_thread: bool) -> None:
    """Append the library's lines to `lines`; write those of other threads, if there are any, to stdout and stderr."""
    for text, stream in ((err, sys.stderr), (out, sys.stdout)):
        for line in text.splitlines(keepends=True):
            if single_thread or _LIBRARY_LINES.search(line):
                lines.append(line.strip())
            else:
                stream.write(line)
