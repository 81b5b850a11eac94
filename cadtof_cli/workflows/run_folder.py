"""The folder of a run: a map file per frame, `run.json`, and `frames.jsonl`, a line per frame. Written by `resolve/record.py`."""

import operator
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path
from typing import Any, cast

from cadtof_cli.arrays import Float
from cadtof_cli.capture.checks import converted
from cadtof_cli.capture.discovery import OUTPUT_FILES, find_placed_captures
from cadtof_cli.capture.frames import Capture, FrameSource, frame_names, single_frames
from cadtof_cli.capture.metadata import KEYS, Optics
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import CadtofError, CaptureError, FrameError, MetadataError, SettingsError
from cadtof_cli.files.formats import MAP_SUFFIXES
from cadtof_cli.files.layers import read_facts
from cadtof_cli.files.reading import is_folder, read_bytes, real_path
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS, CalibrationUse, DepthKind
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.record import FRAMES_FILE, RUN_FILE, FrameReport, place_in, read_record, report_of

RecordedFrames = Mapping[str, tuple[Capture, tuple[FrameSource, ...]]]
"""Recorded frames and their captures, by the name of the map that was made from them: several where it is of their mean."""

NOT_EVALUATED = "so the first phasor is not evaluated"
"""How notes end on recorded frames that are not known, or not what they were."""

_DEPTH_BY_WORDS = {words: kind for kind, words in DEPTH_IN_WORDS.items()}


@dataclass(frozen=True)
class Run:
    """The maps of a run, all of them or one, as what comes after a run finds them.

    Attributes:
        maps: folder or file, as it was given.
        files: its map files, in the order of their names.
        folder: of the run.
        record: what `run.json` there holds; None where there is none, or it is not the record of a run.
        no_record: which of the two.
    """

    maps: Path
    files: tuple[Path, ...]
    folder: Path
    record: Mapping[str, Any] | None
    no_record: str = f"no {RUN_FILE} beside the maps"

    def name(self, file: Path, /) -> str:
        """Return the name of a map: its path from the run's folder, without suffix."""
        return file.relative_to(self.folder).with_suffix("").as_posix()

    @cached_property
    def roi(self) -> Sequence[int] | None:
        """What the maps show of the recorded frames: columns X0 ≤ x < X1 and rows Y0 ≤ y < Y1; None: all of them.

        Without the run's record the header of the first map that says anything tells it.
        """
        if self.record is not None:
            return cast("Sequence[int] | None", self.record["arguments"].get("roi"))
        said = next(self._headers(), {}).get("roi", "")
        return tuple(map(int, said.split(","))) if re.fullmatch(r"\d{1,9}(,\d{1,9}){3}", said) else None

    def _headers(self) -> Iterator[Mapping[str, str]]:
        """Yield the facts in the header of each map that has any; a damaged one may have none."""
        for file in self.files:
            with suppress(FrameError):
                if facts := read_facts(file):
                    yield facts

    def cropped(self, plane: Float, /) -> Float:
        """Return of a plane of a whole frame what the maps show: the pixels of `--roi`."""
        roi = self.roi
        if not roi or plane.shape == (roi[3] - roi[1], roi[2] - roi[0]):
            return plane
        return plane[roi[1] : roi[3], roi[0] : roi[2]]

    def require_maps(self) -> tuple[Path, ...]:
        """Return the map files; raises CaptureError where there are none."""
        if not self.files:
            raise CaptureError(f"{self.maps}: found no maps (.exr, .tif), expected those of `cadtof resolve`")
        return self.files

    @property
    def depth_kind(self) -> DepthKind:
        """What the depths of the maps are: ranges, where nothing says otherwise."""
        return self.said_depth or "range"

    @cached_property
    def said_depth(self) -> DepthKind | None:
        """What the depths of the maps are, as the run's record says or, without one, the header of the first map that says it."""
        if self.record is not None:
            return "z" if self.record["arguments"].get("depth") == "z" else "range"
        words = (header.get("depth") for header in self._headers())
        return next((_DEPTH_BY_WORDS[said] for said in words if said in _DEPTH_BY_WORDS), None)

    def optics(self, file: Path, /) -> Optics:
        """Return the optics of the recorded frame of a map, as the run's record has them; unknown without one.

        Maps lie below the run's folder as their captures lie below the folder that they share.
        """
        captures = [] if self.record is None else self.record.get("captures", [])
        beside = Path(self.name(file)).parent.parts
        for capture in captures:
            folder = Path(capture["root"]).parts
            if len(captures) == 1 or (beside and folder[-len(beside) :] == beside):
                return _optics_of(capture)
        return Optics()

    def reports(self) -> tuple[FrameReport, ...]:
        """Return the lines of `frames.jsonl`, those that are sound; nothing where there is no such file.

        Raises:
            CaptureError: it cannot be read.
        """
        path = self.folder / FRAMES_FILE
        try:
            lines = read_bytes(path).splitlines()
        except FileNotFoundError:
            return ()
        except OSError as error:
            raise CaptureError(f"{path}: cannot be read: {error.strerror}") from error
        return tuple(report for report in map(report_of, lines) if report is not None)

    def map_of(self, report: FrameReport, /) -> Path | None:
        """Return where the maps of a frame lie in the run's folder, wherever that has been moved; None where it has none."""
        if report.output is None:
            return None
        called = Path("" if self.record is None else str(self.record["arguments"].get("out", "")))
        return self.folder / place_in(called, Path(report.output))

    def require_range_depth(self) -> None:
        """Make sure that the maps can be held against truth, which is radial range.

        Raises:
            SettingsError: they hold z depth.
        """
        if self.depth_kind == "z":
            raise SettingsError(
                f"{self.maps}: holds z depth, and truth is radial range; resolve with --depth range to evaluate"
            )

    def _inputs(self, arguments: Mapping[str, Any]) -> list[Path]:
        """Return where the inputs of the run lie: where they lay, or in the same place seen from the run, if both were moved."""
        known = [Path(path) for path in arguments.get("absolute_inputs", arguments["inputs"])]
        if "inputs_from_out" in arguments and not all(path.exists() for path in known):
            moved = [self.folder.absolute() / path for path in arguments["inputs_from_out"]]
            known = moved if all(path.exists() for path in moved) else known
        return known

    def calibration(self) -> CalibrationUse | None:
        """Return the calibration that was applied, where it lies now; None: none was.

        Raises:
            LookupError, TypeError: the record has another form.
        """
        known = self.record and self.record.get("calibration")
        if not known:
            return None
        places = [
            known.get("absolute_folder"),
            self.folder.absolute() / known.get("folder_from_out", "."),
            known["folder"],
        ]
        there = [Path(place) for place in places if place and Path(place).is_dir()]
        return CalibrationUse((there or [Path(known["folder"])])[0], known["digest"])

    def recorded_frames(self, say: Callable[[str], None], /) -> RecordedFrames:
        """Return the frames that the maps were made from; nothing, and a note, where they are not known or gone."""
        if self.record is None:
            say(f"{self.no_record}, {NOT_EVALUATED}")
            return {}
        arguments = self.record["arguments"]
        try:
            inputs = self._inputs(arguments)
            settings = arguments.get("settings")
            captures, _ = find_placed_captures(
                inputs,
                overrides=arguments["overrides"],
                settings_file=Path(settings) if settings else None,
                recursive=bool(arguments.get("recursive")),
            )
            return _by_map(captures, slice(*(arguments.get("frames") or (None,))), int(arguments.get("average", 1)))
        except (CadtofError, LookupError, TypeError, ValueError, AttributeError) as error:
            say(f"the recorded frames are not where they were, {NOT_EVALUATED}: {error}")
            return {}


def _by_map(captures: Sequence[Capture], chosen: slice, average: int) -> RecordedFrames:
    """Return the frames that each map is of, by its name: that of the first."""
    found: dict[str, tuple[Capture, tuple[FrameSource, ...]]] = {}
    for capture in captures:
        frames = tuple(single_frames(capture, taken=partial(frame_names, captures)))[chosen]
        for place in range(0, len(frames), average):
            found[frames[place].name] = capture, frames[place : place + average]
    return found


def read_run(maps: Path, /) -> Run:
    """Return the run that a folder of maps, or one map file, belongs to.

    Raises:
        CaptureError: there is no such folder or file, or the `run.json` of the run cannot be read.
    """
    if not maps.exists():
        raise CaptureError(f"{maps}: no such file or folder; expected maps that `cadtof resolve` wrote")
    files, folder = map_files(maps), maps if maps.is_dir() else maps.parent
    folder = next((above for above in (folder, *folder.parents) if os.path.lexists(above / RUN_FILE)), None) or folder
    path = folder / RUN_FILE
    if not os.path.lexists(path):
        return Run(maps, files, folder, None)
    try:
        return Run(maps, files, folder, require_valid_record(read_record(folder)))
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, LookupError, TypeError, AttributeError, MetadataError) as error:
        return Run(maps, files, folder, None, f"{path}: not the record of a run ({error})")


def is_run_folder(path: Path, /) -> bool:
    """Return whether a folder is one that `cadtof resolve` wrote."""
    return is_folder(path) and os.path.lexists(path / RUN_FILE) and not os.path.lexists(path / CAPTURE_FILE)


def map_files(maps: Path, /) -> tuple[Path, ...]:
    """Return a run's map files in the order of their names, those in folders below it last; or the one file.

    An empty folder that is called like a map stands for one, which fails by its name.

    Raises:
        CaptureError: a folder cannot be listed.
    """
    return _map_files(maps, set()) if is_folder(maps) else (maps,)


def _map_files(folder: Path, seen: set[str]) -> tuple[Path, ...]:
    """Return the map files in a folder and below it but for folders that were `seen`: links may lead in a circle."""
    seen.add(real_path(folder))
    files, below = list[Path](), list[Path]()
    for path in _listed(folder):
        inside = [one.name for one in _listed(path)] if is_folder(path) else []
        if path.suffix in MAP_SUFFIXES and not inside:
            files.append(path)
        elif inside and OUTPUT_FILES.isdisjoint(inside):
            below.append(path)
    return (*files, *(file for one in below if real_path(one) not in seen for file in _map_files(one, seen)))


def _listed(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError as error:
        raise CaptureError(f"{folder}: cannot be listed: {error.strerror}") from error


def require_valid_record(record: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what a `run.json` holds, after a check of what other commands read from it: it may come from anywhere.

    Raises:
        ValueError, LookupError, TypeError, AttributeError, MetadataError: it is something else.
    """
    arguments = record["arguments"]
    if not arguments.keys() >= {"inputs", "overrides"}:
        raise ValueError("its arguments name no inputs or no overrides")
    roi = arguments.get("roi")
    if roi is not None:
        x0, y0, x1, y1 = map(operator.index, roi)
        if not (0 <= x0 < x1 and 0 <= y0 < y1):
            raise ValueError(f"found the roi {roi}")
    for capture in record.get("captures", []):
        Path(capture["root"])
        _optics_of(capture)
    return record


def _optics_of(capture: Mapping[str, Any]) -> Optics:
    known = capture["metadata"]["optics"]
    names = [name for name in ("focal_length_px", "principal_point_px") if known[name] is not None]
    return Optics(**{name: converted(KEYS[f"optics.{name}"].kind, known[name]) for name in names})
