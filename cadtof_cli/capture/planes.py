"""Files of one plane each, which a pattern of their names groups into frames."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

from cadtof_cli.capture.checks import InvalidValueError
from cadtof_cli.capture.frames import FrameSource
from cadtof_cli.capture.metadata import Layout
from cadtof_cli.files.frames import CHANNELS, harmonic_labels
from cadtof_cli.files.reading import natural_key

_CHANNEL_NAMES = tuple(str(channel) for channel in range(1, CHANNELS + 1))

ONLY_FRAME = "frame"
"""Name of the one frame of a capture whose pattern has no {frame}."""

_ANY_WORD = r"[^/]+"
"""Text that {frame} can stand for."""


def grouped_planes(
    root: Path, names: Iterable[str], layout: Layout, harmonics: tuple[int, ...]
) -> tuple[FrameSource, ...]:
    """Return a frame for every value of {frame} among the file names that fit the pattern, in natural order.

    If a file is missing, its frame names it all the same: this frame fails when it is read, and the other frames do
    not. Without {frame} in the pattern, there is one frame with the name `frame`. If the layout does not name harmonics
    and channels, {harmonic} is the number h or the place in the order (see `harmonic_labels`), and {channel} is 1 for
    SC1 and 2 for SC2.

    Raises:
        MetadataError: `layout.harmonic` has no name for one of the harmonics.
    """
    channels = layout.channel or _CHANNEL_NAMES
    parts = {"frame": _ANY_WORD, "channel": "|".join(map(re.escape, channels)), "harmonic": r"[1-9]\d*"}
    if layout.harmonic is not None:
        parts["harmonic"] = "|".join(re.escape(name) for name, _ in layout.harmonic)
    pieces = _pieces(layout)
    matcher = _matcher(pieces, parts)
    matches = [match.groupdict() for name in names if (match := matcher.fullmatch(name))]
    called = _harmonic_names(layout, harmonics, {match["harmonic"] for match in matches})

    def path(frame: str, harmonic: str, channel: str) -> Path:
        values = {"frame": frame, "harmonic": harmonic, "channel": channel}
        return root / "".join(values[piece] if place % 2 else piece for place, piece in enumerate(pieces))

    return tuple(
        FrameSource(frame, tuple(path(frame, harmonic, channel) for harmonic in called for channel in channels))
        for frame in sorted({match.get("frame", ONLY_FRAME) for match in matches}, key=natural_key)
    )


def hint_of_words(names: Iterable[str], layout: Layout, /) -> str | None:
    """Return a hint if a file name fits the pattern except for its words for harmonic and channel, else None."""
    matcher = _matcher(_pieces(layout), dict.fromkeys(("frame", "harmonic", "channel"), _ANY_WORD))
    name = next(filter(matcher.fullmatch, names), None)
    if name is None:
        return None
    harmonics = "1, 2, …" if layout.harmonic is None else ", ".join(word for word, _ in layout.harmonic)
    return (
        f"{name} would fit if --harmonic and --channel listed the words in it; now {{harmonic}} stands for {harmonics} and "
        f"{{channel}} for {' or '.join(layout.channel or _CHANNEL_NAMES)}"
    )


def _pieces(layout: Layout) -> list[str]:
    """Return the pieces of the pattern: fixed texts at even places, `frame`, `harmonic` or `channel` at odd ones."""
    return re.split(r"\{(frame|harmonic|channel)\}", str(layout.pattern))


def _matcher(pieces: Sequence[str], parts: Mapping[str, str]) -> re.Pattern[str]:
    """Return the regular expression for file names; `parts` gives the expression for each name in braces."""
    return re.compile(
        "".join(f"(?P<{piece}>{parts[piece]})" if place % 2 else re.escape(piece) for place, piece in enumerate(pieces))
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
