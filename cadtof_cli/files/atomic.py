"""Files and folders that appear whole or not at all: written under a temporary name, then renamed."""

import errno
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cadtof_cli.errors import OutputError, PlaceError
from cadtof_cli.files.system import CREATE_FLAGS, most_bytes_of_a_file, remove_and_close, sync_folder, write_parts

PARTIAL_SUFFIX = ".partial"

_ERRORS_OF_THE_PLACE = frozenset(
    {
        errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.ESTALE, errno.ENODEV,
        errno.ENOENT, errno.ENOTDIR, errno.EACCES, errno.EPERM,
    }
)  # fmt: skip
"""Errors that keep every file from being written there, not only this one."""

_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


class PartialFile:
    """A file that is written under a temporary name beside `path`, until it is committed or discarded.

    The temporary file exists already, empty; nobody else has made it. `commit` syncs the content to the disk before it renames
    the file, and the folder before it returns: whatever happens, there is a whole file or none. A symbolic link at `path` is
    replaced, not followed. `parts`, where they are set, are what `commit` writes, one after the other; nobody must change them
    until then.

    Args:
        path: the file to be written.
        token: marks the temporary name, so that `remove_partial_files` finds what a killed writer left.

    Raises:
        OutputError: the file cannot be made; PlaceError: another could not be made either.
    """

    def __init__(self, path: Path, /, *, token: str = "") -> None:
        self.path = path
        # only the beginning of the name, which may already have the greatest length of a name
        name = f".{path.name[:40]}.{os.urandom(8).hex()}.{token or os.getpid()}{PARTIAL_SUFFIX}"
        self.temporary = path.with_name(name)
        self._descriptor: int | None = None
        self.parts: Sequence[memoryview] = ()
        try:
            self._descriptor = os.open(self.temporary, CREATE_FLAGS, 0o666)
        except OSError as error:
            raise not_written(path, error) from error

    def commit(self, let_go: Callable[[], None] = lambda: None, /) -> int:
        """Sync the file to the disk, rename it to `path`, and return its size in bytes; this waits, and hardly computes.

        Args:
            let_go: called when the parts are written, and kept no longer.

        Raises:
            OutputError: that fails, and the file is discarded; PlaceError: another file would fail too.
        """
        assert self._descriptor is not None
        size = sum(part.nbytes for part in self.parts) or None
        try:
            if self.parts:
                write_parts(self._descriptor, self.parts)
                self.parts = ()
            let_go()
            found = os.fstat(self._descriptor)
            if not found.st_size or not os.path.samestat(found, os.lstat(self.temporary)):
                raise OSError("nothing was written")
            os.fsync(self._descriptor)
            # not every system renames an open file
            descriptor, self._descriptor = self._descriptor, None
            os.close(descriptor)
            os.replace(self.temporary, self.path)
            sync_folder(self.path.parent)
        except OSError as error:
            self.discard()
            raise not_written(self.path, error, size=size) from error
        except BaseException:
            self.discard()
            raise
        return found.st_size

    def discard(self) -> None:
        """Remove what was written."""
        if self._descriptor is not None:
            remove_and_close(self.temporary, self._descriptor)
        else:
            with suppress(OSError):
                self.temporary.unlink()


@contextmanager
def atomic_write(path: Path, /) -> Iterator[Path]:
    """Yield a temporary name beside `path`; what is written there replaces `path` on leaving, or is removed on an error.

    Raises:
        OutputError: the file cannot be written or renamed; PlaceError: another would fail too.
    """
    partial = PartialFile(path)
    try:
        with writing(path):
            yield partial.temporary
    except BaseException:
        partial.discard()
        raise
    partial.commit()


@contextmanager
def writing(path: Path, /) -> Iterator[None]:
    """Turn the system's errors in writing a file into what they mean for a user, see `not_written`.

    Raises:
        OutputError: the file cannot be written; PlaceError: another would fail too.
    """
    try:
        yield
    except OSError as error:
        raise not_written(path, error) from error


def not_written(path: Path, error: OSError, /, *, size: int | None = None) -> OutputError:
    """Return what an error of the system means for a user: whether the file that is written is at fault, or its place.

    Args:
        path: the file.
        error: of the system.
        size: about how many bytes were to be written; None: nobody knows.
    """
    told = error.strerror or str(error)
    if error.errno in _FULL and size is not None:
        told += f" for {size:,} bytes"
    limit = most_bytes_of_a_file() if error.errno == errno.EFBIG else None
    if limit is not None:
        told += f"; here a file may have {limit:,} (ulimit -f)"
    kind = PlaceError if error.errno in _ERRORS_OF_THE_PLACE else OutputError
    return kind(f"{path}: cannot be written: {told}")


def remove_partial_files(folder: Path, /, *, token: str) -> None:
    """Remove the half-written files that killed writers with this token left in a folder, or below it; `*`: with any."""
    with suppress(OSError):
        for leftover in folder.rglob(f".*.{token}{PARTIAL_SUFFIX}"):
            leftover.unlink(missing_ok=True)


def write_text(path: Path, text: str, /) -> None:
    """Write a text, whole or not at all; its lines end the same on every system.

    Raises:
        OutputError: the file cannot be written; PlaceError: another would fail too.
    """
    content = memoryview(text.encode())
    partial = PartialFile(path)
    partial.parts = [content]
    partial.commit()


def write_json(path: Path, document: Mapping[str, Any], /) -> None:
    """Write a JSON document, readable by people, whole or not at all."""
    write_text(path, json.dumps(document, indent=2, default=str) + "\n")


def make_folder(path: Path, /) -> None:
    """Make a folder, and its parents, that files can be written into.

    Raises:
        OutputError: it is a file, or cannot be made or written into.
    """
    probe = path / f".cadtof.{os.urandom(8).hex()}{PARTIAL_SUFFIX}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(probe, CREATE_FLAGS)
        try:
            os.close(descriptor)
        finally:
            probe.unlink()
    except OSError as error:
        raise OutputError(f"{path}: expected a folder that can be written into: {error.strerror}") from error


def require_new(path: Path, /, *, overwrite: bool) -> None:
    """Refuse to replace a file, before any work is done for it.

    Raises:
        OutputError: something is there already, and `overwrite` is not set.
    """
    if os.path.lexists(path) and not overwrite:
        raise OutputError(f"{path}: already exists; add --overwrite to replace it, or choose another place")


def require_absent(path: Path, /) -> None:
    """Raise OutputError where there is a file, or a folder that is not empty."""
    if path.is_dir() and not any(path.iterdir()):
        return
    if path.exists() or path.is_symlink():
        kind = "a folder with files" if path.is_dir() else "a file"
        raise OutputError(f"{path}: found {kind}, expected nothing there; choose another OUT or remove it")


@contextmanager
def new_folder(path: Path, /) -> Iterator[Path]:
    """Yield a temporary folder beside `path`, and rename it to `path` on success.

    Raises:
        OutputError: something is there already, or the place cannot be written.
    """
    require_absent(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.{os.urandom(16).hex()}{PARTIAL_SUFFIX}")
        partial.mkdir()
    except OSError as error:
        raise OutputError(f"{path}: cannot be created: {error.strerror}; choose another OUT") from error
    try:
        yield partial
        partial.replace(path)
    except OutputError as error:
        # the temporary name tells nobody anything
        raise type(error)(str(error).replace(str(partial), str(path))) from error
    except OSError as error:
        raise not_written(path, error) from error
    finally:
        import shutil

        shutil.rmtree(partial, ignore_errors=True)
