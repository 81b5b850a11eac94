"""`cadtof info`: what captures and map files hold, and what is wrong with them."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.calibration.store import is_calibration_folder
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture, lossy_compression, single_frames
from cadtof_cli.capture.metadata import KEYS, Layout
from cadtof_cli.capture.planes import hint_of_planes
from cadtof_cli.errors import CadtofError
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import WorkerDied
from cadtof_cli.execution.workers import Workers
from cadtof_cli.phasors.noise import ambient_noise_v
from cadtof_cli.phasors.voltages import volts_per_count
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.units import counted, unambiguous_range_m
from cadtof_cli.workflows.inspect.facts import (
    CalibrationFacts,
    FrameFacts,
    FrameLook,
    MapFacts,
    facts_of_calibration,
    facts_of_frame,
    facts_of_maps,
    is_map,
)
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.recording import FrameReader
from cadtof_cli.workflows.run_folder import is_run_folder

_LARGEST_RATIO = 2.0
"""Largest ratio between the integration lengths that frames show, up to which they may be the same. Scatter alone makes
1.2 in frames of 64 × 48 pixels, and less in larger ones."""


@dataclass
class CaptureFacts:
    """What a capture holds, gathered frame by frame. `problems` is empty if all of the capture can be resolved.

    `integration_length_seen` is that of the first frame, or the least one if `noise_changes`. `integration_lengths_seen`
    are the least and the largest one of all frames.
    """

    root: str
    frames: int = 0
    containers: dict[str, int] = field(default_factory=dict)
    types: dict[str, int] = field(default_factory=dict)
    shape: tuple[int, ...] | None = None
    planes: dict[str, tuple[float, float]] = field(default_factory=dict)
    saturated: float = 0.0
    not_finite: float = 0.0
    metadata: dict[str, dict[str, Any]] = field(default_factory=dict)
    unambiguous_range_m: float = 0.0
    noise_mv: float | None = None
    integration_length_seen: float | None = None
    integration_lengths_seen: tuple[float, float] | None = None
    lossy_compression: str | None = None
    guessed_layout: Layout | None = None
    not_frames: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    @property
    def noise_changes(self) -> bool:
        """Whether the noise of the frames differs too much for one integration length."""
        least, most = self.integration_lengths_seen or (1.0, 1.0)
        return most > _LARGEST_RATIO * least

    def add(self, facts: FrameFacts) -> None:
        """Count one more frame."""
        if facts.skipped:
            self.not_frames.append(str(facts.problem))
            return
        self.frames += 1
        if facts.problem is not None:
            self.problems.append(facts.problem)
            return
        self.containers[facts.container] = self.containers.get(facts.container, 0) + 1
        self.types[facts.dtype] = self.types.get(facts.dtype, 0) + 1
        self.shape = self.shape or facts.shape
        for name, (low, high) in facts.planes.items():
            before = self.planes.get(name, (math.inf, -math.inf))
            self.planes[name] = (min(before[0], low), max(before[1], high))
        good = self.frames - len(self.problems)
        self.saturated += (facts.saturated - self.saturated) / good
        self.not_finite += (facts.not_finite - self.not_finite) / good
        if math.isfinite(seen := facts.integration_length_seen):
            least, most = self.integration_lengths_seen or (seen, seen)
            self.integration_lengths_seen = min(least, seen), max(most, seen)
            if self.integration_length_seen is None or self.noise_changes:
                self.integration_length_seen = self.integration_lengths_seen[0] if self.noise_changes else seen


Facts = CaptureFacts | MapFacts | CalibrationFacts


def look_into(
    inputs: Sequence[Path],
    /,
    *,
    overrides: Mapping[str, Any],
    workers: Workers,
    progress: Progress,
    settings_file: Path | None,
    recursive: bool,
) -> list[Facts]:
    """Return what each input holds. All frames of captures are read, so that damaged ones are found.

    An input that does not exist or holds nothing to look into, or whose `capture.toml` is not allowed, has that as a problem.

    Raises:
        CadtofError: this is so for all inputs.
    """
    found: list[Facts] = []
    recorded: list[Path] = []
    for path in inputs:
        if is_calibration_folder(path):
            found.append(facts_of_calibration(path))
        elif is_run_folder(path) or is_map(path):
            found.append(facts_of_maps(path))
        else:
            recorded.append(path)
    unlisted: dict[Path, CadtofError] = {}
    search = partial(
        find_captures,
        overrides=overrides,
        settings_file=settings_file,
        recursive=recursive,
        on_unlisted=unlisted.__setitem__,
    )
    wrong: dict[Path, CadtofError] = {}
    try:
        captures = search(recorded)
    except CadtofError:
        wrong = {path: error for path in recorded if (error := _error_of(search, path))}
        sound = [path for path in recorded if path not in wrong]
        if not (sound and wrong) and not found:
            raise
        captures = search(sound)
    progress.advance(0, total=sum(len(capture.frames) for capture in captures))
    for facts in _facts_of_captures(captures, workers, progress):
        # a search through all folders below an input also finds pictures that are no frames
        if not (facts.frames or facts.problems or recursive):
            facts.problems.append(f"{facts.root}: no frames: none of its files holds the voltages of a frame")
        found.append(facts)
    found += [CaptureFacts(str(path), problems=[str(error)]) for path, error in (unlisted | wrong).items()]
    return found


def _error_of(search: Callable[[Sequence[Path]], Sequence[Capture]], path: Path) -> CadtofError | None:
    try:
        search([path])
    except CadtofError as error:
        return error
    return None


def _facts_of_captures(captures: Sequence[Capture], workers: Workers, progress: Progress) -> list[CaptureFacts]:
    """Return what each capture holds. The same processes read the frames of all captures: there may be thousands of captures."""
    found: list[CaptureFacts] = []
    implausible: dict[int, list[str]] = {}
    shared = [part for one in captures for part in (one.layout, one.source.metadata)]
    looks = _looks(captures, found, implausible)
    with closing(run_ordered(facts_of_frame, looks, workers=workers, shared=shared)) as outcomes:
        for outcome in outcomes:
            look, result = outcome.task, outcome.result
            if isinstance(result, WorkerDied):
                result = FrameFacts(problem=f"{look.source}: the process that read it died, twice")
            found[look.place].add(result)
            if result.implausible is not None:
                implausible[look.place].append(f"{look.source}: {result.implausible}")
            progress.advance()
    for place, wrong in implausible.items():
        _complete(found[place], captures[place], wrong)
    return found


def _looks(
    captures: Sequence[Capture], found: list[CaptureFacts], implausible: dict[int, list[str]]
) -> Iterator[FrameLook]:
    """Yield the frames to be read. Begin the facts of each capture, and a list of its implausible frames if it is read."""
    for place, capture in enumerate(captures):
        metadata, typical = capture.source.metadata, capture.typical
        facts = CaptureFacts(
            str(capture.root), unambiguous_range_m=unambiguous_range_m(metadata.modulation.periods_ns[0])
        )
        found.append(facts)
        for key in KEYS.values():
            value = getattr(getattr(metadata, key.table), key.name)
            facts.metadata[key.path] = {"value": value, "from": capture.source.origins[key.path]}
        if typical is None and (of_planes := hint_of_planes(capture)):
            hint, facts.guessed_layout = of_planes
            facts.problems.append(hint)
            continue
        if typical and not typical.is_plain:
            facts.lossy_compression = lossy_compression(typical.source, capture.layout, typical.dtype)
        implausible[place] = []
        reader = FrameReader.of(capture)
        for source in single_frames(capture):
            yield FrameLook(place, source, reader)


def _complete(facts: CaptureFacts, capture: Capture, implausible: Sequence[str]) -> None:
    """Add to the facts of a capture what all of its frames tell."""
    metadata = capture.source.metadata
    if implausible:
        more = f" (and {counted(len(implausible) - 1, 'more frame')})" if len(implausible) > 1 else ""
        facts.problems.append(f"{implausible[0]}{more}")
    if capture.typical and (doubt := metadata.mistaken_unit(capture.typical.pixels)):
        facts.problems.append(f"{capture.root}: {doubt}")
    n_av = metadata.pixel.integration_length or facts.integration_length_seen
    if n_av is not None:
        facts.noise_mv = 1000.0 * ambient_noise_v(metadata, integration_length=n_av)
    try:
        FramePlan(metadata=metadata)
        for dtype in facts.types:
            volts_per_count(metadata.voltage, np.dtype(dtype))
    except CadtofError as error:
        facts.problems.append(f"{capture.root}: {error}")
