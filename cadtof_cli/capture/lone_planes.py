"""Files of one plane each, of which nothing says how they are named: the pattern that their names suggest."""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.frame_sources import natural_key
from cadtof_cli.capture.metadata import Layout
from cadtof_cli.errors import FrameError
from cadtof_cli.files.formats import format_of
from cadtof_cli.files.frames import CHANNELS

_PIECES = re.compile(r"\d+|[^\W\d_]+|[\W_]+")

_SAYS = {"channel": re.compile(r"s?c|ch\w*|sin|cos|iq", re.I), "harmonic": re.compile(r"h\w*|mhz|f|freq\w*", re.I)}
"""What stands before or behind a number that is a channel's or a harmonic's."""

SHOWN_PATTERN = "{frame}_h{harmonic}_sc{channel}.tif"


@dataclass(frozen=True)
class _Column:
    """A place in names where they differ: the different pieces there, and what stands on either side."""

    place: int
    values: tuple[str, ...]
    beside: tuple[str, str]

    def says(self, what: str) -> bool:
        """Whether it names a channel, or a harmonic, by itself (letters or numbers) or by what stands beside it."""
        letters = all(value.isalpha() for value in self.values)
        return letters == (what == "channel") or any(_SAYS[what].fullmatch(word) for word in self.beside)


def hint_of_planes(capture: Capture, /) -> str | None:
    """Return what to say of a capture none of whose files is a frame, where they seem to be planes; None where they do not."""
    layout = capture.layout
    if capture.source.metadata.layout.pattern is not None or len(capture.frames) < layout.planes:
        return None
    path = capture.frames[0].paths[0]
    try:
        format_of(path).frames().read_plane(path, layout)
    except FrameError:
        return None
    guess = guessed_layout(capture)
    keys = f'pattern = "{guess.pattern if guess else SHOWN_PATTERN}"'
    if guess and guess.channel:
        keys += f", channel = {list(guess.channel)}".replace("'", '"')
    if guess and guess.harmonic:
        keys += ", harmonic = { " + ", ".join(f'"{name}" = {number}' for name, number in guess.harmonic) + " }"
    return (
        f"{capture.root}: {len(capture.frames)} files of one plane each, and nothing says which plane is which; say how they are "
        f"named under [layout] in capture.toml{', it seems' if guess else ', such as'}: {keys}"
    )


def guessed_layout(capture: Capture, /) -> Layout | None:
    """Return the layout that the names of a capture's files suggest; None where they suggest none."""
    harmonics = capture.source.metadata.modulation.harmonics
    return layout_of_names([frame.paths[0].name for frame in capture.frames], harmonics)


def layout_of_names(names: Sequence[str], harmonics: tuple[int, ...], /) -> Layout | None:
    """Return the layout whose pattern fits file names of planes: every frame with every harmonic and channel, once."""
    split = [_PIECES.findall(name) for name in names]
    if len({len(pieces) for pieces in split}) != 1:
        return None
    columns = []
    for place, pieces in enumerate(zip(*split, strict=True)):
        values = tuple(sorted(set(pieces), key=natural_key))
        if len(values) > 1:
            near = split[0][max(place - 1, 0) : place] or [""], split[0][place + 1 : place + 2] or [""]
            columns.append(_Column(place, values, (near[0][0], near[1][0])))
    pairs = [
        (harmonic, channel)
        for harmonic, channel in itertools.permutations(columns, 2)
        if len(harmonic.values) == len(harmonics) and len(channel.values) == CHANNELS
    ]
    pairs.sort(key=_unlikely)
    return next((found for pair in pairs if (found := _layout(split, columns, *pair, harmonics))), None)


def _unlikely(pair: tuple[_Column, _Column]) -> tuple[int, bool]:
    """Return a key that sorts the likeliest columns of harmonic and channel to the front."""
    harmonic, channel = pair
    wrong = channel.says("harmonic") + harmonic.says("channel")
    return wrong - harmonic.says("harmonic") - channel.says("channel"), harmonic.place > channel.place


def _layout(
    split: list[list[str]], columns: list[_Column], harmonic: _Column, channel: _Column, harmonics: tuple[int, ...]
) -> Layout | None:
    """Return the layout with these two columns, if the others are a frame's name in one piece."""
    others = [column.place for column in columns if column not in (harmonic, channel)]
    pieces = list(split[0])
    pieces[harmonic.place], pieces[channel.place] = "{harmonic}", "{channel}"
    frames = 1
    if others:
        first, last = min(others), max(others)
        if any(first < column.place < last for column in (harmonic, channel)):
            return None
        frames = len({tuple(one[first : last + 1]) for one in split})
        pieces[first : last + 1] = ["{frame}"]
    if len(split) != frames * len(harmonics) * CHANNELS:
        return None
    usual = harmonic.values in (tuple(map(str, harmonics)), tuple(str(place + 1) for place in range(len(harmonics))))
    return Layout(
        pattern="".join(pieces),
        channel=None if channel.values == ("1", "2") else (channel.values[0], channel.values[1]),
        harmonic=None if usual else tuple(zip(harmonic.values, harmonics, strict=True)),
    )
