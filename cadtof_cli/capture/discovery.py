"""Captures and their frames from the folders and files that a command was given, by name alone.

What a file holds is judged when it is read, so that a bad one fails alone and 2,000 files are listed in milliseconds.
"""

import itertools
import os
import stat
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

from cadtof_cli.capture.frame_sources import FrameSource, grouped_planes, natural_key
from cadtof_cli.capture.toml import FILE_NAME, MetadataSource, load_metadata
from cadtof_cli.errors import CaptureError
from cadtof_cli.files.formats import FRAME_SUFFIXES
from cadtof_cli.files.frames import FrameLayout

_TRUTH = "truth"
_NAMES_IN_MESSAGE = 5


@dataclass(frozen=True)
class Capture:
    """Frames that were recorded under the same metadata.

    Parameters:
        root: folder in which they lie.
        source: their metadata and where each value came from.
        frames: where each frame lies, in the order they were recorded or given.
    """

    root: Path
    source: MetadataSource
    frames: tuple[FrameSource, ...]

    @property
    def layout(self) -> FrameLayout:
        """How the files are laid out, as a reader needs it."""
        metadata = self.source.metadata
        return FrameLayout(harmonics=metadata.modulation.harmonics, frames=metadata.layout.frames)


def find_captures(inputs: Sequence[Path], *, overrides: Mapping[str, Any] | None = None) -> tuple[Capture, ...]:
    """Return the captures in folders and files.

    A folder is a capture: its files of the formats that we read in natural order, without hidden files, `truth.*` and what
    lies in folders within it. Files that follow each other and share a folder are a capture too, with the
    `capture.toml` beside them if there is one. With `[layout] pattern`, files are planes and grouped into frames.

    Parameters:
        inputs: folders and files.
        overrides: metadata by dotted key that goes before any `capture.toml`.

    Raises:
        CaptureError: an input does not exist, cannot be listed, or holds no frames, or two frames share a name.
        MetadataError: a `capture.toml` or an override is not allowed.
    """
    captures: list[Capture] = []
    placed = [(_place(path), path.name) for path in inputs]
    for (root, is_folder), group in itertools.groupby(placed, key=itemgetter(0)):
        there = _listed(root) if is_folder else list(dict.fromkeys(name for _, name in group))
        source = load_metadata(root / FILE_NAME if (root / FILE_NAME).exists() else None, overrides)
        # a shell that expands cap/* hands over the metadata too
        given = (name for name in there if name != FILE_NAME)
        names = sorted(filter(_is_image, there), key=natural_key) if is_folder else list(given)
        captures.append(_capture(root, source, names, among=there))
    return tuple(captures)


def _place(path: Path) -> tuple[Path, bool]:
    """Return the folder that an input is, or lies in, and which of the two."""
    try:
        is_folder = stat.S_ISDIR(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise CaptureError(f"{path}: no such file or folder; expected a capture folder or a frame") from error
    except OSError as error:
        raise CaptureError(f"{path}: cannot be reached: {error.strerror}") from error
    return (path if is_folder else path.parent), is_folder


def _listed(root: Path) -> list[str]:
    """Return the names of what lies in a folder, without the folders in it."""
    try:
        with os.scandir(root) as entries:
            return [entry.name for entry in entries if not entry.is_dir()]
    except PermissionError as error:
        raise CaptureError(f"{root}: no permission to list this folder; expected one that can be read") from error
    except OSError as error:
        raise CaptureError(f"{root}: cannot be listed: {error.strerror}") from error


def _is_image(name: str) -> bool:
    # plain strings: a Path for each of 2,000 names takes longer than listing them
    stem, dot, suffix = name.lower().rpartition(".")
    return dot + suffix in FRAME_SUFFIXES and not name.startswith(".") and stem != _TRUTH


def _capture(root: Path, source: MetadataSource, names: Sequence[str], *, among: Sequence[str]) -> Capture:
    """Return the capture whose files have these names, or say why there is none."""
    pattern = source.metadata.layout.pattern
    if pattern is None:
        frames = tuple(FrameSource(name.rpartition(".")[0] or name, (root / name,)) for name in names)
        looked_for = f"{', '.join(FRAME_SUFFIXES)} files other than {_TRUTH}.*"
    else:
        frames = grouped_planes(root, names, pattern, source.metadata.modulation.harmonics)
        looked_for = f"files named {pattern} (layout.pattern)"
    if not frames:
        raise CaptureError(f"{root}: no frames: looked for {looked_for}, found {_some(among)}")
    first: dict[str, FrameSource] = {}
    for frame in frames:
        other = first.setdefault(frame.name, frame)
        if other is not frame:
            raise CaptureError(
                f"{root}: {other.paths[0].name} and {frame.paths[0].name} would both be written as {frame.name};"
                " expected one file a frame, move one of them elsewhere"
            )
    return Capture(root, source, frames)


def _some(names: Iterable[str]) -> str:
    listed = sorted(names, key=natural_key)
    if not listed:
        return "nothing"
    more = len(listed) - _NAMES_IN_MESSAGE
    return ", ".join(listed[:_NAMES_IN_MESSAGE]) + (f" and {more} more" if more > 0 else "")
