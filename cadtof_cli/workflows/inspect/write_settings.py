"""A `capture.toml` to be completed by hand, with the values that are known of a capture and those that its files suggest."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from cadtof_cli.capture.metadata import KEYS, Key
from cadtof_cli.capture.toml import DEFAULT_ORIGIN, FILE_NAME
from cadtof_cli.files.atomic import require_new, write_text
from cadtof_cli.files.toml import toml_value
from cadtof_cli.units import counted
from cadtof_cli.workflows.inspect.capture_facts import CaptureFacts

_EXAMPLES: Mapping[str, Any] = {
    "pixel.integration_length": 100000.0,
    "voltage.zero_counts": 8192.0,
    "voltage.volts_per_count": 6.0e-5,
    "voltage.saturated_counts": (0, 16383),
    "optics.focal_length_px": 280.0,
    "optics.principal_point_px": (159.5, 119.5),
    "optics.lamp_offset_m": (0.03, 0.0, 0.0),
    "target.distance_m": 3.35,
    "layout.pattern": "{frame}_h{harmonic}_sc{channel}.tif",
    "layout.channel": ("A", "B"),
    "layout.harmonic": {"25": 1, "50": 2},
    "layout.frames": 100,
    "layout.raw_dtype": "uint16",
    "layout.raw_shape": (2, 2, 240, 320),
    "layout.raw_offset_bytes": 0,
}
"""Examples of values for keys that have none."""

_BITS = (8, 10, 12, 14, 16)


def write_settings(facts: CaptureFacts, /, *, out: Path | None, overwrite: bool) -> Path:
    """Write a commented `capture.toml` with the values that are known or suggested by the files, and return its path.

    If `out` is None, it is written into the capture's folder. Raises OutputError if the file exists and may not be replaced.
    """
    path = out or Path(facts.root) / FILE_NAME
    require_new(path, overwrite=overwrite)
    write_text(path, "\n".join(_lines(facts)) + "\n")
    return path


def _lines(facts: CaptureFacts) -> Iterator[str]:
    kinds = ", ".join((*facts.containers, *facts.types)) or "none could be read"
    size = f", {facts.shape[3]} × {facts.shape[2]} pixels" if facts.shape else ""
    yield f"# Written by `cadtof info --write-settings` after a look at {counted(facts.frames, 'frame')} ({kinds}{size})."
    yield "# Lines that begin with # have no effect: complete those that you know, and remove their #."
    seen, table = _seen(facts), ""
    for key in KEYS.values():
        if table != (table := _place(key)[0]):
            yield f"\n[{table}]"
        entry = facts.metadata[key.path]
        yield _line(key, entry["value"], entry["from"], seen.get(key.path))


def _place(key: Key) -> tuple[str, str]:
    """Return the table of a key and its name there. The keys of raw dumps have a table of their own."""
    name = key.name.removeprefix("raw_")
    return (key.table, name) if name == key.name else (f"{key.table}.raw", name)


def _line(key: Key, value: Any, origin: str, seen: tuple[Any, str] | None) -> str:
    """Return a key and its value in a single line, which is commented out if the value is only a guess."""
    sure, why = True, ""
    if origin == DEFAULT_ORIGIN and seen is not None:
        sure, value, why = key.table == "layout", seen[0], f"; {seen[1]}"
    elif origin == DEFAULT_ORIGIN and key.default is not None:
        sure, value, why = False, key.default, "; the value of the paper, used by default"
    elif origin == DEFAULT_ORIGIN:
        sure, value, why = False, _EXAMPLES[key.path], "; an example"
    shown = toml_value(dict(value) if key.kind == "numbers by name" else value)
    in_one = " ".join(shown.split()).replace("[ ", "[").replace(", ]", "]")
    return f"{'' if sure else '# '}{_place(key)[1]} = {in_one}  # {key.about}{why}"


def _seen(facts: CaptureFacts) -> dict[str, tuple[Any, str]]:
    """Return the values that the files suggest, by dotted key, each with the reason."""
    seen: dict[str, tuple[Any, str]] = {}
    if facts.integration_length_seen is not None:
        length = float(f"{facts.integration_length_seen:.2g}")
        seen["pixel.integration_length"] = length, "the scatter between neighbouring pixels suggests this, or more"
    if facts.planes and all(name.startswith("u") for name in facts.types):
        low = min(low for low, _ in facts.planes.values())
        high = max(high for _, high in facts.planes.values())
        full = next(2**bits - 1 for bits in _BITS if high < 2**bits or bits == _BITS[-1])
        range_seen = f"stored values are {low:g} … {high:g}"
        seen["voltage.saturated_counts"] = (0, full), range_seen
        seen["voltage.zero_counts"] = (full + 1) // 2, f"{range_seen}; the middle, to be checked"
    layout = facts.guessed_layout
    for name in ("pattern", "channel", "harmonic"):
        if layout is not None and getattr(layout, name) is not None:
            seen[f"layout.{name}"] = getattr(layout, name), "as the names of the files suggest"
    return seen
