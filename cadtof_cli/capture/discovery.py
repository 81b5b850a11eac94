"""Captures and their frames from the folders and files that a command was given, by name alone.

What a file holds is judged when it is read, so that a bad one fails alone and 2,000 files are listed in milliseconds.
"""

import itertools
import os
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

from cadtof_cli.capture.frame_sources import FilesAsFrames, FrameSource, grouped_planes, names_of, natural_key
from cadtof_cli.capture.toml import FILE_NAME, MetadataSource, load_metadata
from cadtof_cli.capture.tree import (
    WRITTEN_BY_US,
    absolute,
    common_folder,
    files_in,
    folders_in,
    mirrored,
    nearest_settings,
)
from cadtof_cli.errors import CaptureError
from cadtof_cli.files.formats import frame_suffixes
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.records import dataclass

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
    frames: Sequence[FrameSource]

    @property
    def layout(self) -> FrameLayout:
        """How the files are laid out, as a reader needs it."""
        metadata = self.source.metadata
        return FrameLayout(metadata.modulation.harmonics, metadata.layout.frames, metadata.layout.raw)


def find_captures(
    inputs: Sequence[Path],
    *,
    overrides: Mapping[str, Any] | None = None,
    settings_file: Path | None = None,
    recursive: bool = False,
) -> tuple[Capture, ...]:
    """Return the captures in folders and files.

    A folder is a capture: its files of the formats that we read in natural order, without hidden files, `truth.*` and what
    lies in folders within it. Files that follow each other and share a folder are a capture too. The `capture.toml` of a
    capture is the one in its folder, else the one in the nearest folder above. With `[layout] pattern`, files are planes
    and grouped into frames.

    Parameters:
        inputs: folders and files.
        overrides: metadata by dotted key that goes before any `capture.toml`.
        settings_file: a `capture.toml` that holds for all captures, in place of any other.
        recursive: whether folders within folders are looked into, all the way down.

    Raises:
        CaptureError: an input does not exist, cannot be listed, or holds no frames, or two frames share a name.
        MetadataError: a `capture.toml` or an override is not allowed.
    """
    search = _Search(overrides or {}, settings_file)
    captures: list[Capture] = []
    placed = [(path, _is_folder(path)) for path in inputs]
    for (root, is_folder), group in itertools.groupby(placed, key=search.root):
        if not is_folder:
            # a shell that expands cap/* hands over the metadata too
            names = dict.fromkeys(path.absolute().relative_to(root.absolute()).as_posix() for path, _ in group)
            source = search.source(root)
            captures.append(_capture(root, source, [name for name in names if name != FILE_NAME], among=names))
        elif recursive:
            below = list(_below(root, search))
            if not below:
                raise CaptureError(f"{root}: no frames in it or in any folder below it: looked for {_looked_for(None)}")
            captures += below
        else:
            captures.append(_in_folder(root, search))
    return tuple(captures)


def placed_below(captures: Sequence[Capture], base: Path, /) -> tuple[Capture, ...]:
    """Return the captures with their frames named as they lie below `base`: OUT gets the same tree."""
    return tuple(replace(one, frames=mirrored(one.frames, one.root, base)) for one in captures)


def base_of(inputs: Sequence[Path], captures: Sequence[Capture], /) -> Path:
    """Return the folder whose tree OUT mirrors: the deepest that all inputs and captures lie in."""
    folders = (path if path.is_dir() else path.parent for path in inputs)
    return common_folder([*folders, *(capture.root for capture in captures)])


@dataclass(frozen=True)
class _Search:
    """Where metadata come from; each `capture.toml` is looked for once."""

    overrides: Mapping[str, Any]
    settings_file: Path | None
    known: dict[Path, MetadataSource] = field(default_factory=dict)

    def source(self, folder: Path) -> MetadataSource:
        """Return the metadata of what lies in a folder."""
        if folder not in self.known:
            self.known[folder] = load_metadata(self.settings_file or nearest_settings(folder), self.overrides)
        return self.known[folder]

    def root(self, placed: tuple[Path, bool]) -> tuple[Path, bool]:
        """Return the folder that an input is, or whose capture a file belongs to, and which of the two."""
        path, is_folder = placed
        if is_folder:
            return path, True
        depth = _depth(self.source(path.parent))
        return (path.parent if depth == 0 else absolute(path).parents[depth]), False


def _depth(source: MetadataSource) -> int:
    """Return how many folders below their capture the files of planes lie."""
    return (source.metadata.layout.pattern or "").count("/")


def _in_folder(root: Path, search: _Search) -> Capture:
    source = search.source(root)
    there = files_in(root, depth=_depth(source))
    names = _images(there, source)
    if not names:
        below = [str(capture.root) for capture in _below(root, search)]
        if below:
            raise CaptureError(f"{root}: no frames in this folder; captures below it: {_some(below)}; add --recursive")
    return _capture(root, source, names, among=there)


def _below(folder: Path, search: _Search) -> Iterator[Capture]:
    """Yield the captures that a folder and those below it are, in natural order."""
    waiting, seen = [folder], set[str]()
    while waiting:
        here = waiting.pop()
        real = os.path.realpath(here)
        there = files_in(here, recursive=True)
        if real in seen or (not WRITTEN_BY_US.isdisjoint(there) and FILE_NAME not in there):
            continue
        seen.add(real)
        depth = _depth(source := search.source(here))
        names = there if depth == 0 else files_in(here, depth=depth, recursive=True)
        images = _images(names, source)
        if images and (depth == 0 or _frames(here, source, images)):
            yield _capture(here, source, images, among=names)
            if depth:
                continue
        waiting += reversed(folders_in(here))


def _is_folder(path: Path) -> bool:
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise CaptureError(f"{path}: no such file or folder; expected a capture folder or a frame") from error
    except OSError as error:
        raise CaptureError(f"{path}: cannot be reached: {error.strerror}") from error
    except ValueError as error:
        raise CaptureError(f"{path}: no file can have this name ({error}); expected a path a line") from error


def _images(names: Iterable[str], source: MetadataSource) -> list[str]:
    """Return the names of files that may be frames of such a capture, in natural order."""
    layout = source.metadata.layout
    suffixes = frame_suffixes(planes=layout.pattern is not None, raw=layout.raw is not None)
    return sorted((name for name in names if _is_image(name, suffixes)), key=natural_key)


def _is_image(name: str, suffixes: Sequence[str]) -> bool:
    # plain strings: a Path for each of 2,000 names takes longer than listing them
    last = name.rpartition("/")[2].lower()
    stem, dot, suffix = last.rpartition(".")
    return dot + suffix in suffixes and not last.startswith(".") and stem != _TRUTH


def _capture(root: Path, source: MetadataSource, names: Sequence[str], *, among: Iterable[str]) -> Capture:
    """Return the capture whose files have these names, or say why there is none."""
    frames = _frames(root, source, names)
    if not frames:
        looked_for = _looked_for(source.metadata.layout.pattern)
        raise CaptureError(f"{root}: no frames: looked for {looked_for}, found {_some(among)}")
    _require_different_names(root, frames)
    return Capture(root, source, frames)


def _frames(root: Path, source: MetadataSource, names: Sequence[str]) -> Sequence[FrameSource]:
    layout = source.metadata.layout
    if layout.pattern is None:
        return FilesAsFrames(root, names)
    return grouped_planes(root, names, layout, source.metadata.modulation.harmonics)


def _looked_for(pattern: str | None) -> str:
    if pattern is None:
        return f"{', '.join(frame_suffixes(planes=False, raw=False))} files other than {_TRUTH}.*"
    return f"files named {pattern} (layout.pattern)"


def _some(names: Iterable[str]) -> str:
    listed = sorted(names, key=natural_key)
    if not listed:
        return "nothing"
    more = len(listed) - _NAMES_IN_MESSAGE
    return ", ".join(listed[:_NAMES_IN_MESSAGE]) + (f" and {more} more" if more > 0 else "")


def _require_different_names(root: Path, frames: Sequence[FrameSource]) -> None:
    if isinstance(frames, FilesAsFrames) and len({file.rpartition(".")[2] for file in frames.files}) == 1:
        return
    known = set[str]()
    for name in names_of(frames):
        if name in known:
            first, second, *_ = (frame.paths[0].name for frame in frames if frame.name == name)
            raise CaptureError(
                f"{root}: {first} and {second} would both be written as {name};"
                " expected one file a frame, move one of them elsewhere"
            )
        known.add(name)
