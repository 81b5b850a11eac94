"""Files and folders that appear whole or not at all: written under a temporary name, then renamed."""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

from cadtof_cli.errors import OutputError

PARTIAL_SUFFIX = ".partial"

FULL_BYTES = 2**20
"""A disk with less than this left is what kept a file from being written, where the writer does not say."""


@contextmanager
def whole_file(path: Path, /, *, token: str = "") -> Iterator[Path]:
    """Yield a temporary name beside `path`; what is written there replaces `path` on leaving, or is removed on an error.

    Args:
        path: the file to be written.
        token: marks the temporary name, so that `remove_partial_files` finds what a killed writer left.

    Raises:
        OutputError: the file cannot be written or renamed.
    """
    temporary = path.with_name(f".{path.name}.{token or os.getpid()}{PARTIAL_SUFFIX}")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror or _without_code(error, path.parent)}"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _without_code(error: OSError, folder: Path) -> str:
    """Return what an error without a system's message means: numpy and OpenEXR say how much they could not write."""
    full = folder.is_dir() and shutil.disk_usage(folder).free < FULL_BYTES
    return "No space left on device" if full else str(error)


def remove_partial_files(folder: Path, /, *, token: str) -> None:
    """Remove the half-written files that killed writers with this token left in a folder, or below it."""
    for leftover in folder.rglob(f".*.{token}{PARTIAL_SUFFIX}"):
        leftover.unlink(missing_ok=True)


def write_json(path: Path, document: Mapping[str, Any], /) -> None:
    """Write a JSON document, readable by people, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, default=str) + "\n", encoding="utf-8")


def make_folder(path: Path, /) -> None:
    """Make a folder, and its parents, that files can be written into.

    Raises:
        OutputError: it is a file, or cannot be made or written into.
    """
    probe = path / f".cadtof.{os.getpid()}{PARTIAL_SUFFIX}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"{path}: expected a folder that can be written into: {error.strerror}") from error


def make_folders(path: Path, /) -> None:
    """Make a folder, and its parents.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: expected a folder that can be made: {error.strerror}") from error


def require_absent(path: Path, /) -> None:
    """Raise OutputError where something stands already; an empty folder is as good as none."""
    if path.is_dir() and not any(path.iterdir()):
        return
    if path.exists() or path.is_symlink():
        kind = "a folder with files" if path.is_dir() else "a file"
        raise OutputError(f"{path}: found {kind}, expected nothing there; choose another OUT or remove it")


@contextmanager
def new_folder(path: Path, /) -> Iterator[Path]:
    """Give a temporary folder beside `path` to write to, and rename it to `path` if all went well.

    Raises:
        OutputError: something is there already, or the place cannot be written.
    """
    require_absent(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.{uuid4().hex}{PARTIAL_SUFFIX}")
        partial.mkdir()
    except OSError as error:
        raise OutputError(f"{path}: cannot be created: {error.strerror}; choose another OUT") from error
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
