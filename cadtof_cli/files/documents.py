"""Tables as CSV text, and values in a form that JSON can hold."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def csv_text(names: Iterable[str], rows: Iterable[Iterable[Any]], /, *, digits: int | None = None) -> str:
    """Return a table as CSV text. Numbers have `digits` significant digits (None: all); None and NaN become empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([_cell(value, digits) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: Any, digits: int | None) -> Any:
    if value is None or (not isinstance(value, str) and math.isnan(value)):
        return ""
    return value if digits is None or isinstance(value, str) else f"{value:.{digits}g}"


def write_rows(path: Path, names: Sequence[str], rows: Iterable[Iterable[float]], /) -> None:
    """Write a table of numbers as CSV, with seven significant digits each."""
    path.write_text(csv_text(names, rows, digits=7), encoding="utf-8", newline="")


def plain(value: Any, /) -> Any:
    """Return a value as JSON can hold it: numpy's numbers become Python's, numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value
