"""Point clouds with values for each point, in binary formats that other software reads: PLY and PCD."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.files.atomic import atomic_write

Columns = Mapping[str, NDArray[np.float32] | NDArray[np.uint32]]
"""Columns of values by name, (n,) each for n points."""

_PLY_TYPES = {"f": "float", "u": "uint"}


def write_points(path: Path, columns: Columns, /, *, comment: str) -> None:
    """Write points in the format of `path`'s suffix, binary and little-endian; the file appears whole or not at all."""
    count = len(next(iter(columns.values())))
    points = np.empty(count, [(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    for name, values in columns.items():
        points[name] = values
    header = _HEADERS[path.suffix.lower()]
    # the comment names files, and a line break in a name must not end the comment
    head = header(columns, count, " ".join(comment.split())).encode("utf-8", "replace")
    with atomic_write(path) as temporary:
        temporary.write_bytes(head + points.tobytes())


def _ply_header(columns: Columns, count: int, comment: str) -> str:
    properties = "".join(f"property {_PLY_TYPES[values.dtype.kind]} {name}\n" for name, values in columns.items())
    return f"ply\nformat binary_little_endian 1.0\ncomment {comment}\nelement vertex {count}\n{properties}end_header\n"


def _pcd_header(columns: Columns, count: int, comment: str) -> str:
    fields = {
        "FIELDS": columns,
        "SIZE": [values.itemsize for values in columns.values()],
        "TYPE": [values.dtype.kind.upper() for values in columns.values()],
        "COUNT": [1 for _ in columns],
        "WIDTH": [count],
        "HEIGHT": [1],
        "VIEWPOINT": [0, 0, 0, 1, 0, 0, 0],
        "POINTS": [count],
    }
    lines = "".join(f"{name} {' '.join(map(str, values))}\n" for name, values in fields.items())
    return f"# .PCD v0.7 - {comment}\nVERSION 0.7\n{lines}DATA binary\n"


_HEADERS: dict[str, Callable[[Columns, int, str], str]] = {".ply": _ply_header, ".pcd": _pcd_header}
"""Functions that return the header of a file, by suffix: PLY, and PCD of version 0.7."""
