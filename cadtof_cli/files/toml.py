"""Reads and writes TOML: `capture.toml` and the parts of a calibration.

We have our own writer, because tomli-w puts every item of a list on a line of its own. A pair of numbers should stay on
one line.
"""

import json
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cadtof_cli.errors import MetadataError
from cadtof_cli.files.reading import read_text

_MOST_PARTS = 100
"""Limit on the parts of a key, which points separate: the time to parse a key grows with the square of their number. A key
of 60,000 bytes takes a minute."""

_AROUND_KEYS = r"[\n=,{}\[\]]"


def read_toml(path: Path, /) -> dict[str, Any]:
    """Return the document in a TOML file; raise MetadataError if it cannot be read, or is not TOML."""
    try:
        text = read_text(path, encoding="utf-8-sig")
        if any(piece.count(".") > _MOST_PARTS for piece in re.split(_AROUND_KEYS, text)):
            raise MetadataError(f"{path}: found a key of more than {_MOST_PARTS} parts, expected a settings file")
        document = tomllib.loads(text)
        # raises a ValueError for a hexadecimal number with thousands of digits, which no message could show
        repr(document)
        return document
    except OSError as error:
        raise MetadataError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise MetadataError(f"{path}: not UTF-8 text (byte {error.start})") from error
    except RecursionError as error:
        raise MetadataError(f"{path}: not valid TOML: tables or lists are nested hundreds of levels deep") from error
    except tomllib.TOMLDecodeError as error:
        raise MetadataError(f"{path}: not valid TOML: {error}") from error
    except ValueError as error:
        # other values that Python cannot hold raise a ValueError that is no TOMLDecodeError
        raise MetadataError(
            f"{path}: not valid TOML: a number with thousands of digits, or an impossible date"
        ) from error


def toml_from_tables(tables: Mapping[str, Mapping[str, Any]], /, *, comments: Iterable[str] = ()) -> str:
    """Return TOML text for tables of plain values and lists, with comment lines at the top."""
    blocks = ["\n".join(f"# {comment}" for comment in comments)]
    blocks += [
        "\n".join((f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in table.items())))
        for name, table in tables.items()
    ]
    return "\n\n".join(filter(None, blocks)) + "\n"


def toml_value(value: Any, /) -> str:
    """Return a value as TOML: a list of numbers on one line, a list of texts with one line for each."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_value(name)} = {toml_value(one)}" for name, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        if value and isinstance(value[0], str):
            return "[\n" + "".join(f"    {toml_value(item)},\n" for item in value) + "]"
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float) and not math.isfinite(value):
        return str(float(value))
    return repr(value.item() if hasattr(value, "item") else value)
