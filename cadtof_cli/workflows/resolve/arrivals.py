"""Frames whose paths arrive while a run goes on, such as from a program that watches the folder of a camera."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

from cadtof_cli.capture.discovery import absolute, find_placed_captures
from cadtof_cli.capture.frames import Capture
from cadtof_cli.errors import CadtofError, OutputError
from cadtof_cli.files.reading import is_folder
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.frame_report import FrameReport
from cadtof_cli.workflows.resolve.plans import AppliedCalibration, CapturePlan, plan_captures
from cadtof_cli.workflows.resolve.settings import ResolveSettings


@dataclass
class Arrivals:
    """The captures of a run whose frames are not all known beforehand.

    Attributes:
        settings: of the run.
        overrides: metadata by dotted key that goes before any `capture.toml`.
        calibration: what is applied.
        base: folder whose tree OUT mirrors.
        on_failure: told of what cannot be resolved; the run goes on.
        waiting: files of frames that are not there as a whole.
        known: captures that have been met, by their folder.
        sources: what each map is made from, by its name.
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
        """Remember captures and what their frames are called."""
        for one in plans:
            self.known.setdefault(one.capture.root, one)
            self.sources.update((frame.name, frame.paths[0]) for frame in one.capture.frames)

    def plans(self, batches: Iterable[tuple[Path, ...]], /) -> Iterator[list[CapturePlan]]:
        """Yield what to do with each batch of paths; a frame of several files waits for all of them."""
        for paths in batches:
            yield self._planned(paths)
        while self.waiting:
            # nothing more will come: each fails or not, by what is there
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
        """Return the plans of captures, those met before as they were made then."""
        new = plan_captures([one for one in captures if one.root not in self.known], self.settings, self.calibration)
        plans = [
            replace(
                self.known[one.root],
                capture=replace(self.known[one.root].capture, frames=one.frames),
                stack_frame_bytes=None,
            )
            for one in captures
            if one.root in self.known
        ] + new
        for frame in (frame for one in plans for frame in one.capture.frames):
            other = self.sources.get(frame.name, frame.paths[0])
            if other != frame.paths[0]:
                raise OutputError(
                    f"{frame.paths[0]} would be written as {self.settings.out}/{frame.name}, as {other} was"
                )
        self.meet(plans)
        return plans


def without_incomplete_frames(
    captures: Sequence[Capture], paths: Iterable[Path], settings: ResolveSettings, /
) -> tuple[tuple[Capture, ...], list[Path]]:
    """Return captures without the frames that have to wait, and the files that do.

    A frame of several files waits until all of them are named, and frames that are averaged until there are enough. Captures
    that were named as folders are whole.
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
    """Return paths by the folder that they lie in; a folder by itself."""
    folders: dict[Path, list[Path]] = {}
    for path in dict.fromkeys(paths):
        folders.setdefault(path if is_folder(path) else path.parent, []).append(path)
    return folders
