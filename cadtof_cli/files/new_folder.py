"""A folder that appears whole or not at all, and never on top of another."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cadtof_cli.errors import OutputError


def require_absent(path: Path) -> None:
    """Raise OutputError where something stands already; an empty folder is as good as none."""
    if path.is_dir() and not any(path.iterdir()):
        return
    if path.exists() or path.is_symlink():
        kind = "a folder with files" if path.is_dir() else "a file"
        raise OutputError(f"{path}: found {kind}, expected nothing there; choose another OUT or remove it")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Give a temporary folder beside `path` to write to, and rename it to `path` if all went well.

    Raises:
        OutputError: something is there already, or the place cannot be written.
    """
    require_absent(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent))
    except OSError as error:
        raise OutputError(f"{path}: cannot be created: {error.strerror}; choose another OUT") from error
    try:
        partial.chmod(0o777 & ~_umask())
        yield partial
        partial.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
