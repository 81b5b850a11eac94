"""The kind of a file, by its first bytes: names lie."""

import os
from dataclasses import dataclass
from pathlib import Path

from cadtof_cli.errors import FrameError
from cadtof_cli.files.damage import damage_as_frame_error
from cadtof_cli.files.frames import Container

_MAGICS: dict[bytes, Container] = {
    b"\x76\x2f\x31\x01": "exr",
    b"II*\0": "tif",
    b"MM\0*": "tif",
    b"II+\0": "tif",
    b"MM\0+": "tif",
}


@dataclass(frozen=True)
class FileState:
    """What changes when a file is replaced or written to."""

    inode: int
    size: int
    modified_ns: int


def container_of(path: Path) -> tuple[Container, FileState]:
    """Return the kind of a file, and what tells later whether it is still the same file.

    Raises:
        FrameError: the file cannot be read or is neither TIFF nor EXR.
    """
    with damage_as_frame_error(path, "file"):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            status = os.fstat(descriptor)
            magic = os.pread(descriptor, 4, 0)
        finally:
            os.close(descriptor)
    if magic not in _MAGICS:
        found = f"first bytes {magic.hex(' ')}" if magic else "an empty file"
        allowed = " or ".join(known.hex(" ") for known in list(_MAGICS)[:3])
        raise FrameError(f"{path}: neither TIFF nor EXR: found {found}, expected {allowed}")
    return _MAGICS[magic], FileState(status.st_ino, status.st_size, status.st_mtime_ns)
