"""Maps and records of runs, read without the package and without their times."""

import json
from pathlib import Path
from typing import Any


def maps_of(out: Path) -> dict[str, bytes]:
    """Every map of a run's folder."""
    return {path.name: path.read_bytes() for path in out.iterdir() if path.suffix in {".tif", ".exr"}}


def lines_of(out: Path) -> list[dict[str, Any]]:
    """The lines of `frames.jsonl`, without seconds, and with the names of maps in place of their paths."""
    lines = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
    return [{**line, "seconds": None, "output": line["output"] and Path(line["output"]).name} for line in lines]


def run_of(out: Path) -> dict[str, Any]:
    """The content of `run.json`, without times and without the folder of the run."""
    record: dict[str, Any] = json.loads((out / "run.json").read_text())
    del record["started"], record["arguments"]["out"]
    if "totals" in record:
        del record["totals"]["seconds"]
    return record


def require_same_run(out: Path, undisturbed: Path) -> None:
    """Require that two folders hold the same files: the same maps, and the same records except for times."""
    assert maps_of(out) == maps_of(undisturbed)
    assert lines_of(out) == lines_of(undisturbed)
    assert run_of(out) == run_of(undisturbed)
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in undisturbed.iterdir())
