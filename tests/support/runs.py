"""Records of runs as strangers read them, without what tells the time."""

import json
from pathlib import Path
from typing import Any


def maps_of(out: Path) -> dict[str, bytes]:
    """Every map of a run's folder."""
    return {path.name: path.read_bytes() for path in out.iterdir() if path.suffix in {".tif", ".exr"}}


def lines_of(out: Path) -> list[dict[str, Any]]:
    """The lines of `frames.jsonl`, without seconds, and with maps by their names."""
    lines = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
    return [{**line, "seconds": None, "output": line["output"] and Path(line["output"]).name} for line in lines]


def run_of(out: Path) -> dict[str, Any]:
    """What `run.json` says, without when it was, and where to."""
    record: dict[str, Any] = json.loads((out / "run.json").read_text())
    del record["started"], record["arguments"]["out"]
    if "totals" in record:
        del record["totals"]["seconds"]
    return record


def require_same_run(out: Path, undisturbed: Path) -> None:
    """Make sure that two folders hold the same maps and the same records, but for times, and nothing else."""
    assert maps_of(out) == maps_of(undisturbed)
    assert lines_of(out) == lines_of(undisturbed)
    assert run_of(out) == run_of(undisturbed)
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in undisturbed.iterdir())
