"""A capture and its frames: where each frame lies, and how it is read.

A frame lies in a file of any format, in a stack, or in several files of one plane each.
"""

import functools
import itertools
import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, overload

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.toml import MetadataSource
from cadtof_cli.errors import FrameError
from cadtof_cli.files import frame_files
from cadtof_cli.files.formats import format_by_suffix
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, RawLayout, shape_text
from cadtof_cli.files.named_planes import require_own_frequencies
from cadtof_cli.records import dataclass
from cadtof_cli.units import size_text

TRUTH = "truth"
"""Name of the files of truth, without suffix; these files are no frames."""

_SIZES_COMPARED = 1000
"""The most files of a capture, spread evenly over it, whose sizes are compared to find the typical file."""

_FILES_OPENED = 15
"""The most of these files that are opened."""


@dataclass(frozen=True, slots=True)
class FrameSource:
    """Where one frame lies.

    Attributes:
        name: the name of its maps, without suffix; with slashes if the maps lie in folders.
        paths: one file, or 2·H files of one plane each in the order H1.SC1, H1.SC2, H2.SC1, …
        index: the position in a stack; None: the file is expected to hold only this frame.
    """

    name: str
    paths: tuple[Path, ...]
    index: int | None = None

    def __str__(self) -> str:
        first = self.paths[0]
        place = first if len(self.paths) == 1 else first.parent / Path(self.name).name
        return str(place) if self.index is None else f"{place}[{self.index}]"

    @property
    def file_name(self) -> str:
        """Name of the frame's first file, with the position in a stack. It does not depend on where the folder lies."""
        return f"{self.paths[0].name}{'' if self.index is None else f'[{self.index}]'}"

    def expanded(self, count: int, *, taken: Collection[str] = ()) -> tuple["FrameSource", ...]:
        """Return a source for each of the `count` frames of the stack that the file turned out to be.

        The frames are numbered with four digits. There are more digits if `count` needs them, or if a name with fewer
        digits is already in `taken`.
        """
        digits = max(4, len(str(count - 1)))
        while any(f"{self.name}_{index:0{digits}}" in taken for index in range(count)):
            digits += 1
        return tuple(replace(self, name=f"{self.name}_{index:0{digits}}", index=index) for index in range(count))


@dataclass(frozen=True)
class FrameFileList(Sequence[FrameSource]):
    """Frames of one folder, each in a file of its own. A `FrameSource` is made only when a frame is asked for.

    There may be thousands of files, so only their names are kept. `below` is the beginning of the frames' names: empty,
    or folders with a slash at the end.
    """

    folder: Path
    files: Sequence[str]
    below: str = ""

    def __len__(self) -> int:
        return len(self.files)

    @overload
    def __getitem__(self, place: int) -> FrameSource: ...
    @overload
    def __getitem__(self, place: slice) -> "FrameFileList": ...
    def __getitem__(self, place: int | slice) -> "FrameSource | FrameFileList":
        if isinstance(place, slice):
            return replace(self, files=self.files[place])
        file = self.files[place]
        return FrameSource(self.below + (file.rpartition(".")[0] or file), (self.folder / file,))


@dataclass(frozen=True)
class Capture:
    """Frames that were recorded under the same metadata.

    Attributes:
        root: the folder in which the frames lie.
        source: the metadata and the origin of each value.
        frames: where each frame lies, in the order in which the frames were recorded or given.
    """

    root: Path
    source: MetadataSource
    frames: Sequence[FrameSource]

    @functools.cached_property
    def layout(self) -> FrameLayout:
        """How the files are laid out, in the form that readers need."""
        layout = self.source.metadata.layout
        raw = None
        if layout.raw_dtype is not None and layout.raw_shape is not None:
            raw = RawLayout(layout.raw_dtype, layout.raw_shape, layout.raw_offset_bytes or 0)
        modulation = self.source.metadata.modulation
        return FrameLayout(modulation.harmonics, layout.frames, raw, modulation.periods_ns[0])

    @functools.cached_property
    def typical(self) -> "TypicalFile | None":
        """What most files of the capture hold; None: no file can be opened.

        Only a few files are opened. Files with the same number of bytes hold frames of the same size, so if more than
        half of the files have the same number of bytes, one of these is enough. If not, as with compressed files, a few
        files are opened that are spread over the capture.
        """
        compared = list(self.frames[:: -(-len(self.frames) // _SIZES_COMPARED)])
        sizes = [file_size(source.paths[0]) for source in compared]
        common, count = Counter(sizes).most_common(1)[0]
        if 2 * count > len(sizes):
            alike = (source for source, size in zip(compared, sizes, strict=True) if size == common)
            found = next(_opened(itertools.islice(alike, _FILES_OPENED), self.layout), None)
            if found is not None:
                return found
        few = compared[:: -(-len(compared) // _FILES_OPENED)]
        known = list(_opened(few, self.layout)) or list(itertools.islice(_opened(self.frames, self.layout), 1))
        if not known:
            return None
        most_common, _ = Counter(one.pixels for one in known).most_common(1)[0]
        return next(one for one in known if one.pixels == most_common)

    @functools.cached_property
    def lossy_compression(self) -> str | None:
        """Name of the compression of the typical file if it is known to change values; None: it is not, or there is none."""
        typical = self.typical
        if typical is None or typical.is_plain:
            return None
        try:
            return frame_files.lossy_compression(typical.source.paths[0], self.layout, typical.dtype)
        except FrameError:
            # whoever reads the frame gets the error
            return None


def frame_names(captures: Iterable[Capture], /) -> set[str]:
    """Return the names of all frames of the captures."""
    return {frame.name for capture in captures for frame in capture.frames}


def open_frames(source: FrameSource, layout: FrameLayout, /) -> AbstractContextManager[Frames]:
    """Open the file in which a frame lies, or its files of single planes; the context yields the frames in it.

    If there are several frames and `source.index` is None, the file is a stack, which its name did not tell.

    Raises:
        NotAFrameError: the file is undamaged but holds something else, such as a map.
        FrameError: the file cannot be read, is damaged, or lacks a harmonic or channel.
    """
    if len(source.paths) > 1:
        return nullcontext(Frames.of(_joined_planes(source, layout)))
    return frame_files.open_frames(source.paths[0], layout)


def _joined_planes(source: FrameSource, layout: FrameLayout) -> Stored:
    """Return the frame of a source with files of one plane each."""
    require_own_frequencies([path.name for path in source.paths], layout, where=str(source.paths[0]))
    for path, name in zip(source.paths, layout.plane_names, strict=True):
        if not os.path.lexists(path):
            raise FrameError(f"{path}: no such file, expected {name} of frame {source.name} there")
    planes = [frame_files.read_plane(path, layout) for path in source.paths]
    first = planes[0]
    for path, plane in zip(source.paths, planes, strict=True):
        if plane.shape != first.shape or plane.dtype != first.dtype:
            raise FrameError(
                f"{path}: found {shape_text(plane.shape, plane.dtype)}, expected"
                f" {shape_text(first.shape, first.dtype)} as in {source.paths[0].name}"
            )
    return np.stack(planes).reshape(len(layout.harmonics), CHANNELS, *first.shape)


def read_stored(source: FrameSource, layout: FrameLayout, /, *, size: tuple[int, int] | None = None) -> Stored:
    """Return the stored values of a frame, (H, C, Y, X).

    Raises:
        FrameError: see `open_frames`; or the file holds several frames and `source.index` is None; or (Y, X) of the
            frame is not `size`, which is the size of the capture's other frames.
    """
    with open_frames(source, layout) as frames:
        if source.index is None and frames.count != 1:
            raise FrameError(f"{source}: found {frames.count} frames, expected one as in files of the same size")
        if (source.index or 0) >= frames.count:
            # a stack whose frames were counted before
            raise FrameError(f"{source}: was cut off or replaced while it was read; expected a complete file")
        stored = frames.read(source.index or 0)
    found = stored.shape[2:]
    if size is not None and found != size:
        here, there = size_text(found), size_text(size)
        raise FrameError(f"{source}: found {here} pixels, expected {there} as most frames of the capture have")
    return stored


def single_frames(
    capture: Capture,
    /,
    *,
    typical: "TypicalFile | None" = None,
    taken: Callable[[], Collection[str]] | None = None,
) -> Iterator[FrameSource]:
    """Yield every frame of a capture, and every frame of its stacks.

    To open thousands of files beforehand would cost as much time as to read them. So if a file has as many bytes as a
    file with a single frame, we assume that it holds a single frame too; `read_stored` checks that. A file that cannot
    be opened is yielded as a single frame; it fails when it is read.

    Args:
        capture: its frames.
        typical: what most of its files hold, if that is known: then no file of this size need be opened.
        taken: returns names that the frames of stacks must not get, by default those of the capture's own frames. It is
            called at most once, and only if there is a stack.
    """
    layout, size_of_one = capture.layout, typical.bytes if typical and typical.frames == 1 else 0
    names: Collection[str] | None = None
    for source in capture.frames:
        size = file_size(source.paths[0]) if len(source.paths) == 1 else 0
        named = format_by_suffix(source.paths[0])
        if not size or size == size_of_one or (named and not named.stacks):
            yield source
            continue
        try:
            with open_frames(source, layout) as frames:
                count = frames.count
        except FrameError:
            yield source
            continue
        if count == 1:
            size_of_one = size
            yield source
        else:
            if names is None:
                names = taken() if taken else frame_names([capture])
            yield from source.expanded(count, taken=names)


@dataclass(frozen=True)
class TypicalFile:
    """What most files of a capture hold, and one of these files.

    Attributes:
        pixels: (Y, X) of a frame.
        dtype: type of the stored values.
        frames: number of frames in the file.
        bytes: size of the file.
        source: the file.
        is_plain: whether the file is known to hold a single frame whose values are not compressed.
    """

    pixels: tuple[int, int]
    dtype: np.dtype[Any]
    frames: int
    bytes: int
    source: FrameSource
    is_plain: bool


def _opened(sources: Iterable[FrameSource], layout: FrameLayout) -> Iterator[TypicalFile]:
    """Yield what each file holds, for the files that can be opened."""
    for source in sources:
        try:
            with open_frames(source, layout) as frames:
                height, width = frames.shape[2:]
                is_plain = frames.read_like is not None
                size = file_size(source.paths[0])
                found = TypicalFile((height, width), frames.dtype, frames.count, size, source, is_plain)
        except FrameError:
            continue
        yield found


def file_size(path: Path, /) -> int:
    """Return the size of a file in bytes; 0 if it cannot be found out."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
