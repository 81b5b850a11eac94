"""Which pictures can be written, by how their names end."""

from collections.abc import Collection
from pathlib import Path

from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import require_new

KINDS = {".png": "png", ".pdf": "pdf", ".svg": "svg", ".jpg": "jpg", ".jpeg": "jpg"}


def require_picture(path: Path, /, *, overwrite: bool, more: Collection[str] = ()) -> str:
    """Return the kind of picture that a file's name asks for; `more` are endings that the message names besides.

    Raises:
        OutputError: it asks for none that we write, or the file is there and may not be replaced.
    """
    kind = KINDS.get(path.suffix.lower())
    if kind is None:
        raise OutputError(f"{path}: found the suffix {path.suffix!r}, expected one of {', '.join((*KINDS, *more))}")
    require_new(path, overwrite=overwrite)
    return kind
