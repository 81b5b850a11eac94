"""Frames whose paths arrive during a run, such as from a program that watches the folder of a camera."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

from cadtof_cli.capture.discovery import absolute, find_placed_captures
from cadtof_cli.capture.frames import Capture
from cadtof_cli.errors import CadtofError, OutputError
from cadtof_cli.files.reading import is_folder, real_path
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.plans import AppliedCalibration, CapturePlan, plan_captures
from cadtof_cli.workflows.resolve.record import FrameReport
from cadtof_cli.workflows.resolve.settings import ResolveSettings


@dataclass
class Arrivals:
    """The captures of a run that does not know all of its frames beforehand.

    Attributes:
        settings: settings of the run.
        overrides: metadata by dotted key, which replace those of any `capture.toml`.
        calibration: the calibration that is applied; None: none.
        base: folder whose tree OUT mirrors.
        on_failure: called with a report on inputs that cannot be resolved; the run continues.
        waiting: files of frames that wait for more files.
        known: plans of the captures that have come so far, by the folder of the capture.
        sources: first recorded file of each map, by the name of the map.
    """

    settings: ResolveSettings
    overrides: Mapping[str, Any]
    calibration: AppliedCalibration | None
    base: Path
    on_failure: Callable[[FrameReport], None]
    waiting: list[Path] = field(default_factory=list)
    known: dict[Path, CapturePlan] = field(default_factory=dict)
    sources: dict[str, Path] = field(default_factory=dict)

    def meet(self, plans: Iterable[CapturePlan], /) -> None:
        """Remember captures and the names of their frames."""
        for one in plans:
            self.known.setdefault(one.capture.root, one)
            self.sources.update((frame.name, frame.paths[0]) for frame in one.capture.frames)

    def plans(self, batches: Iterable[tuple[Path, ...]], /) -> Iterator[list[CapturePlan]]:
        """Yield the plans for each batch of paths. A frame of several files waits for all of its files."""
        for paths in batches:
            yield self._planned(paths)
        while self.waiting:
            # no more files will come: each frame is tried with the files that are there
            self.waiting, left = [], self.waiting
            yield self._planned(left, last=True)

    def _planned(self, paths: Iterable[Path], *, last: bool = False) -> list[CapturePlan]:
        paths, self.waiting = [*self.waiting, *paths], []
        found: list[CapturePlan] = []
        for folder, named in _by_folder(paths).items():
            try:
                captures, _ = find_placed_captures(
                    named,
                    overrides=self.overrides,
                    settings_file=self.settings.settings_file,
                    recursive=self.settings.recursive,
                    base=self.base,
                )
                if not last:
                    captures, waiting = without_incomplete_frames(captures, named, self.settings)
                    self.waiting += waiting
                found += self._known(captures)
            except CadtofError as error:
                self.on_failure(
                    FrameReport(str(folder if len(named) > 1 else named[0]), None, "failed", str(error), 0.0)
                )
        return found

    def _known(self, captures: Sequence[Capture]) -> list[CapturePlan]:
        """Return the plans of captures; a capture that has come before keeps its plan."""
        new = plan_captures([one for one in captures if one.root not in self.known], self.settings, self.calibration)
        plans = [
            replace(known, capture=replace(known.capture, frames=one.frames), stack_frame_bytes=None)
            for one in captures
            if (known := self.known.get(one.root))
        ] + new
        for frame in (frame for one in plans for frame in one.capture.frames):
            other = self.sources.get(frame.name, frame.paths[0])
            if other != frame.paths[0]:
                raise OutputError(
                    f"{frame.paths[0]} would be written as {self.settings.out}/{frame.name}, as {other} was"
                )
        self.meet(plans)
        return plans


def recorded_arrivals(
    batches: Iterable[tuple[Path, ...]], document: Mapping[str, Any], out: Path
) -> Iterator[tuple[Path, ...]]:
    """Yield the batches of paths, after adding each batch to the inputs that `run.json` will name."""
    for paths in batches:
        document["arguments"]["inputs"] += map(str, paths)
        document["arguments"]["absolute_inputs"] += (str(path.absolute()) for path in paths)
        document["arguments"]["inputs_from_out"] += (os.path.relpath(path, out) for path in paths)
        document["arguments"]["resolved_inputs"] += map(real_path, paths)
        yield paths


def without_incomplete_frames(
    captures: Sequence[Capture], paths: Iterable[Path], settings: ResolveSettings, /
) -> tuple[tuple[Capture, ...], list[Path]]:
    """Return captures without the frames that have to wait, and the files of the frames that wait.

    A frame of several files waits until all of them are named. Frames that are averaged wait until there are enough of them.
    A capture that was named as a folder is complete.
    """
    given, waiting, whole = set(map(absolute, paths)), [], []
    for capture in captures:
        files = {absolute(path) for frame in capture.frames for path in frame.paths} & given
        frames = capture.frames
        if files:
            frames = tuple(one for one in frames if len(one.paths) == 1 or given.issuperset(map(absolute, one.paths)))
            frames = frames[: len(frames) - len(frames) % settings.maps.average]
            waiting += sorted(files.difference(absolute(path) for frame in frames for path in frame.paths))
        if frames:
            whole.append(replace(capture, frames=frames))
    return tuple(whole), waiting


def _by_folder(paths: Iterable[Path]) -> dict[Path, list[Path]]:
    """Return paths by the folder that they lie in; a path that is a folder counts as lying in itself."""
    folders: dict[Path, list[Path]] = {}
    for path in dict.fromkeys(paths):
        folders.setdefault(path if is_folder(path) else path.parent, []).append(path)
    return folders
