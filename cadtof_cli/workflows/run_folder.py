"""The folder of a run, as later commands read it: a map file per frame, `run.json`, and `frames.jsonl` with a line per frame.

`resolve/record.py` writes the two records; `resolve/run_json.py` knows what is in the first, `resolve/reports.py` what a line of
the second says.
"""

import io
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from cadtof_cli.arrays import Float
from cadtof_cli.capture.discovery import steps_below
from cadtof_cli.capture.frames import Capture, FrameSource, frame_names, single_frames
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import CadtofError, CaptureError, FrameError, MetadataError, SettingsError, UnlistedError
from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.files.layers import read_facts
from cadtof_cli.files.maps import region_of
from cadtof_cli.files.reading import is_folder, read_bytes
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS, DepthKind
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.map_files import map_files
from cadtof_cli.workflows.resolve.lines import FRAMES_FILE, place_in
from cadtof_cli.workflows.resolve.reports import FrameReport, report_of
from cadtof_cli.workflows.resolve.run_json import NOT_OF_A_RUN, RUN_FILE, RunRecord, optics_of, read_record

RecordedFrames = Mapping[str, tuple[Capture, tuple[FrameSource, ...], str | None]]
"""For each map, by its name: the capture, the recorded frames that the map was made from (several if it shows a mean), and the
digest of their values if `frames.jsonl` has it."""

NOT_EVALUATED = "so the first phasor is left out"
"""End of all notes on recorded frames that are unknown or have changed."""

_DEPTH_BY_WORDS = {words: kind for kind, words in DEPTH_IN_WORDS.items()}


@dataclass(frozen=True)
class Run:
    """All maps of a run, or one of them, as the commands after a run find them.

    Attributes:
        maps: folder or file, as the user gave it.
        files: its map files, in natural order: frame_2 before frame_10.
        folder: folder of the run.
        record: content of `run.json` in that folder; None if there is no such file, or if it is not the record of a run.
        no_record: which of these two is the reason for None.
    """

    maps: Path
    files: tuple[Path, ...]
    folder: Path
    record: RunRecord | None
    no_record: str = f"no {RUN_FILE} beside the maps"

    def name(self, file: Path, /) -> str:
        """Return the name of a map: its path from the run's folder, without suffix."""
        return file.relative_to(self.folder).with_suffix("").as_posix()

    @cached_property
    def roi(self) -> Sequence[int] | None:
        """The part X0, Y0, X1, Y1 of the recorded frames that the maps show: columns X0 ≤ x < X1 and rows Y0 ≤ y < Y1.

        None: the maps show whole frames. Without a record of the run, the headers say it; raises SettingsError if they differ.
        """
        if self.record is not None:
            return self.record.roi
        return region_of(self._said("roi", if_missing="whole frames"))

    @cached_property
    def _headers(self) -> Mapping[Path, Mapping[str, str]]:
        """The facts in the header of each map; a damaged map may have none."""
        headers: dict[Path, Mapping[str, str]] = {}
        for file in self.files:
            with suppress(FrameError):
                headers[file] = read_facts(file)
        return headers

    def _said(self, fact: str, *, if_missing: str = "") -> str:
        """Return a fact that the headers of all maps agree on; empty if no header has it. Raises SettingsError if they differ.

        A header with other facts alone counts as one that says `if_missing`; empty: it does not count.
        """
        said = {file: facts.get(fact, if_missing) for file, facts in self._headers.items() if facts}
        files = {text: file.name for file, text in said.items() if text}
        if len(files) > 1:
            found = " and ".join(f"{said} ({name})" for said, name in list(files.items())[:2])
            hint = f"without a {RUN_FILE}, give each map by its own name"
            raise SettingsError(f"{self.maps}: found maps of different {fact}, {found}, expected one run; {hint}")
        return next(iter(files), "")

    def cropped(self, plane: Float, /) -> Float:
        """Return the part of a plane that the maps show: the pixels of `--roi`. A plane of that size already stays as it is."""
        roi = self.roi
        if not roi or plane.shape == (roi[3] - roi[1], roi[2] - roi[0]):
            return plane
        return plane[roi[1] : roi[3], roi[0] : roi[2]]

    def require_maps(self) -> tuple[Path, ...]:
        """Return the map files; raises CaptureError if there are none."""
        if not self.files:
            raise CaptureError(f"{self.maps}: found no maps (.exr, .tif), expected those of `cadtof resolve`")
        return self.files

    @property
    def depth_kind(self) -> DepthKind:
        """The kind of depth in the maps: radial range, unless the record or a header names another kind."""
        return self.said_depth or "range"

    @cached_property
    def said_depth(self) -> DepthKind | None:
        """The kind of depth that the record or, without one, the headers name; else None. Raises SettingsError if they differ."""
        if self.record is not None:
            return self.record.depth_kind
        return _DEPTH_BY_WORDS.get(self._said("depth"))

    @property
    def captures(self) -> Sequence[Mapping[str, Any]]:
        """The captures in the record; without a record there are none."""
        return [] if self.record is None else self.record.captures

    @property
    def captures_shown(self) -> int:
        """How many captures the maps are of: each capture of a run has a folder of its own. Without a record it is 1."""
        recorded = len(self.captures) if self.record else 1
        return min(recorded, len({Path(self.name(file)).parent for file in self.files}))

    def optics(self, file: Path, /) -> Optics:
        """Return the optics of a map's recorded frame from the run's record. Without a record they are unknown.

        They are also unknown if the map may belong to several captures whose optics differ.
        """
        beside = Path(self.name(file)).parent.parts
        # the maps of a capture lie in folders with the names of the last folders above its frames
        found = self.captures if len(self.captures) == 1 else self._captures_at.get(beside)
        if found is None:
            found = [
                one
                for one, (root, _) in zip(self.captures, self._capture_places, strict=True)
                if not beside or root.parts[-len(beside) :] == beside
            ]
        several = [optics_of(one) for one in found]
        return several[0] if several and all(one == several[0] for one in several) else Optics()

    @cached_property
    def _captures_at(self) -> Mapping[tuple[str, ...], list[Mapping[str, Any]]]:
        """The captures of the record, by the folders of their maps in the run's folder."""
        found: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
        for one, (_, beside) in zip(self.captures, self._capture_places, strict=True):
            found.setdefault(beside, []).append(one)
        return found

    @cached_property
    def _capture_places(self) -> list[tuple[Path, tuple[str, ...]]]:
        """For each capture of the record: its absolute folder, and the folders of its maps in the run's folder."""
        if self.record is None or not self.captures:
            return []
        shared = self.record.shared_folder
        # runs of 0.1.0 have all maps in their folder itself
        return [(root, steps_below(root, shared) if shared else ()) for root in self.record.capture_folders()]

    def reports(self) -> Iterator[FrameReport]:
        """Yield the valid lines of `frames.jsonl`, none if there is no such file; raises CaptureError if it cannot be read."""
        path = self.folder / FRAMES_FILE
        try:
            lines = io.BytesIO(read_bytes(path))
        except FileNotFoundError:
            return
        except OSError as error:
            raise CaptureError(f"{path}: cannot be read: {error.strerror}") from error
        yield from filter(None, map(report_of, lines))

    @cached_property
    def _known(self) -> frozenset[Path]:
        return frozenset(self.files)

    def map_of(self, report: FrameReport, /) -> Path | None:
        """Return the map file of a frame in the run's folder, also after the folder was moved; None: the frame has no maps."""
        if report.output is None:
            return None
        output = Path(report.output)
        if self.record is None:
            # nothing says how the run called its folder: take the map in the most of the folders that the line names
            below = (self.folder.joinpath(*output.parts[first:]) for first in range(len(output.parts)))
            return next((file for file in below if file in self._known), self.folder / output.name)
        return self.folder / place_in(Path(str(self.record["arguments"].get("out", ""))), output)

    def wrote_into(self, place: Path, /) -> bool:
        """Return whether maps of the run were written into a folder, or into one below it."""
        return any(place in file.parents for file in map(self.map_of, self.reports()) if file)

    def unnamed_files(self) -> list[Path]:
        """Return the map files that `frames.jsonl` does not name: the run did not make them. Without its lines, none is known.

        Raises:
            CaptureError: `frames.jsonl` cannot be read.
        """
        named = {self.map_of(report) for report in self.reports()}
        return [file for file in self.files if named and file not in named]

    def tell_if_unfinished(self, say: Callable[[str], None], /) -> None:
        """Say that frames may be missing if the run was stopped, or goes on. Of a single map that is no matter."""
        if self.maps.is_dir() and self.record is not None and not self.record.is_finished:
            hint = "if it was stopped, `cadtof resolve --resume` completes it"
            say(f"{self.maps}: the run has not finished, so frames may be missing; {hint}")

    def frames_without_maps(self) -> int:
        """Return how many frames of the run failed, or lost their map file since; 0 if only a part of its maps was given.

        Raises:
            CaptureError: `frames.jsonl` cannot be read.
        """
        if self.maps != self.folder:
            return 0
        kept = {None, *self.files}
        return sum(report.status == "failed" or self.map_of(report) not in kept for report in self.reports())

    def recorded_frames(self, say: Callable[[str], None], /) -> RecordedFrames:
        """Return the frames that the maps were made from. If they are unknown or gone, say so and return nothing."""
        if self.record is None:
            say(f"{self.no_record}, {NOT_EVALUATED}")
            return {}
        try:
            found = self._recorded_frames(self.record.recorded_captures(self.folder), self.record.average)
        except (CadtofError, *NOT_OF_A_RUN) as error:
            say(f"the recorded frames are no longer where they were, {NOT_EVALUATED}: {error}")
            return {}
        if self.files and not found:
            say(f"{self.maps}: its records name no recorded frame of any map, {NOT_EVALUATED}")
        return found

    def _recorded_frames(self, captures: Sequence[Capture], average: int) -> RecordedFrames:
        """Return the frames of each map. Its line says which they are; without it, those from the one with the map's name on."""
        lines = dict[str, FrameReport]()
        with suppress(CaptureError):
            lines = {self.name(file): one for one in self.reports() if (file := self.map_of(one)) is not None}
        places = dict[str, tuple[Capture, tuple[FrameSource, ...], int]]()
        for capture in captures:
            frames = tuple(single_frames(capture, taken=partial(frame_names, captures)))
            for place, frame in enumerate(frames):
                # a line may call the folder otherwise than we do now
                for name in (frame.name, f"{Path(frame.name).parent}/{Path(str(frame)).name}"):
                    places.setdefault(name, (capture, frames, place))
        found = dict[str, tuple[Capture, tuple[FrameSource, ...], str | None]]()
        for name in map(self.name, self.files):
            line = lines.get(name)
            first = places.get(f"{Path(name).parent}/{Path(line.source).name}" if line else name)
            if first is None:
                continue
            capture, frames, place = first
            later: Iterable[FrameSource] = map(frames.__getitem__, range(place, len(frames)))
            if line is not None and line.files is not None:
                files = {file.name for file in line.files}
                later = (frame for frame in later if files.issuperset(path.name for path in frame.paths))
            # a damaged line may name files that no frame has
            if sources := tuple(itertools.islice(later, average)):
                found[name] = capture, sources, line.digest if line else None
        return found


def read_run(maps: Path, /) -> Run:
    """Return the run that a folder of maps, or one map file, belongs to.

    A folder that cannot be listed, as `lost+found` on a disk, or that is of another run is left out if the run says that none of
    its maps were written into it. If not, if there is no such folder or file, or if `run.json` cannot be read, a CaptureError is
    raised.
    """
    if not maps.exists():
        raise CaptureError(f"{maps}: no such file or folder; expected maps that `cadtof resolve` wrote")
    # the caller reads one map after the other
    keep_freed_memory()
    closed, others = dict[Path, UnlistedError](), list[Path]()
    files = map_files(maps, on_unlisted=closed.__setitem__, on_run=others.append)
    above = (maps, *maps.parents) if maps.is_dir() else maps.parents
    folder = next((one for one in above if os.path.lexists(one / RUN_FILE)), above[0])
    run = _run_in(folder, maps, files)
    for place, error in closed.items():
        if run.record is None or run.wrote_into(place):
            raise error
    for place in filter(run.wrote_into, others if run.record is not None else ()):
        raise CaptureError(
            f"{place}: another run replaced maps of the run in {folder}; move it elsewhere, then use --resume"
        )
    return run


def _run_in(folder: Path, maps: Path, files: tuple[Path, ...]) -> Run:
    path = folder / RUN_FILE
    if not os.path.lexists(path):
        return Run(maps, files, folder, None)
    try:
        return Run(maps, files, folder, read_record(folder).checked())
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (*NOT_OF_A_RUN, MetadataError) as error:
        return Run(maps, files, folder, None, f"{path}: not the record of a run ({error})")


def is_run_folder(path: Path, /) -> bool:
    """Return whether a path is a folder that `cadtof resolve` wrote."""
    return is_folder(path) and os.path.lexists(path / RUN_FILE) and not os.path.lexists(path / CAPTURE_FILE)
