"""Which pictures can be written, by how their names end."""

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import atomic_write, require_new

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = {".png": "png", ".pdf": "pdf", ".svg": "svg", ".jpg": "jpg", ".jpeg": "jpg"}


def require_picture(path: Path, /, *, overwrite: bool, more: Collection[str] = ()) -> None:
    """Make sure that a file's name asks for a kind of picture that we write; `more` are endings that the message names besides.

    Raises:
        OutputError: it asks for another, or the file is there and may not be replaced.
    """
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{path}: found the suffix {path.suffix!r}, expected one of {', '.join((*KINDS, *more))}")
    require_new(path, overwrite=overwrite)


def save(figure: "Figure", path: Path, /, *, dpi: int) -> None:
    """Write a figure as the kind of picture that the file's name asks for, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=KINDS[path.suffix.lower()])
