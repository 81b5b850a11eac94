"""Files and folders that appear whole or not at all: they are written under a temporary name, then renamed.

What cannot be written raises an OutputError: a PlaceError if no other file can be written there either.
"""

import errno
import json
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cadtof_cli.errors import OutputError, PlaceError
from cadtof_cli.files.system import CREATE_FLAGS, most_bytes_of_a_file, remove_and_close, sync_folder, write_parts

PARTIAL_SUFFIX = ".partial"

_ERRORS_OF_THE_PLACE = frozenset(
    {
        errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.ESTALE, errno.ENODEV,
        errno.ENOENT, errno.ENOTDIR, errno.EACCES, errno.EPERM, errno.ENOTCONN, errno.ETIMEDOUT, errno.EHOSTDOWN,
    }
)  # fmt: skip
"""Errors that concern the place, not the file: no other file can be written there either."""

_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


class PartialFile:
    """A file that is written under a temporary name beside `path`, until it is committed or discarded.

    The constructor creates the temporary file, empty, under a name that did not exist before. `commit` renames it to
    `path` (atomic rename). Before the rename it syncs the content to the disk, and before it returns it syncs the
    folder. So the new file is complete or absent, whatever happens. A symbolic link at `path` is replaced, not
    followed.

    If `parts` is set, `commit` writes these parts, one after the other. They must not change before `commit` returns.
    `token` is a part of the temporary name, by which `remove_partial_files` finds the files that a killed writer left.
    """

    def __init__(self, path: Path, /, *, token: str = "") -> None:
        self.path = path
        # only the beginning of the name: the name may already be as long as the system allows
        name = f".{path.name[:40]}.{os.urandom(8).hex()}.{token or os.getpid()}{PARTIAL_SUFFIX}"
        self.temporary = path.with_name(name)
        self._descriptor: int | None = None
        self.parts: Sequence[memoryview] = ()
        try:
            self._descriptor = os.open(self.temporary, CREATE_FLAGS, 0o666)
        except OSError as error:
            raise not_written(path, error) from error
        except BaseException:
            # a signal came while the file was created
            self.discard()
            raise

    def commit(self, let_go: Callable[[], None] = lambda: None, /) -> int:
        """Write the parts, sync the file to the disk, rename it to `path`, and return its size in bytes.

        Nearly all of the time is spent waiting for the disk. `let_go` is called when all parts are written and this
        object no longer holds them: their memory can be used again. If an OutputError is raised, the file has been
        discarded.
        """
        assert self._descriptor is not None
        with self.filling(sum(part.nbytes for part in self.parts) or None):
            if self.parts:
                write_parts(self._descriptor, self.parts)
                self.parts = ()
            let_go()
            found = os.fstat(self._descriptor)
            if not found.st_size or not os.path.samestat(found, os.lstat(self.temporary)):
                raise OSError("nothing was written")
            os.fsync(self._descriptor)
            # some systems cannot rename an open file
            descriptor, self._descriptor = self._descriptor, None
            os.close(descriptor)
            os.replace(self.temporary, self.path)
            sync_folder(self.path.parent)
        return found.st_size

    @contextmanager
    def filling(self, size: int | None = None, /) -> Iterator[None]:
        """Discard the file if the block, which writes about `size` bytes of it, raises; turn an OSError into an OutputError."""
        try:
            yield
        except BaseException as error:
            self.discard()
            if isinstance(error, OSError):
                raise not_written(self.path, error, size=size) from error
            raise

    def discard(self) -> None:
        """Close and remove the temporary file."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            remove_and_close(self.temporary, descriptor)
        else:
            with suppress(OSError):
                self.temporary.unlink()


@contextmanager
def atomic_write(path: Path, /) -> Iterator[Path]:
    """Yield the name of a temporary file beside `path`. It replaces `path` after the block, or is removed on an error."""
    partial = PartialFile(path)
    with partial.filling():
        yield partial.temporary
        partial.commit()


@contextmanager
def writing(path: Path, /) -> Iterator[None]:
    """Turn an OSError in the block, in which `path` is written, into the error that `not_written` returns."""
    try:
        yield
    except OSError as error:
        raise not_written(path, error) from error


def not_written(path: Path, error: OSError, /, *, size: int | None = None) -> OutputError:
    """Return the error for a user: PlaceError if no file can be written at that place, else OutputError.

    `error` is what the operating system raised, `size` the approximate number of bytes that were to be written, if
    known.
    """
    told = error.strerror or str(error)
    if error.errno in _FULL and size is not None:
        told += f" for {size:,} bytes"
    limit = most_bytes_of_a_file() if error.errno == errno.EFBIG else None
    if limit is not None:
        told += f"; here a file may have {limit:,} (ulimit -f)"
    kind = PlaceError if error.errno in _ERRORS_OF_THE_PLACE else OutputError
    return kind(f"{path}: cannot be written: {told}")


def remove_partial_files(folder: Path, /, *, tokens: Collection[str] | None = None) -> None:
    """Remove the temporary files that writers with these tokens (None: any) left in a folder or below it."""
    with suppress(OSError):
        for leftover in folder.rglob(f".*.*{PARTIAL_SUFFIX}"):
            if tokens is None or leftover.stem.rpartition(".")[2] in tokens:
                leftover.unlink(missing_ok=True)


def write_text(path: Path, text: str, /) -> None:
    r"""Write a text as UTF-8, whole or not at all. Line ends are the same on every system.

    Bytes of file names that are not UTF-8 are written as their numbers, such as `\udcff`.
    """
    content = memoryview(text.encode(errors="backslashreplace"))
    partial = PartialFile(path)
    partial.parts = [content]
    partial.commit()


def write_json(path: Path, document: Mapping[str, Any], /) -> None:
    """Write a JSON document, indented, whole or not at all."""
    write_text(path, json.dumps(document, indent=2, default=str) + "\n")


def make_folder(path: Path, /) -> None:
    """Create a folder and its parents if they do not exist, and make sure that files can be written into it."""
    probe = path / f".cadtof.{os.urandom(8).hex()}{PARTIAL_SUFFIX}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        try:
            os.close(os.open(probe, CREATE_FLAGS))
        finally:
            # in this block, a signal that comes while the file is created leaves none
            probe.unlink(missing_ok=True)
    except OSError as error:
        found = "found a file, " if isinstance(error, FileExistsError) else ""
        why = "" if found else f": {error.strerror}"
        raise OutputError(f"{path}: {found}expected a folder that can be written into{why}") from error


def require_new(path: Path, /, *, overwrite: bool) -> None:
    """Raise OutputError, before any work is done, if `path` exists and `overwrite` is not set, or if its name is too long."""
    try:
        os.lstat(path)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise not_written(path, error) from error
        return
    if not overwrite:
        raise OutputError(f"{path}: already exists; add --overwrite to replace it, or choose another place")


def require_absent(path: Path, /) -> None:
    """Raise OutputError if `path` is a file, or a folder that is not empty."""
    if path.is_dir() and not any(path.iterdir()):
        return
    if path.exists() or path.is_symlink():
        kind = "a folder with files" if path.is_dir() else "a file"
        raise OutputError(f"{path}: found {kind}, expected nothing there; choose another name, or remove it")


@contextmanager
def new_folder(path: Path, /) -> Iterator[Path]:
    """Yield a temporary folder beside `path`, which is absent or an empty folder, and rename it to `path` on success."""
    require_absent(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name[:40]}.{os.urandom(16).hex()}{PARTIAL_SUFFIX}")
        partial.mkdir()
    except OSError as error:
        raise OutputError(f"{path}: cannot be created: {error.strerror}; choose another name") from error
    try:
        yield partial
        with suppress(FileNotFoundError):
            # some systems cannot replace an empty folder
            path.rmdir()
        partial.replace(path)
    except OutputError as error:
        # the message is to name the folder that the user asked for, not the temporary one
        raise type(error)(str(error).replace(str(partial), str(path))) from error
    except OSError as error:
        raise not_written(path, error) from error
    finally:
        import shutil

        shutil.rmtree(partial, ignore_errors=True)
