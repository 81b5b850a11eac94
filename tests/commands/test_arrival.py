"""Paths on stdin: which names are read, for both separators."""

import os
from pathlib import Path

import pytest

from cadtof_cli.commands.arrival import paths_as_they_arrive


@pytest.mark.parametrize(
    ("content", "separator", "names"),
    [
        (b"a\nb", b"\n", ["a", "b"]),
        (b"a\r\n\n \r\nb \n", b"\n", ["a", "b "]),
        (b"dir\r\0b\0 \0", b"\0", ["dir\r", "b", " "]),
        (b"two\nlines\0\0last", b"\0", ["two\nlines", "last"]),
    ],
)
def test_names_are_read_as_their_writer_meant_them(content: bytes, separator: bytes, names: list[str]) -> None:
    """Lines lose the end that Windows gives them; names that end with a zero byte may hold any other byte."""
    reader, writer = os.pipe()
    os.write(writer, content)
    os.close(writer)
    with os.fdopen(reader, "rb"):
        (paths,) = paths_as_they_arrive(reader, separator=separator)
    assert paths == tuple(map(Path, names))
