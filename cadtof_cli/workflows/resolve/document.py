"""What `run.json` says of a run that begins, and of what arrives while it goes on."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cadtof_cli import __version__
from cadtof_cli.capture.discovery import Capture
from cadtof_cli.files.reading import real_path
from cadtof_cli.resolver.status import MEANING
from cadtof_cli.resolver.two_path.kernel import chosen_kernel
from cadtof_cli.workflows.resolve.plans import CapturePlan
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from cadtof_cli.workflows.resolve.use_calibration import AppliedCalibration


def recorded_arrivals(
    batches: Iterable[tuple[Path, ...]], document: Mapping[str, Any], out: Path
) -> Iterator[tuple[Path, ...]]:
    """Yield the batches of paths, each added to the inputs that `run.json` will name."""
    for paths in batches:
        document["arguments"]["inputs"] += map(str, paths)
        document["arguments"]["absolute_inputs"] += (str(path.absolute()) for path in paths)
        document["arguments"]["inputs_from_out"] += (_from_out(path, out) for path in paths)
        document["arguments"]["resolved_inputs"] += map(real_path, paths)
        yield paths


def _from_out(path: Path, out: Path) -> str:
    """Return an input as it is seen from the run's folder: true after both have been moved."""
    return os.path.relpath(path.absolute(), out.absolute())


def record_captures(document: Mapping[str, Any], plans: Iterable[CapturePlan]) -> None:
    """Add captures, or their further files, to those that `run.json` names."""
    for capture in (one.capture for one in plans):
        known = next((one for one in document["captures"] if one["root"] == str(capture.root)), None)
        if known is None:
            document["captures"].append(_as_json(capture))
        else:
            known["files"] += len(capture.frames)


def _as_json(capture: Capture) -> dict[str, Any]:
    return {
        "root": str(capture.root),
        "resolved_root": real_path(capture.root),
        "files": len(capture.frames),
        "metadata": asdict(capture.source.metadata),
        "origins": dict(capture.source.origins),
    }


def _of_calibration(calibration: AppliedCalibration, out: Path) -> dict[str, Any]:
    folder = calibration.use.folder
    return calibration.as_json() | {
        "absolute_folder": str(folder.absolute()),
        "folder_from_out": _from_out(folder, out),
    }


def run_document(
    inputs: Sequence[Path],
    overrides: Mapping[str, Any],
    settings: ResolveSettings,
    plans: Sequence[CapturePlan],
    calibration: AppliedCalibration | None,
) -> dict[str, Any]:
    """Return what `run.json` says of a run that begins; its arguments have the names of the options."""
    maps = settings.maps
    return {
        "cadtof": __version__,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "finished": False,
        "kernel": chosen_kernel(),
        "arguments": {
            "inputs": [str(path) for path in inputs],
            "absolute_inputs": [str(path.absolute()) for path in inputs],
            "inputs_from_out": [_from_out(path, settings.out) for path in inputs],
            "resolved_inputs": [real_path(path) for path in inputs],
            "out": str(settings.out),
            **asdict(maps.resolver),
            "min_confidence": maps.min_confidence_v,
            "depth": maps.depth,
            "pool": maps.pool,
            "average": maps.average,
            "calibration": settings.calibration and str(settings.calibration),
            "map_format": settings.map_format,
            "roi": maps.roi,
            "recursive": settings.recursive,
            "settings": settings.settings_file and str(settings.settings_file.absolute()),
            "frames": settings.frames and [settings.frames.start, settings.frames.stop],
            "overrides": dict(overrides),
        },
        "captures": [_as_json(one.capture) for one in plans],
        "calibration": calibration and _of_calibration(calibration, settings.out),
        "layers": {layer.name: layer.unit for one in plans for layer in one.plan.layers},
        "status_bits": {bit.name: int(bit) for bit in MEANING},
    }
