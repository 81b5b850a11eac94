"""The kinds of pictures that can be written; the ending of a file's name selects one."""

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import atomic_write, require_new

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = {".png": "png", ".pdf": "pdf", ".svg": "svg", ".jpg": "jpg", ".jpeg": "jpg"}


def require_picture(path: Path, /, *, overwrite: bool, more: Collection[str] = ()) -> None:
    """Raise OutputError if the name asks for another kind of picture, or the file exists and may not be replaced.

    `more`: other endings that the error message names.
    """
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{path}: found the suffix {path.suffix!r}, expected one of {', '.join((*KINDS, *more))}")
    require_new(path, overwrite=overwrite)


def save(figure: "Figure", path: Path, /, *, dpi: int) -> None:
    """Write a figure as the kind of picture that the file's name asks for, whole; raises OutputError if that is impossible."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=KINDS[path.suffix.lower()])
