"""The plans of a run, made before anything is written: what is done with each capture, and which calibration is
applied."""

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures, placed_captures
from cadtof_cli.capture.frames import Capture, FrameSource, TypicalFile, file_size, open_frames, single_frames
from cadtof_cli.doubts.frame import doubts_before_run
from cadtof_cli.doubts.mistaken_units import mistaken_unit
from cadtof_cli.doubts.plausible import implausible
from cadtof_cli.errors import CaptureError, FrameError
from cadtof_cli.files.formats import RAW, format_by_suffix, map_format
from cadtof_cli.files.frames import harmonic_labels
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan
from cadtof_cli.records import dataclass
from cadtof_cli.units import counted
from cadtof_cli.workflows.recording import FrameReader, named
from cadtof_cli.workflows.resolve.reports import FrameReport, failed_input
from cadtof_cli.workflows.resolve.settings import ResolveSettings

_SLOW_RUN_S = 10.0

_FOR_ALL = "; an option holds for all captures of a run, a key in the capture.toml of this capture for it alone"


@dataclass(frozen=True)
class AppliedCalibration:
    """A calibration that a run applies: `use` is for the workers, `parts` for `run.json`, `notes` for the user."""

    use: CalibrationUse
    parts: Mapping[str, Mapping[str, Any]]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class CapturePlan:
    """A capture, and what to do with its frames.

    Attributes:
        capture: folder, metadata and frames.
        reader: how its frames are read.
        plan: everything that decides its maps.
        settings: settings of the run.
        typical: what most of its files hold; None: no file can be opened, or they arrive during the run.
        doubts: what is likely wrong with its values, planes or metadata, in words.
    """

    capture: Capture
    reader: FrameReader
    plan: FramePlan
    settings: ResolveSettings
    typical: TypicalFile | None = None
    doubts: tuple[str, ...] = ()

    @cached_property
    def expected_maps(self) -> int:
        """The expected number of maps. In stacks, frames are estimated from one file and the sizes of all files."""
        frames, typical = len(self.capture.frames), self.typical
        if typical is not None and typical.frames > 1:
            frame_bytes = max(typical.bytes / typical.frames, 1.0)
            sizes = (file_size(source.paths[0]) for source in self.capture.frames)
            frames = sum(max(round(size / frame_bytes), 1) for size in sizes)
        if self.settings.frames is not None:
            frames = len(range(*self.settings.frames.indices(frames)))
        return -(-frames // self.settings.maps.average)

    def groups(self, *, taken: Callable[[], Collection[str]] | None = None) -> Iterator[tuple[FrameSource, ...]]:
        """Yield the frames of each map: one, or those whose mean it shows. Each frame of a stack counts as a frame.

        Args:
            taken: returns the names that no frame of a stack may get (see `single_frames`).

        Raises:
            CaptureError: nothing tells how many frames come before those of `--frames`.
        """
        frames = single_frames(self.capture, typical=self.typical, taken=taken)
        if self.settings.frames is not None:
            frames = self._chosen(frames, self.settings.frames)
        while sources := tuple(itertools.islice(frames, self.settings.maps.average)):
            yield sources

    def output(self, sources: Sequence[FrameSource], /) -> Path:
        """Return the file of the map of some frames, which has the name of the first frame."""
        form = map_format(self.settings.map_format, sources[0].paths[0])
        return self.settings.out / f"{sources[0].name}.{form.name}"

    def _chosen(self, frames: Iterator[FrameSource], chosen: slice) -> Iterator[FrameSource]:
        """Yield the frames that `--frames` chooses: all frames are counted, so stacks before these must be readable."""
        for source in itertools.islice(frames, chosen.start or 0):
            if self.typical is not None and self.typical.frames > 1 and source.index is None:
                try:
                    with open_frames(source, self.capture.layout):
                        continue
                except FrameError as error:
                    raise CaptureError(f"--frames: the frames of this stack cannot be counted: {error}") from error
        left = None if chosen.stop is None else max(chosen.stop - (chosen.start or 0), 0)
        yield from itertools.islice(frames, 0, left, chosen.step)

    def load_map_files(self) -> None:
        """Load the module that writes the maps of most frames, before there are maps to be written."""
        for source in self.capture.frames[:1]:
            layers = map_format(self.settings.map_format, source.paths[0]).layers
            assert layers is not None
            layers()

    def notes(self) -> Iterator[str]:
        """Yield notes on what is assumed about the capture, and warnings of what is likely wrong with it."""
        source, root = self.capture.source, self.capture.root
        if source.file is not None and source.file.parent != root:
            yield f"{root}: has the settings of {source.file}"
        if taken := source.defaults_in_words():
            yield f"{root}: {taken}"
        if source.metadata.pixel.integration_length is None:
            yield f"{root}: pixel.integration_length is not given, so the noise is estimated from each frame"
        if lossy := self.capture.lossy_compression:
            yield (
                f"warning: {root}: recorded with lossy compression ({lossy}), which changes voltages and so"
                " depths; record without compression, or with a lossless one: deflate, LZW, Zstandard; in EXR ZIP or PIZ"
            )
        for doubt in self.doubts:
            yield f"warning: {root}: {doubt}"
        yield from (f"{root}: {key} {where}" for key, where in self._without_effect())
        resolver, harmonics = self.settings.maps.resolver, source.metadata.modulation.harmonics
        if resolver.may_be_diffuse(harmonics) and source.metadata.optics.focal_length_px is None:
            yield f"{root}: optics.focal_length_px is not given, so diffuse MPI is predicted for a view that is 60° wide"
        if resolver.may_be_diffuse((1, 2)) and not resolver.may_be_diffuse(harmonics):
            yield f"{root}: half of the first period was not recorded, so all MPI is taken for separate paths, in rooms too"

    def _without_effect(self) -> Iterator[tuple[str, str]]:
        """Yield keys of the metadata that do not change the maps, each with the reason."""
        metadata = self.capture.source.metadata
        layout, optics = metadata.layout, metadata.optics
        form = format_by_suffix(self.typical.source.paths[0]) if self.typical else None
        if form is not None and layout.frames not in {None, 1} and (layout.pattern or not form.stacks):
            of_plane = " of one plane" if layout.pattern else ""
            yield "layout.frames", f"has no effect: {form.title} files{of_plane} are no stacks"
        if form is not None and layout.raw_shape and form is not RAW:
            yield "layout.raw_dtype and layout.raw_shape", f"have no effect on {form.title} files"
        named = dict(layout.harmonic or ())
        recorded = harmonic_labels(metadata.modulation.harmonics, set(named.values()))
        if unused := [name for name, number in named.items() if number not in recorded]:
            yield f"layout.harmonic.{', '.join(unused)}", "has no effect: modulation.periods_ns has no such period"
        if optics.principal_point_px and optics.focal_length_px is None:
            yield "optics.principal_point_px", "has no effect on maps without optics.focal_length_px"


def captures_in(
    inputs: Sequence[Path],
    settings: ResolveSettings,
    report: Callable[[FrameReport], None],
    /,
    *,
    base: Path | None = None,
) -> tuple[tuple[Capture, ...], Path]:
    """Return the captures in inputs, and the folder `base` whose tree OUT mirrors (see `find_captures`, `placed_captures`).

    `report` is called with the report on each folder that cannot be listed.
    """
    found = find_captures(
        inputs,
        overrides=settings.overrides,
        settings_file=settings.settings_file,
        recursive=settings.recursive,
        on_unlisted=lambda folder, error: report(failed_input(folder, error)),
    )
    return placed_captures(found, inputs, base=base)


def plan_captures(
    captures: Sequence[Capture], settings: ResolveSettings, calibration: AppliedCalibration | None, /
) -> list[CapturePlan]:
    """Return a plan for each capture.

    Raises:
        CaptureError: the files of a capture are planes, and nothing says which plane is which.
        SettingsError: the settings do not fit a capture; or its values are integers, and the volts per count are unknown.
        FrameError: the values of a capture cannot be voltages.
    """
    use = calibration.use if calibration else None
    plans: list[CapturePlan] = []
    for capture in captures:
        typical = capture.typical
        with named(capture):
            plan = FramePlan(metadata=capture.source.metadata, settings=settings.maps, calibration=use)
        reader = FrameReader.of(capture)
        if typical is None:
            from cadtof_cli.capture.suggested_layout import hint_of_planes

            if found := hint_of_planes(capture):
                raise CaptureError(found[0])
            plans.append(CapturePlan(capture, reader, plan, settings))
            continue
        if settings.maps.roi:
            settings.maps.require_roi_within(typical.pixels, of=str(capture.root))
        stored = _plausible_frame(capture, typical.source, hint="" if len(captures) == 1 else _FOR_ALL)
        doubtful = () if stored is None else doubts_before_run(stored, plan)
        if of_unit := mistaken_unit(plan.metadata, typical.pixels):
            doubtful += (of_unit,)
        plans.append(CapturePlan(capture, reader, plan, settings, typical, doubtful))
    return plans


def _plausible_frame(capture: Capture, typical: FrameSource, *, hint: str = "") -> Stored | None:
    """Return a frame whose stored values can be voltages: the typical one, else the first, middle or last; None: none is read.

    `hint` ends the message of the FrameError.

    Raises:
        SettingsError: the values are integers, and nothing says how many volts a count is.
        FrameError: in all of these frames that are read, the values cannot be voltages: the capture is at fault, not one frame.
    """
    wrong: list[str] = []
    for source in dict.fromkeys((typical, *(capture.frames[place] for place in (0, len(capture.frames) // 2, -1)))):
        try:
            with named(capture), open_frames(source, capture.layout) as frames:
                stored = frames.read(0)
                found = implausible(stored, capture.source.metadata)
        except FrameError:
            continue
        if found is None:
            return stored
        wrong.append(f"{source}: {found}")
    if wrong:
        raise FrameError(wrong[0] + hint)
    return None


def pooling_notes(plans: Sequence[CapturePlan], settings: ResolveSettings, /) -> Iterator[str]:
    """Yield a note on how long a run will take, if pooling makes it so long that the progress bar shows nothing for a while."""
    from cadtof_cli.phasors.pooling import pooling_seconds

    maps, seconds = sum(one.expected_maps for one in plans), 0.0
    for one in plans:
        noise = noise_model(one.plan.metadata, integration_length=1e5, quantised=False)
        seconds += one.expected_maps * pooling_seconds(one.reader.pixels or (0, 0), noise, window=settings.maps.pool)
    seconds /= settings.workers.at_most(maps).jobs
    if seconds > _SLOW_RUN_S:
        told = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
        yield f"--pool {settings.maps.pool}: {counted(maps, 'frame')} will take about {told}"


def use_calibration(folder: Path, captures: Sequence[Capture], /) -> AppliedCalibration:
    """Read a calibration folder and make sure that it belongs to the captures.

    Raises:
        MetadataError: the calibration cannot be read, or is damaged.
        SettingsError: its array size, periods or waveform differ from those of a capture.
    """
    from cadtof_cli.calibration.store import current_calibration

    calibration = current_calibration(folder)
    for capture in captures:
        with named(capture):
            calibration.require_match(capture.source.metadata, capture.typical.pixels if capture.typical else None)
    digests = calibration.digests
    parts: dict[str, Mapping[str, Any]] = {
        part.kind: {
            "digest": digests[part.kind],
            "created": part.origin.created,
            "version": part.origin.version,
            "captures": list(part.origin.captures),
        }
        for part in calibration.parts
    }
    notes = (
        f"{folder}: applied {calibration.summary}",
        *(f"warning: {folder}: {text}" for text in calibration.stale()),
        *(f"warning: {one.root}: {doubt}" for one in captures for doubt in calibration.doubts(one.source.metadata)),
    )
    return AppliedCalibration(CalibrationUse(folder, calibration.digest, sine=calibration.sine), parts, notes)
