"""Finds the `capture.toml` of a folder, reads it into metadata with the origin of each value, and writes it."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cadtof_cli.capture.checks import MOST_LETTERS, InvalidValueError, converted, shown
from cadtof_cli.capture.metadata import KEYS, TABLES, CaptureMetadata
from cadtof_cli.errors import CaptureError, MetadataError
from cadtof_cli.files.reading import absolute
from cadtof_cli.files.toml import read_toml, toml_from_tables
from cadtof_cli.records import dataclass
from cadtof_cli.units import shortened

FILE_NAME = "capture.toml"

_MISNAMED = (
    "Capture.toml",
    "CAPTURE.TOML",
    "capture.TOML",
    "capture.toml.txt",
    "Capture.toml.txt",
    "capture.toml.toml",
)
"""Wrong names that editors and other systems give to `capture.toml`."""

DEFAULT_ORIGIN = "default"
"""Origin of a key whose value neither a file nor an option gave."""


@dataclass(frozen=True)
class MetadataSource:
    """Metadata, and the origin of every value.

    Attributes:
        metadata: the metadata of a capture.
        origins: the origin of every value by dotted key: the path of a file, the option that set it, or `default`.
        file: the file that was read; None: no file.
    """

    metadata: CaptureMetadata
    origins: Mapping[str, str]
    file: Path | None = None

    def defaults_in_words(self) -> str:
        """Return in words which values are the paper's, because neither a file nor an option gave them; empty: none."""
        defaults = {path: KEYS[path].default for path, origin in self.origins.items() if origin == DEFAULT_ORIGIN}
        told = ", ".join(f"{path} = {shown(default)}" for path, default in defaults.items() if default is not None)
        return f"not given, so taken from the paper: {told}" if told else ""


def nearest_settings(folder: Path, /) -> Path | None:
    """Return the `capture.toml` of a folder: the one in it, or else in the nearest folder above; None: there is none.

    A `capture.toml` under a wrong name would be ignored, so it raises a CaptureError.
    """
    for place in (folder, *absolute(folder).parents):
        # a file in a folder without permission counts as missing; a broken link counts as present, and reading it fails
        if os.path.lexists(place / FILE_NAME):
            return place / FILE_NAME
        for name in _MISNAMED:
            if os.path.lexists(place / name):
                raise CaptureError(
                    f"{place / name}: found settings under this name, expected {FILE_NAME}: rename it, or give --settings"
                )
    return None


def load_metadata(path: Path | None, overrides: Mapping[str, Any] | None = None) -> MetadataSource:
    """Read a `capture.toml` (None: no file) and replace values in it by `overrides`, which has dotted keys.

    Raises:
        MetadataError: the file cannot be read or parsed, or a table, key, type or value is not allowed.
    """
    given = [(dotted, value, str(path)) for dotted, value in _flat(read_toml(path), path).items()] if path else []
    given += [(dotted, value, KEYS[dotted].option) for dotted, value in (overrides or {}).items() if value is not None]
    tables: dict[str, dict[str, Any]] = {table: {} for table in TABLES}
    origins = dict.fromkeys(KEYS, DEFAULT_ORIGIN)
    for dotted, value, origin in given:
        key = KEYS[dotted]
        try:
            tables[key.table][key.name] = converted(key.kind, value)
        except TypeError as error:
            raise InvalidValueError(dotted, value, str(error), origin) from None
        origins[dotted] = origin
    try:
        metadata = CaptureMetadata(**{table: record(**tables[table]) for table, record in TABLES.items()})
    except InvalidValueError as error:
        raise InvalidValueError(error.key, error.found, error.expected, origins[error.key]) from None
    return MetadataSource(metadata, origins, path)


def _flat(document: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return the values of a document by dotted key; refuse tables and keys that are not in the registry."""
    flat: dict[str, Any] = {}
    for table, content in document.items():
        if table not in TABLES:
            raise MetadataError(_unknown(f"{path}: unknown table [{table}]", table, list(TABLES)))
        if not isinstance(content, dict):
            raise MetadataError(
                f"{path}: {table}: found {shortened(repr(content), MOST_LETTERS)}, expected a table [{table}]"
            )
        # the key dtype in [layout.raw] is the key raw_dtype of [layout]
        raw = content.get("raw") if table == "layout" else None
        within = {name: value for name, value in content.items() if raw is None or name != "raw"}
        if raw is not None and not isinstance(raw, dict):
            raise InvalidValueError("layout.raw", raw, "a table [layout.raw]", str(path))
        flat |= _known(within, table, f"{table}.", path) | _known(raw or {}, "layout.raw", "layout.raw_", path)
    return flat


def _known(content: dict[str, Any], table: str, start: str, path: Path) -> dict[str, Any]:
    """Return the values of a table by dotted key, which is `start` and the name; refuse keys that are not in the registry."""
    names = [dotted.removeprefix(start) for dotted in KEYS if dotted.startswith(start)]
    for name in content:
        if name not in names:
            raise MetadataError(_unknown(f"{path}: unknown key {table}.{name}", name, names))
    return {f"{start}{name}": value for name, value in content.items()}


def _unknown(what: str, name: str, known: list[str]) -> str:
    import difflib

    close = difflib.get_close_matches(name, known, n=1)
    return f"{what}; {f'did you mean {close[0]}? ' if close else ''}allowed: {', '.join(known)}"


def toml_text(metadata: CaptureMetadata, *, comments: tuple[str, ...] = ()) -> str:
    """Return the text of a `capture.toml` with comment lines at the top; keys without a value are left out."""
    tables: dict[str, dict[str, Any]] = {}
    for key in KEYS.values():
        value = key.value_in(metadata)
        if value is not None:
            tables.setdefault(key.table, {})[key.name] = dict(value) if key.kind == "numbers by name" else value
    return toml_from_tables(tables, comments=comments)
