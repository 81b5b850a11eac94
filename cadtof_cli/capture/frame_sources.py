"""Where recorded frames lie, and what file names say of it: natural order, and frame, harmonic and channel of planes."""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import overload

from cadtof_cli.capture.metadata import InvalidValueError, Layout
from cadtof_cli.files.frames import CHANNELS, harmonic_labels
from cadtof_cli.records import dataclass

_DIGITS = re.compile(r"(\d+)")
_CHANNEL_NAMES = tuple(str(channel) for channel in range(1, CHANNELS + 1))

ONLY_FRAME = "frame"
"""Name of the one frame of a capture whose pattern has no {frame}."""


@dataclass(frozen=True, slots=True)
class FrameSource:
    """Where one frame lies.

    Parameters:
        name: of what is written for the frame, without suffix; with slashes where that lies in folders.
        paths: one file, or 2·H files of one plane each in the order H1.SC1, H1.SC2, H2.SC1, …
        index: position in a stack; None where the file is to hold this frame alone.
    """

    name: str
    paths: tuple[Path, ...]
    index: int | None = None

    def __str__(self) -> str:
        first = self.paths[0]
        place = first if len(self.paths) == 1 else first.parent / Path(self.name).name
        return str(place) if self.index is None else f"{place}[{self.index}]"

    def expanded(self, count: int, *, taken: Collection[str] = ()) -> tuple["FrameSource", ...]:
        """Return a source for each of the `count` frames of the stack that the file turned out to be.

        They are numbered with four digits, or more where `count` needs them or another frame's name is `taken` already.
        """
        digits = max(4, len(str(count - 1)))
        while any(f"{self.name}_{index:0{digits}}" in taken for index in range(count)):
            digits += 1
        return tuple(replace(self, name=f"{self.name}_{index:0{digits}}", index=index) for index in range(count))


@dataclass(frozen=True)
class FilesAsFrames(Sequence[FrameSource]):
    """Frames that are a file each, of one folder; of thousands, nothing is kept but their names.

    Parameters:
        folder: of the files.
        files: their names.
        below: what comes before the names of frames, ends with a slash where it is not empty.
    """

    folder: Path
    files: Sequence[str]
    below: str = ""

    def __len__(self) -> int:
        return len(self.files)

    @overload
    def __getitem__(self, place: int) -> FrameSource: ...
    @overload
    def __getitem__(self, place: slice) -> "FilesAsFrames": ...
    def __getitem__(self, place: int | slice) -> "FrameSource | FilesAsFrames":
        if isinstance(place, slice):
            return replace(self, files=self.files[place])
        file = self.files[place]
        return FrameSource(self._name(file), (self.folder / file,))

    def names(self) -> Iterator[str]:
        """Yield the names of the frames, without all the rest of them."""
        return map(self._name, self.files)

    def _name(self, file: str) -> str:
        return self.below + (file.rpartition(".")[0] or file)


def natural_key(name: str) -> str:
    """Return a key that sorts frame_2 before frame_10; it is one text, since thousands of them are there at once."""
    # a number by how many digits it has, then by these; what ends before a number comes before what goes on
    return f"{_DIGITS.sub(_sortable, name.casefold())}\0\0{name}"


def _sortable(number: re.Match[str]) -> str:
    digits = str(int(number.group()))
    return f"\0{len(digits):04}{digits}"


def grouped_planes(
    root: Path, names: Iterable[str], layout: Layout, harmonics: tuple[int, ...]
) -> tuple[FrameSource, ...]:
    """Return a frame for every value of {frame} among file names that fit the pattern, in natural order.

    A file that is missing is named all the same: its frame then fails on reading, and alone. Without {frame} in the pattern
    there is one frame, of the name `frame`.

    Parameters:
        root: folder of the files.
        names: file names, with folders below the root before them, of which those that do not fit are passed over.
        layout: has a pattern, and says what it calls harmonics and channels. {harmonic} is the number h or the place in the
            order (see `harmonic_labels`), {channel} is 1 for SC1 and 2 for SC2, where it does not give them other names.
        harmonics: harmonic numbers of the capture.

    Raises:
        MetadataError: `layout.harmonic` has no name for one of the harmonics.
    """
    pattern, channels = str(layout.pattern), layout.channel or _CHANNEL_NAMES
    parts = {"frame": r"[^/]+", "channel": "|".join(map(re.escape, channels)), "harmonic": r"[1-9]\d*"}
    if layout.harmonic is not None:
        parts["harmonic"] = "|".join(re.escape(name) for name, _ in layout.harmonic)
    pieces = re.split(r"\{(frame|harmonic|channel)\}", pattern)
    matcher = re.compile(
        "".join(f"(?P<{piece}>{parts[piece]})" if place % 2 else re.escape(piece) for place, piece in enumerate(pieces))
    )
    matches = [match.groupdict() for name in names if (match := matcher.fullmatch(name))]
    called = _harmonic_names(layout, harmonics, {match["harmonic"] for match in matches})

    def path(frame: str, harmonic: str, channel: str) -> Path:
        values = {"frame": frame, "harmonic": harmonic, "channel": channel}
        return root / "".join(values[piece] if place % 2 else piece for place, piece in enumerate(pieces))

    return tuple(
        FrameSource(frame, tuple(path(frame, harmonic, channel) for harmonic in called for channel in channels))
        for frame in sorted({match.get("frame", ONLY_FRAME) for match in matches}, key=natural_key)
    )


def _harmonic_names(layout: Layout, harmonics: tuple[int, ...], found: Collection[str]) -> tuple[str, ...]:
    if layout.harmonic is None:
        return tuple(map(str, harmonic_labels(harmonics, set(map(int, found)))))
    names = {number: name for name, number in layout.harmonic}
    labels = harmonic_labels(harmonics, names)
    if not set(labels) <= set(names):
        expected = f"a name for each of the harmonics {', '.join(map(str, harmonics))}"
        raise InvalidValueError("layout.harmonic", dict(layout.harmonic), expected)
    return tuple(names[label] for label in labels)
