"""Finds captures and their frames in the folders and files that a command was given, by names alone.

The content of a file is checked only when the file is read. So a bad file fails alone, and 2,000 files are listed in
milliseconds.
"""

import functools
import itertools
import os
import stat
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cadtof_cli.capture.checks import InvalidValueError
from cadtof_cli.capture.frames import TRUTH, Capture, FrameFileList, FrameSource
from cadtof_cli.capture.metadata import Layout
from cadtof_cli.capture.no_frames import expected_names, first_names, no_frames
from cadtof_cli.capture.planes import grouped_planes
from cadtof_cli.capture.toml import FILE_NAME, MetadataSource, load_metadata, nearest_settings
from cadtof_cli.errors import CaptureError, UnlistedError
from cadtof_cli.files.formats import FRAME_SUFFIXES, frame_suffixes
from cadtof_cli.files.reading import absolute, entries_of, natural_key
from cadtof_cli.files.system import common_folder, path_from

OUTPUT_FILES = frozenset({"run.json", "dark.toml", "response.toml", "petzval.toml"})
"""Files that mark a folder of maps, or a calibration: no file in it or below it is a recorded frame."""

OnUnlisted = Callable[[Path, UnlistedError], None]
"""Called with each folder of a tree that cannot be listed; the search goes on with the other folders."""


def fail(_folder: Path, error: UnlistedError, /) -> None:
    """End the search at a folder that cannot be listed."""
    raise error


def find_captures(
    inputs: Sequence[Path],
    *,
    overrides: Mapping[str, Any] | None = None,
    settings_file: Path | None = None,
    recursive: bool = False,
    on_unlisted: OnUnlisted = fail,
) -> tuple[Capture, ...]:
    """Return the captures in folders and files.

    A folder is a capture. Its frames are its files of the formats that we read, in natural order, without hidden files,
    `truth.*` and files in folders inside it. Files that follow each other in `inputs` and share a folder are a capture
    too. The `capture.toml` of a capture is the one in its folder, or else in the nearest folder above. With
    `[layout] pattern`, files are planes, which are grouped into frames.

    A capture that is named twice is returned once. A file that is named in addition to its folder counts once.

    Args:
        inputs: folders and files.
        overrides: metadata by dotted key, which replaces the values of every `capture.toml`.
        settings_file: a `capture.toml` that is used for all captures, in place of any other.
        recursive: whether captures are also looked for in all folders below the inputs.
        on_unlisted: called with each of these folders that cannot be listed; by default, it raises the error.

    Raises:
        CaptureError: an input does not exist, cannot be listed or holds no frames, or two frames have the same name.
        MetadataError: a `capture.toml` or an override is not allowed.
    """
    # a file that describes a whole tree of captures is read once
    loaded = functools.cache(lambda file: load_metadata(file, overrides))
    source_of = functools.cache(lambda folder: loaded(settings_file or nearest_settings(folder)))
    captures: list[tuple[Capture, bool]] = []
    for (root, is_whole), group in itertools.groupby(inputs, key=lambda path: _root(path, source_of)):
        if not is_whole:
            found = [_of_files(root, source_of(root), group)]
        elif recursive:
            found = _of_tree(root, source_of, on_unlisted)
        else:
            found = [_of_folder(root, source_of, on_unlisted)]
        captures += ((one, is_whole) for one in found)
    return tuple(_each_once(captures) if len(captures) > 1 else (one for one, _ in captures))


def _each_once(captures: Sequence[tuple[Capture, bool]]) -> Iterator[Capture]:
    """Yield every capture once, without frames that another capture has. The flag says whether it is a whole folder."""
    whole = {absolute(one.root): one for one, is_whole in reversed(captures) if is_whole}
    times, seen = Counter(absolute(one.root) for one, _ in captures), set[tuple[Path, ...]]()
    for capture, _ in captures:
        root = absolute(capture.root)
        if times[root] == 1 or whole.get(root) is capture:
            yield capture
        elif root not in whole:
            files = [(root, *(path.relative_to(capture.root) for path in frame.paths)) for frame in capture.frames]
            frames = [frame for frame, its in zip(capture.frames, files, strict=True) if its not in seen]
            seen.update(files)
            if frames:
                yield replace(capture, frames=frames) if len(frames) < len(files) else capture


def placed_captures(
    captures: Sequence[Capture], inputs: Sequence[Path], /, *, base: Path | None = None
) -> tuple[tuple[Capture, ...], Path]:
    """Return captures found in `inputs`, with their frames renamed for OUT, and the folder `base` whose tree OUT mirrors.

    The name of a frame gets the path of its capture relative to that folder in front of it. If a capture lies outside
    of the folder, the steps `..` of this path are left out. By default, the folder is the deepest one that contains all
    inputs and captures.
    """
    if base is None:
        folders = [path if path.is_dir() else path.parent for path in inputs] + [one.root for one in captures]
        base = common_folder(folders)
    placed = []
    for one in captures:
        below, frames = "".join(f"{step}/" for step in steps_below(one.root, base)), one.frames
        if isinstance(frames, FrameFileList):
            frames = replace(frames, below=below)
        else:
            frames = tuple(replace(frame, name=below + frame.name) for frame in frames)
        placed.append(replace(one, frames=frames))
    return tuple(placed), base


def steps_below(root: Path, base: Path, /) -> tuple[str, ...]:
    """Return the folders from `base` to the folder of a capture, without the steps `..` of a capture that lies outside."""
    path = Path(path_from(base, root))
    return tuple(step for step in path.relative_to(path.anchor).parts if step != os.pardir)


_SourceOf = Callable[[Path], MetadataSource]
"""Returns the metadata that a folder's captures have; it looks for the `capture.toml` of each folder once."""


def is_existing_folder(path: Path, /) -> bool:
    """Return whether an input is a folder, not a file; raise CaptureError if it does not exist or cannot be reached."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise CaptureError(f"{path}: no such file or folder; expected a capture folder or a frame") from error
    except OSError as error:
        raise CaptureError(f"{path}: cannot be reached: {error.strerror}") from error
    except ValueError as error:
        # the path may be a whole list of paths with zero bytes between them
        first, zero, _ = str(path).partition("\0")
        hint = "; paths with zero bytes between them, as `find -print0` writes them, need `resolve -0`" if zero else ""
        raise CaptureError(
            f"{first}: this is not a possible file name ({error}); expected one path per line{hint}"
        ) from error


def _root(path: Path, source_of: _SourceOf) -> tuple[Path, bool]:
    """Return the folder of the capture to which an input belongs, and whether the input is that folder itself."""
    if is_existing_folder(path):
        return path, True
    depth = source_of(path.parent).metadata.layout.depth
    return (path.parent if depth == 0 else absolute(path).parents[depth]), False


def _of_files(root: Path, source: MetadataSource, files: Iterable[Path]) -> Capture:
    """Return the capture of files that were named, in this order; raise CaptureError if none is a frame."""
    whole = absolute(root)
    named = list(dict.fromkeys(absolute(path).relative_to(whole).as_posix() for path in files))
    # when a shell expands cap/*, `capture.toml` is among the named files
    found = _capture(root, source, [name for name in named if name != FILE_NAME])
    if found is None:
        raise no_frames(root, source.metadata.layout, among=named)
    return found


def _of_folder(root: Path, source_of: _SourceOf, on_unlisted: OnUnlisted) -> Capture:
    """Return the capture in a folder; raise CaptureError if it holds no frame, and name captures below it if there are any."""
    source = source_of(root)
    found = _capture(root, source, _frame_files(root, source.metadata.layout, looks_below=False))
    if found is not None:
        return found
    if below := list(_below(root, source_of, on_unlisted)):
        others = first_names(str(one.root) for one in below)
        raise CaptureError(
            f"{root}: no frames in this folder; captures below it: {others}; name one of them, or"
            " add --recursive to resolve or info"
        )
    raise no_frames(root, source.metadata.layout)


def _of_tree(root: Path, source_of: _SourceOf, on_unlisted: OnUnlisted) -> list[Capture]:
    """Return the captures in a folder and in all folders below it; raise CaptureError if there is none."""
    found = list(_below(root, source_of, on_unlisted))
    if not found:
        expected = expected_names(source_of(root).metadata.layout)
        raise CaptureError(f"{root}: no frames in it or in any folder below it: looked for {expected}")
    return found


def _below(folder: Path, source_of: _SourceOf, on_unlisted: OnUnlisted) -> Iterator[Capture]:
    """Yield the captures in a folder and in all folders below it, in the natural order of the folders' names.

    If the folder itself cannot be listed, or if there is no capture in those that can be listed, an UnlistedError is
    raised.
    """
    waiting, seen = [folder], set[str]()
    unlisted: UnlistedError | None = None
    found_any = False
    while waiting:
        here = waiting.pop()
        real = os.path.realpath(here)
        try:
            entries = entries_of(here)
            files = {name for name, is_dir in entries if not is_dir}
            if real in seen or (not OUTPUT_FILES.isdisjoint(files) and FILE_NAME not in files):
                continue
            seen.add(real)
            source = source_of(here)
            layout = source.metadata.layout
            names = _frame_files(here, layout, looks_below=True)
            found = _capture(here, source, names) if names else None
            if names and not found and not layout.depth:
                raise no_frames(here, layout)
        except UnlistedError as error:
            if here == folder:
                raise
            unlisted = unlisted or error
            on_unlisted(here, error)
            continue
        if found:
            found_any = True
            yield found
            if layout.depth:
                continue
        below = (name for name, is_dir in entries if is_dir and not name.startswith("."))
        waiting += (here / name for name in sorted(below, key=natural_key, reverse=True))
    if unlisted and not found_any:
        raise unlisted


def _frame_files(root: Path, layout: Layout, *, looks_below: bool) -> list[str]:
    """Return the names of a folder's files with the suffix of a frame, or of a plane, in natural order.

    A folder with such a name counts too, so that it is reported as a frame that fails. If captures are looked for in the
    folders below too (`looks_below`), such a folder counts only if it is empty.
    """
    suffixes = frame_suffixes(planes=layout.pattern is not None, raw=layout.raw_dtype is not None)
    names = []
    for name, is_dir in entries_of(root, layout.pattern):
        # plain strings, because making 2,000 Paths takes longer than listing the folder
        last = name.rpartition("/")[2].lower()
        stem, dot, suffix = last.rpartition(".")
        if dot + suffix not in suffixes or last.startswith(".") or stem == TRUTH:
            continue
        if not is_dir or (last.endswith(FRAME_SUFFIXES) and not (looks_below and entries_of(root / name))):
            names.append(name)
    return sorted(names, key=natural_key)


def _capture(root: Path, source: MetadataSource, names: Sequence[str]) -> Capture | None:
    """Return the capture whose files have these names below its folder; None: there is no frame."""
    layout = source.metadata.layout
    frames: Sequence[FrameSource] = FrameFileList(root, names)
    if layout.pattern is not None:
        try:
            frames = grouped_planes(root, names, layout, source.metadata.modulation.harmonics)
        except InvalidValueError as error:
            raise InvalidValueError(error.key, error.found, error.expected, source.origins[error.key]) from None
    # names without suffix can be equal only if there are different suffixes, or if a pattern makes the names
    if layout.pattern is not None or len({name.rpartition(".")[2] for name in names}) > 1:
        _require_different_names(root, frames)
    return Capture(root, source, frames) if frames else None


def _require_different_names(root: Path, frames: Sequence[FrameSource]) -> None:
    known = set[str]()
    for name in (frame.name for frame in frames):
        if name in known:
            first, second, *_ = (frame.paths[0].name for frame in frames if frame.name == name)
            raise CaptureError(
                f"{root}: {first} and {second} would both be written as {name};"
                " expected one file per frame, move one of them elsewhere"
            )
        known.add(name)
