"""What a folder holds, by names alone."""

import os
from collections.abc import Callable
from pathlib import Path

from cadtof_cli.errors import CaptureError
from cadtof_cli.files.reading import is_folder


class UnlistedError(CaptureError):
    """A folder that the system does not list, so nobody knows whether it holds frames."""


OnUnlisted = Callable[[Path, UnlistedError], None]
"""Called with each folder of a tree that cannot be listed; the search goes on with the other folders."""


def fail(_folder: Path, error: UnlistedError, /) -> None:
    """End the search at a folder that cannot be listed."""
    raise error


def entries_of(folder: Path, pattern: str | None = None, /) -> list[tuple[str, bool]]:
    """Return the entries of a folder: their paths relative to the folder, with slashes, and whether each is a folder.

    If the pattern of planes contains slashes, the entries are those of the folders that many levels below.
    A folder that cannot be listed raises an UnlistedError.
    """
    found, above = list[tuple[str, bool]](), [""]
    for _ in (pattern or "").split("/"):
        found = []
        for below in above:
            here = folder / below
            try:
                with os.scandir(here) as entries:
                    found += [
                        # a link in a loop is listed as a file; reading it raises the error
                        (
                            below + entry.name,
                            entry.is_dir(follow_symlinks=False) or (entry.is_symlink() and is_folder(Path(entry))),
                        )
                        for entry in entries
                    ]
            except PermissionError as error:
                raise UnlistedError(
                    f"{here}: no permission to list this folder; expected one that can be read"
                ) from error
            except OSError as error:
                raise UnlistedError(f"{here}: cannot be listed: {error.strerror}") from error
        above = [f"{name}/" for name, is_dir in found if is_dir and not name.rpartition("/")[2].startswith(".")]
    return found
