"""What file names say: their natural order, and frame, harmonic and channel in the names of single planes."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from cadtof_cli.files.frames import CHANNELS, FrameSource, harmonic_labels

FILE_SUFFIXES = (".exr", ".tif", ".tiff")

_DIGITS = re.compile(r"(\d+)")
_GROUPS = {
    "{frame}": r"(?P<frame>.+)",
    "{harmonic}": r"(?P<harmonic>[1-9]\d*)",
    "{channel}": rf"(?P<channel>[1-{CHANNELS}])",
}


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
