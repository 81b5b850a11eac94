"""What a capture holds, gathered from its frames, for `cadtof info`."""

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import Capture, FrameSource, read_stored, single_frames
from cadtof_cli.capture.metadata import KEYS, Layout
from cadtof_cli.capture.suggested_layout import hint_of_planes
from cadtof_cli.doubts.frame import doubts
from cadtof_cli.doubts.mistaken_units import mistaken_unit
from cadtof_cli.doubts.plausible import implausible
from cadtof_cli.errors import CadtofError, no_memory_for
from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import WorkerDied
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.formats import detect_format
from cadtof_cli.files.frames import NotAFrameError
from cadtof_cli.phasors.noise import ambient_noise_v, estimated_integration_length
from cadtof_cli.phasors.voltages import ideal_phasor_map, phasors_from_stored, saturated_pixels, volts_per_count
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.status import StatusBit, why_no_answer
from cadtof_cli.units import counted, unambiguous_range_m
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.recording import FrameReader, named

_LARGEST_RATIO = 2.0
"""Largest ratio between the integration lengths that frames show, up to which they may be the same. Scatter alone makes
1.2 in frames of 64 × 48 pixels, and less in larger ones."""


@dataclass(frozen=True)
class FrameFacts:
    """What a recorded frame holds.

    Attributes:
        problem: why it could not be read; None: it was read.
        skipped: whether the file is sound, but no frame.
        container: name of the file format.
        dtype: type of the stored values.
        shape: shape of the frame, (H, 2, Y, X).
        planes: least and largest stored value of each plane, by its name.
        saturated: share of saturated pixels.
        not_finite: share of pixels with values that are not finite.
        integration_length_seen: the n_av that its noise shows.
        implausible: its name, and why its values cannot be voltages of the capture or its planes hardly what they are read as.
    """

    problem: str | None = None
    skipped: bool = False
    container: str = ""
    dtype: str = ""
    shape: tuple[int, ...] = ()
    planes: dict[str, tuple[float, float]] = field(default_factory=dict)
    saturated: float = 0.0
    not_finite: float = 0.0
    integration_length_seen: float = math.nan
    implausible: str | None = None


@dataclass(frozen=True)
class FrameLook:
    """A frame to be read: of the capture in this place, whose frames are read by the `reader`."""

    place: int
    source: FrameSource
    reader: FrameReader


def facts_of_frame(look: FrameLook, /) -> FrameFacts:
    """Read one frame and return what it holds. Every error becomes its `problem`."""
    source, layout = look.source, look.reader.layout
    try:
        stored = read_stored(source, layout, size=look.reader.pixels)
        container = detect_format(source.paths[0], raw=layout.raw is not None).name
        return _facts(stored, container, look)
    except NotAFrameError as error:
        return FrameFacts(problem=str(error), skipped=True)
    except CadtofError as error:
        return FrameFacts(problem=str(error))
    except MemoryError:
        return FrameFacts(problem=str(no_memory_for(source)))


def _facts(stored: Stored, container: str, look: FrameLook) -> FrameFacts:
    metadata = look.reader.metadata
    planes = stored.reshape(*stored.shape[:2], -1)
    finite = [plane[np.isfinite(plane)] for channels in planes for plane in channels]
    ranges = {
        name: (float(plane.min()), float(plane.max()))
        for name, plane in zip(look.reader.layout.plane_names, finite, strict=True)
        if plane.size
    }
    saturated = saturated_pixels(planes, metadata.voltage.saturated_counts)
    facts = FrameFacts(
        container=container,
        dtype=str(stored.dtype),
        shape=stored.shape,
        planes=ranges,
        saturated=float(saturated.mean()),
        not_finite=float(1.0 - np.isfinite(planes).all(axis=(0, 1)).mean()),
    )
    try:
        phasor_map = ideal_phasor_map(metadata, stored.dtype)
    except CadtofError:
        # the missing setting is reported once, for the whole capture
        return facts
    if wrong := implausible(stored, metadata):
        # values that are no voltages show no noise either
        return replace(facts, implausible=f"{look.source}: {wrong}")
    phasors = phasors_from_stored(planes, phasor_map)
    phasors[:, saturated] = np.nan
    why = (
        why_no_answer(np.array([StatusBit.NOT_FINITE], np.uint16)) if facts.not_finite == 1.0 else None
    ) or "; ".join(doubts(stored, metadata))
    return replace(
        facts,
        integration_length_seen=estimated_integration_length(
            phasors.reshape(-1, *stored.shape[2:]), metadata, quantised=stored.dtype.kind in "iu"
        ),
        implausible=f"{look.source}: {why}" if why else None,
    )


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


def facts_of_captures(captures: Sequence[Capture], /, *, workers: Workers, progress: Progress) -> list[CaptureFacts]:
    """Return what each capture holds. The same processes read the frames of all captures: there may be thousands of captures."""
    # forked processes keep it, too
    keep_freed_memory()
    looked = [_LookedInto(place, capture) for place, capture in enumerate(captures)]
    shared = [part for one in captures for part in (one.layout, one.source.metadata)]
    frames = (look for one in looked for look in one.frames())
    with closing(run_ordered(facts_of_frame, frames, workers=workers, shared=shared)) as outcomes:
        for outcome in outcomes:
            look, result = outcome.task, outcome.result
            if isinstance(result, WorkerDied):
                result = FrameFacts(problem=f"{look.source}: the process that read it died, twice")
            looked[look.place].add(result)
            progress.advance()
    return [one.completed() for one in looked]


class _LookedInto:
    """A capture whose frames are being read, and what is known of it so far."""

    def __init__(self, place: int, capture: Capture, /) -> None:
        metadata, origins = capture.source.metadata, capture.source.origins
        self._place, self._capture, self._implausible = place, capture, list[str]()
        self._is_read = True
        self._facts = CaptureFacts(
            str(capture.root), unambiguous_range_m=unambiguous_range_m(metadata.modulation.periods_ns[0])
        )
        for key in KEYS.values():
            self._facts.metadata[key.path] = {"value": key.value_in(metadata), "from": origins[key.path]}

    def frames(self) -> Iterator[FrameLook]:
        """Yield the frames to be read: none if the files are planes, and nothing says which plane each is."""
        capture, facts = self._capture, self._facts
        typical = capture.typical
        if typical is None and (of_planes := hint_of_planes(capture)):
            hint, facts.guessed_layout = of_planes
            facts.problems.append(hint)
            self._is_read = False
            return
        facts.lossy_compression = capture.lossy_compression
        reader = FrameReader.of(capture)
        for source in single_frames(capture, typical=typical):
            yield FrameLook(self._place, source, reader)

    def add(self, frame: FrameFacts, /) -> None:
        """Count one more frame."""
        self._facts.add(frame)
        if frame.implausible is not None:
            self._implausible.append(frame.implausible)

    def completed(self) -> CaptureFacts:
        """Return the facts, together with what all frames tell if they were read."""
        facts, capture, metadata = self._facts, self._capture, self._capture.source.metadata
        if not self._is_read:
            return facts
        if self._implausible:
            first, *others = self._implausible
            facts.problems.append(f"{first} (and {counted(len(others), 'more frame')})" if others else first)
        if capture.typical and (doubt := mistaken_unit(metadata, capture.typical.pixels)):
            facts.problems.append(f"{capture.root}: {doubt}")
        n_av = metadata.pixel.mean_length or facts.integration_length_seen
        if n_av is not None:
            facts.noise_mv = 1000.0 * ambient_noise_v(metadata, integration_length=n_av)
        try:
            with named(capture):
                FramePlan(metadata=metadata)
                for dtype in facts.types:
                    volts_per_count(metadata.voltage, np.dtype(dtype))
        except CadtofError as error:
            facts.problems.append(str(error))
        return facts
