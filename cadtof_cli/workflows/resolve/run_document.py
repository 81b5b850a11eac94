"""The content of `run.json` as a run writes it: when the run begins, and when frames arrive during the run."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cadtof_cli.capture.frames import FrameSource
from cadtof_cli.execution.workers import LOCAL
from cadtof_cli.files.reading import real_path
from cadtof_cli.files.system import path_from
from cadtof_cli.resolver.kernels import chosen_kernel
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.version import __version__
from cadtof_cli.workflows.resolve.plans import AppliedCalibration, CapturePlan
from cadtof_cli.workflows.resolve.run_json import RunRecord
from cadtof_cli.workflows.resolve.settings import ResolveSettings


class RunDocument(RunRecord):
    """The content of the `run.json` of a run in progress, which may grow."""

    def add_captures(self, plans: Iterable[CapturePlan], counted: Collection[str] = (), /) -> None:
        """Add captures; of a capture that is there already, only the number of files grows.

        Frames are not counted again if their first file is among those that an earlier run has `counted`.
        """
        by_root = {entry["root"]: entry for entry in self["captures"]}
        for one in plans:
            capture = one.capture
            known = by_root.get(str(capture.root))
            if known is None:
                known = by_root[str(capture.root)] = {
                    "root": str(capture.root),
                    "resolved_root": real_path(capture.root),
                    "files": 0,
                    "metadata": asdict(capture.source.metadata),
                    "origins": dict(capture.source.origins),
                    "lossy_compression": capture.lossy_compression,
                }
                self["captures"].append(known)
            known["files"] += _new_frames(capture.frames, counted)

    def add_inputs(self, paths: Iterable[Path], known: set[str], /) -> None:
        """Add paths to the inputs, each path once; `known` are the inputs there, links resolved."""
        for path in paths:
            if (real := real_path(path)) not in known:
                known.add(real)
                for name, values in _input_arguments([path], self.out).items():
                    self["arguments"][name].extend(values)

    def continue_from(self, earlier: RunRecord, plans: Iterable[CapturePlan], /) -> frozenset[str]:
        """Put the inputs and captures of the run that is continued before those of this run.

        Paths of a run that was started in another folder become absolute. Return the inputs of that run, with links resolved.
        """
        then, now = earlier["arguments"], self["arguments"]
        known = frozenset[str](then["resolved_inputs"])
        is_here = [str(Path(typed).absolute()) for typed in then["inputs"]] == then["absolute_inputs"]
        new = [place for place, real in enumerate(now["resolved_inputs"]) if real not in known]
        for name in _input_arguments((), Path()):
            before = then["absolute_inputs"] if name == "inputs" and not is_here else then[name]
            now[name] = [*before, *(now[name][place] for place in new)]
        captures = {one["resolved_root"]: one for one in earlier["captures"]}
        if not is_here:
            folders = zip(earlier["captures"], earlier.capture_folders(), strict=True)
            captures = {one["resolved_root"]: {**one, "root": str(folder)} for one, folder in folders}
        for one, plan in zip(self["captures"], plans, strict=True):
            before = captures.get(one["resolved_root"], {"files": 0})
            one["files"] = max(before["files"] + _new_frames(plan.capture.frames, known), one["files"])
            captures[one["resolved_root"]] = one
        self["captures"][:] = captures.values()
        return known


def run_document(
    inputs: Sequence[Path],
    settings: ResolveSettings,
    plans: Sequence[CapturePlan],
    calibration: AppliedCalibration | None,
    shared_folder: Path,
) -> RunDocument:
    """Return the content of `run.json` when a run begins. The arguments in it have the names of the options.

    `shared_folder` is the folder whose tree the run's folder mirrors.
    """
    maps, applied = settings.maps, None
    if calibration is not None:
        folder = calibration.use.folder
        applied = {
            "folder": str(folder),
            "digest": calibration.use.digest,
            "applied": dict(calibration.parts),
            "absolute_folder": str(folder.absolute()),
            "folder_from_out": path_from(settings.out, folder),
        }
    document = RunDocument(
        {
            "cadtof": __version__,
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "finished": False,
            # the workers of a scheduler choose their own
            "kernel": chosen_kernel() if settings.workers.scheduler == LOCAL else None,
            "arguments": {
                **_input_arguments(inputs, settings.out),
                "out": settings.out.as_posix(),
                **asdict(maps.resolver),
                "min_confidence": maps.min_confidence_v,
                # every setting must be here, because --resume compares them
                **{
                    one: value
                    for one, value in vars(maps).items()
                    if one not in {"resolver", "min_confidence_v", "roi"}
                },
                "calibration": settings.calibration and str(settings.calibration),
                "map_format": settings.map_format,
                "roi": maps.roi,
                "recursive": settings.recursive,
                "settings": settings.settings_file and str(settings.settings_file.absolute()),
                "frames": settings.frames and [settings.frames.start, settings.frames.stop],
                "overrides": dict(settings.overrides),
            },
            "shared_folder": str(shared_folder),
            "captures": list[dict[str, Any]](),
            "calibration": applied,
            "layers": {name: unit for one in plans for name, unit in one.plan.header.units.items()},
            "status_bits": {bit.name: int(bit) for bit in StatusBit},
        }
    )
    document.add_captures(plans)
    return document


def _input_arguments(inputs: Sequence[Path], out: Path) -> dict[str, list[str]]:
    """Return the arguments in `run.json` that name inputs: as typed, absolute, from the run's folder, and with links resolved."""
    return {
        "inputs": [str(path) for path in inputs],
        "absolute_inputs": [str(path.absolute()) for path in inputs],
        "inputs_from_out": [path_from(out, path) for path in inputs],
        "resolved_inputs": [real_path(path) for path in inputs],
    }


def _new_frames(frames: Sequence[FrameSource], counted: Collection[str]) -> int:
    """Return how many frames have a first file that is none of the files in `counted`, whose links are resolved."""
    return sum(real_path(frame.paths[0]) not in counted for frame in frames) if counted else len(frames)
