"""The content of `run.json`, the record of a run, as later runs and commands read it. `run_document.py` writes it.

A record may be of another version, which has other keys, and it may come from anywhere.
"""

import json
import operator
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from cadtof_cli.capture.checks import converted
from cadtof_cli.capture.discovery import find_captures, placed_captures
from cadtof_cli.capture.frames import Capture
from cadtof_cli.capture.metadata import KEYS, Optics
from cadtof_cli.errors import OutputError
from cadtof_cli.files.reading import absolute, read_text
from cadtof_cli.pipeline.plan import CalibrationUse, DepthKind, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings

RUN_FILE = "run.json"

NOT_OF_A_RUN = (ValueError, LookupError, TypeError, AttributeError, OverflowError)
"""What is raised by looks into a JSON object that is not the record of a run."""


class RunRecord(dict[str, Any]):
    """The content of `run.json`.

    It keeps keys that are not known. Properties and methods raise one of `NOT_OF_A_RUN` if it is not the record of a run.
    """

    @property
    def out(self) -> Path:
        """The path that the run had for its folder."""
        return Path(self["arguments"]["out"])

    @property
    def shared_folder(self) -> Path | None:
        """The folder whose tree the run's folder mirrors; None: not recorded, as in runs of 0.1.0."""
        shared = self.get("shared_folder")
        return Path(shared) if shared else None

    @property
    def captures(self) -> list[dict[str, Any]]:
        """The captures: folder, number of files, metadata."""
        captures: list[dict[str, Any]] = self.get("captures", [])
        return captures

    @property
    def roi(self) -> Sequence[int] | None:
        """The region of interest, as X0, Y0, X1, Y1; None: whole frames."""
        roi: Sequence[int] | None = self["arguments"].get("roi")
        return roi

    @property
    def depth_kind(self) -> DepthKind:
        """The kind of depth in the maps."""
        return "z" if self["arguments"].get("depth") == "z" else "range"

    @property
    def frames(self) -> slice:
        """The frames of each capture that were chosen."""
        first, end = self["arguments"].get("frames") or (None, None)
        return slice(first, end)

    @property
    def average(self) -> int:
        """How many frames each map is the mean of."""
        return int(self["arguments"].get("average", 1))

    @property
    def is_finished(self) -> bool:
        """Whether the run has come to its end."""
        return bool(self.get("finished"))

    def checked(self) -> "RunRecord":
        """Return the record, after a check of the entries that other commands read; optics may raise a MetadataError."""
        arguments = self["arguments"]
        if not arguments.keys() >= {"inputs", "overrides"}:
            raise ValueError("its arguments name no inputs or no overrides")
        Path(arguments.get("out", ""))
        # JSON holds whole numbers that are too large for arithmetic
        if isinstance(totals := self.get("totals"), Mapping):
            float(totals.get("seconds", 0))
        if (roi := arguments.get("roi")) is not None:
            x0, y0, x1, y1 = map(operator.index, roi)
            if not (0 <= x0 < x1 and 0 <= y0 < y1):
                raise ValueError(f"found the roi {roi}")
        for path in (*arguments["inputs"], *arguments.get("absolute_inputs", ())):
            Path(path)
        for capture in self.captures:
            Path(capture["root"])
            optics_of(capture)
        return self

    def map_settings(self) -> MapSettings:
        """Return the settings that a run made its phasors with."""
        arguments = self["arguments"]
        known = {one.name for one in fields(ResolverSettings)} & arguments.keys() - {"min_confidence"}
        resolver = ResolverSettings(**{name: arguments[name] for name in known})
        pool, average = arguments.get("pool", 1), arguments.get("average", 1)
        return MapSettings(resolver=resolver, depth=arguments["depth"], pool=pool, average=average)

    def input_paths(self, out: Path, /) -> list[Path]:
        """Return the paths of the inputs of the run, which lies in `out` now.

        If some of these are gone, inputs and run may have been moved together: then the paths from the run's folder are returned,
        if all of them exist.
        """
        arguments = self["arguments"]
        known = [Path(path) for path in arguments.get("absolute_inputs", arguments["inputs"])]
        if "inputs_from_out" in arguments and not all(path.exists() for path in known):
            moved = [out.absolute() / path for path in arguments["inputs_from_out"]]
            known = moved if all(path.exists() for path in moved) else known
        return known

    def recorded_captures(self, out: Path, /) -> tuple[Capture, ...]:
        """Return the captures of the run as they are now, with frames named as their maps are. The run lies in `out` now.

        Raises:
            CadtofError: they are no longer where they were.
        """
        arguments, inputs = self["arguments"], self.input_paths(out)
        settings = arguments.get("settings")
        # inputs that were moved with the run lie below another folder
        is_moved = list(map(str, inputs)) != arguments.get("absolute_inputs")
        found = find_captures(
            inputs,
            overrides=arguments["overrides"],
            settings_file=Path(settings) if settings else None,
            recursive=bool(arguments.get("recursive")),
            on_unlisted=lambda *_: None,
        )
        captures, _ = placed_captures(found, inputs, base=None if is_moved else self.shared_folder)
        return captures

    def calibration(self, out: Path, /) -> CalibrationUse | None:
        """Return the calibration that the run applied, in the place where it lies now; None: none. The run lies in `out` now."""
        known = self.get("calibration")
        if not known:
            return None
        moved = known.get("folder_from_out")  # runs of 0.1.0 have only `folder`
        places = [known.get("absolute_folder"), moved and out.absolute() / moved]
        there = next((place for place in places if place and Path(place).is_dir()), known["folder"])
        return CalibrationUse(Path(there), known["digest"])

    def capture_folders(self) -> list[Path]:
        """Return the absolute folder of each capture."""
        start = self.start_folder()
        return [absolute(start / capture["root"]) for capture in self["captures"]]

    def start_folder(self) -> Path:
        """Return the folder in which a run was started. If all inputs were typed as absolute paths, this does not matter."""
        arguments = self["arguments"]
        for typed, whole in zip(arguments["inputs"], arguments.get("absolute_inputs", ()), strict=False):
            # an absolute path is the folder in which the run was started, and then the path as it was typed
            if typed != whole:
                return Path(*Path(whole).parts[: -len(Path(typed).parts) or None])
        return Path()


def optics_of(capture: Mapping[str, Any], /) -> Optics:
    """Return the optics of a capture in a `run.json`."""
    known = capture["metadata"]["optics"]
    names = [name for name in ("focal_length_px", "principal_point_px") if known[name] is not None]
    return Optics(**{name: converted(KEYS[f"optics.{name}"].kind, known[name]) for name in names})


def read_record(folder: Path, /) -> RunRecord:
    """Return the content of the `run.json` of a folder.

    Raises:
        OSError, ValueError, TypeError: there is no such file, or it is not a JSON object.
    """
    try:
        return RunRecord(json.loads(read_text(folder / RUN_FILE, most_bytes=None)))
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 text: byte {error.start}") from error
    except RecursionError as error:
        raise ValueError("lists or objects are nested hundreds of levels deep") from error


@contextmanager
def resumable(path: Path, /) -> Iterator[None]:
    """Raise OutputError if the block finds that the content of the file at `path` is not the record of a run."""
    try:
        yield
    except NOT_OF_A_RUN as error:
        raise OutputError(f"{path}: not the record of a run, so it cannot be resumed ({error})") from error
