"""The folder that a run writes into: that nothing in it is lost, and that an earlier run in it is the same run."""

import itertools
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.frame_sources import FilesAsFrames, FrameSource
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import remove_partial_files, write_error
from cadtof_cli.files.formats import MAP_FORMATS
from cadtof_cli.files.reading import is_there, real_path
from cadtof_cli.files.system import sync_folder
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from cadtof_cli.workflows.run_folder import FRAMES_FILE, RUN_FILE, read_record

_PLACE_IN_STACK = r"_\d{4,}$"

_CHANGES_NO_MAP = frozenset(
    {
        "inputs",
        "absolute_inputs",
        "inputs_from_out",
        "out",
        "overrides",
        "calibration",
        "recursive",
        "settings",
        "frames",
    }
)
_INPUTS, _FOLDERS = "resolved_inputs", "folders of the frames"

"""Arguments that may differ between a run and its resumption: what they decide is compared by what it is, not as it was typed."""


@dataclass(frozen=True)
class FrameNames(Collection[str]):
    """The names that maps of captures will have. Thousands of them are kept only where one is asked for."""

    captures: Sequence[Capture]

    def __iter__(self) -> Iterator[str]:
        return itertools.chain.from_iterable(map(_names_of, (capture.frames for capture in self.captures)))

    def __len__(self) -> int:
        return sum(len(capture.frames) for capture in self.captures)

    def __contains__(self, name: object) -> bool:
        return name in self._known

    @cached_property
    def _known(self) -> frozenset[str]:
        return frozenset(self)


def _names_of(frames: Sequence[FrameSource]) -> Iterable[str]:
    return frames.names() if isinstance(frames, FilesAsFrames) else (frame.name for frame in frames)


def frame_names(captures: Sequence[Capture], out: Path, /) -> Collection[str]:
    """Return the names that maps will have.

    Raises:
        OutputError: the output folder is a capture's own; or two frames would be written to one file.
    """
    if (out / CAPTURE_FILE).exists() or real_path(out) in {real_path(capture.root) for capture in captures}:
        raise OutputError(f"{out}: the maps would be written among recorded frames; choose another folder with -o")
    names, met = FrameNames(captures), set[str]()
    # a capture's own names differ
    for name in names if len(captures) > 1 else ():
        if name in met:
            frames = (frame for capture in captures for frame in capture.frames if frame.name == name)
            first, second = (frame.paths[0] for frame in itertools.islice(frames, 2))
            if first == second:
                raise OutputError(f"{first} is among the inputs twice; give each frame once")
            raise OutputError(
                f"{first} and {second} would both be written as {out}/{name}; "
                "resolve them into folders of their own, one command each"
            )
        met.add(name)
    return names


def prepare_output(
    out: Path, names: Collection[str], document: Mapping[str, Any], /, *, settings: ResolveSettings, arriving: bool
) -> bool:
    """Make sure that a run loses nothing in its folder, which it holds the lock of; return whether it goes on with another.

    With inputs still `arriving`, only those that are there can be compared.

    Raises:
        OutputError: the folder holds files of a run, and neither `overwrite` nor `resume` is set; or the run to be resumed was
            another one.
    """
    there = would_be_replaced(out, names)
    if settings.resume and there:
        _require_same_run(out, document, there, arriving=arriving)
    elif settings.overwrite:
        # what it says is not true of the maps to come; once they are there it would be believed
        try:
            (out / FRAMES_FILE).unlink(missing_ok=True)
            sync_folder(out)
        except OSError as error:
            raise write_error(out / FRAMES_FILE, error) from error
    else:
        require_nothing_replaced(out, names)
    if settings.overwrite or settings.resume:
        remove_partial_files(out, token="*")
    return settings.resume and bool(there)


def require_nothing_replaced(out: Path, names: Collection[str], /) -> None:
    """Raise OutputError where a run would replace files."""
    if there := would_be_replaced(out, names):
        raise OutputError(
            f"{out}: {_some(there)} would be replaced; add --overwrite to replace, --resume to go on where a run "
            "stopped, or choose another folder with -o"
        )


def _some(names: Sequence[str]) -> str:
    return f"{', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}"


def would_be_replaced(out: Path, named: Collection[str], /) -> list[str]:
    """Return the files in a run's folder that the run would replace."""

    def would_be(path: str) -> bool:
        stem, _, suffix = path.rpartition(".")
        return suffix in MAP_FORMATS and (stem in named or re.sub(_PLACE_IN_STACK, "", stem) in named)

    folders = {out / name.rpartition("/")[0] for name in named if "/" in name} | {out}
    present = (path for folder in folders if folder.is_dir() for path in folder.iterdir())
    names = (path.relative_to(out).as_posix() for path in present)
    return sorted(name for name in names if name in {RUN_FILE, FRAMES_FILE} or would_be(name))


def _require_same_run(out: Path, document: Mapping[str, Any], there: Sequence[str], *, arriving: bool) -> None:
    path = out / RUN_FILE
    if not is_there(path):
        raise OutputError(
            f"{out}: cannot resume: found {_some(there)} and no {RUN_FILE}, so nothing tells what was resolved and how; "
            "add --overwrite, or choose another folder with -o"
        )
    try:
        earlier = read_record(out)
        before = _what_decides_maps(earlier)
        # by it the lines of its frames are known
        Path(earlier["arguments"]["out"])
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise OutputError(f"{path}: not the record of a run, so it cannot be resumed ({error})") from error
    now = _what_decides_maps(json.loads(json.dumps(document, default=str)))
    if arriving:
        del now[_INPUTS], now[_FOLDERS]
        now = {name: value for name, value in now.items() if name in before}
    for name, value in now.items():
        if before.get(name) != value:
            raise OutputError(
                f"{path}: cannot resume: {name} was {before.get(name)!r} and is {value!r} now; "
                "give the same options, or --overwrite"
            )


def _what_decides_maps(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what decides the maps of a run, by the names it has for a user: inputs, options, metadata, calibration."""
    captures = document["captures"]
    deciding: dict[str, Any] = {"version of cadtof": document["cadtof"]}
    deciding[_FOLDERS] = [capture.get("resolved_root") for capture in captures]
    arguments = document["arguments"]
    deciding |= {name: value for name, value in arguments.items() if name not in _CHANGES_NO_MAP}
    deciding["digest of the calibration"] = (document["calibration"] or {}).get("digest")
    for capture in captures:
        for table, keys in capture["metadata"].items():
            deciding |= {f"{capture.get('resolved_root')}: {table}.{key}": value for key, value in keys.items()}
    return deciding
