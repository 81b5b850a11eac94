"""Where recorded frames lie, and what file names say of it: natural order, and frame, harmonic and channel of planes."""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cadtof_cli.files.frames import CHANNELS, harmonic_labels

_DIGITS = re.compile(r"(\d+)")
_GROUPS = {
    "{frame}": r"(?P<frame>.+)",
    "{harmonic}": r"(?P<harmonic>[1-9]\d*)",
    "{channel}": rf"(?P<channel>[1-{CHANNELS}])",
}


@dataclass(frozen=True)
class FrameSource:
    """Where one frame lies.

    Parameters:
        name: stem of what is written for the frame.
        paths: one file, or 2·H files of one plane each in the order H1.SC1, H1.SC2, H2.SC1, …
        index: position in a stack; None where the file is to hold this frame alone.
    """

    name: str
    paths: tuple[Path, ...]
    index: int | None = None

    def __str__(self) -> str:
        place = str(self.paths[0]) if len(self.paths) == 1 else f"{self.paths[0].parent / self.name}"
        return place if self.index is None else f"{place}[{self.index}]"

    def expanded(self, count: int, *, taken: Collection[str] = ()) -> tuple["FrameSource", ...]:
        """Return a source for each of the `count` frames of the stack that the file turned out to be.

        They are numbered with four digits, or more where `count` needs them or another frame's name is `taken` already.
        """
        digits = max(4, len(str(count - 1)))
        while any(f"{self.name}_{index:0{digits}}" in taken for index in range(count)):
            digits += 1
        return tuple(replace(self, name=f"{self.name}_{index:0{digits}}", index=index) for index in range(count))


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Return a key that sorts frame_2 before frame_10."""
    parts = _DIGITS.split(name.casefold())
    return [int(part) if place % 2 else part for place, part in enumerate(parts)], name


def grouped_planes(
    root: Path, names: Iterable[str], pattern: str, harmonics: tuple[int, ...]
) -> tuple[FrameSource, ...]:
    """Return a frame for every value of {frame} among file names that fit the pattern, in natural order.

    A file that is missing is named all the same: its frame then fails on reading, and alone.

    Parameters:
        root: folder of the files.
        names: file names, of which those that do not fit are passed over.
        pattern: file name of one plane with {frame}, {harmonic} and {channel}; {harmonic} is the number h or the place
            in the order (see `harmonic_labels`), {channel} is 1 for SC1 and 2 for SC2.
        harmonics: harmonic numbers of the capture.
    """
    matcher = _matcher(pattern)
    matches = [match for name in names if (match := matcher.fullmatch(name))]
    labels = harmonic_labels(harmonics, {int(match["harmonic"]) for match in matches})
    return tuple(
        FrameSource(frame, _plane_paths(root, pattern, frame, labels))
        for frame in sorted({match["frame"] for match in matches}, key=natural_key)
    )


def _matcher(pattern: str) -> re.Pattern[str]:
    pieces = re.split("(" + "|".join(map(re.escape, _GROUPS)) + ")", pattern)
    return re.compile("".join(_GROUPS.get(piece) or re.escape(piece) for piece in pieces))


def _plane_paths(root: Path, pattern: str, frame: str, labels: Sequence[int]) -> tuple[Path, ...]:
    return tuple(
        root / pattern.replace("{frame}", frame).replace("{harmonic}", str(harmonic)).replace("{channel}", str(channel))
        for harmonic in labels
        for channel in range(1, CHANNELS + 1)
    )
