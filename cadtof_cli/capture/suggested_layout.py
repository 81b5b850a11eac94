"""The layout that the names of files suggest, if each file holds one plane and nothing says which."""

import itertools
import re
from collections.abc import Sequence
from dataclasses import replace

from cadtof_cli.capture.frames import Capture
from cadtof_cli.capture.metadata import Layout
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frame_files import read_plane
from cadtof_cli.files.frames import CHANNELS
from cadtof_cli.files.named_planes import EXAMPLE_PATTERN, channel_in_words, harmonics_in_words
from cadtof_cli.files.reading import natural_key
from cadtof_cli.records import dataclass

_PIECES = r"\d+|[^\W\d_]+|[\W_]+"

_WORDS_FOR = {
    "channel": {r"(?i)s?c|ch\w*|sin|cos|iq": 2},
    "harmonic": {r"(?i)h\w*|mhz|freq\w*": 2, r"(?i)f": 1},
}
"""Words before or after a number by which it is the number of a channel or of a harmonic, and how much each word speaks
for that; f may also be the frame."""

_FOLDERS = (
    '; with a folder for each harmonic, in the folder above them: pattern = "H{harmonic}/{frame}_sc{channel}.tif"'
)


@dataclass(frozen=True)
class _Column:
    """A position at which the names of files differ.

    Attributes:
        place: index of the piece of the names.
        values: the different texts at this position, in natural order, or in the order of the planes that they name.
        beside: the texts before and after this position.
    """

    place: int
    values: tuple[str, ...]
    beside: tuple[str, str]

    def likeness(self, what: str) -> int:
        """Return how much speaks for the values being channels, or harmonics: a word beside them, then the values.

        Values of letters are probably channels; other values, such as numbers, are probably harmonics.
        """
        letters = all(value.isalpha() for value in self.values)
        words = _WORDS_FOR[what].items()
        named = [points for form, points in words if any(re.fullmatch(form, word) for word in self.beside)]
        return max(named, default=0) + (letters == (what == "channel"))


def hint_of_planes(capture: Capture, /) -> tuple[str, Layout | None] | None:
    """Return a hint for a capture in which no whole frame was found, and the layout that the names of its files suggest.

    None unless its files seem to be planes. The layout is None if the names suggest none.
    """
    layout = capture.layout
    if capture.source.metadata.layout.pattern is not None or len(capture.frames) < layout.planes:
        return None
    path = capture.frames[0].paths[0]
    try:
        read_plane(path, layout)
    except FrameError:
        return None
    names = [frame.paths[0].name for frame in capture.frames]
    guess = layout_of_names(names, layout.harmonics, period_ns=layout.period_ns)
    keys = f'pattern = "{guess.pattern if guess else EXAMPLE_PATTERN}"'
    if guess and guess.channel:
        keys += f", channel = {list(guess.channel)}".replace("'", '"')
    if guess and guess.harmonic:
        keys += ", harmonic = { " + ", ".join(f'"{name}" = {number}' for name, number in guess.harmonic) + " }"
    hint = (
        f"{capture.root}: found {len(capture.frames)} files with one plane each, and nothing says which plane is which; write "
        f"the pattern of their names under [layout] in {capture.source.file or 'capture.toml'}, "
        f"{'probably' if guess else 'for example'}: {keys}{'' if guess else _FOLDERS}"
    )
    return hint, guess


def layout_of_names(
    names: Sequence[str], harmonics: tuple[int, ...], /, *, period_ns: float | None = None
) -> Layout | None:
    """Return the layout whose pattern fits these file names of planes; None: there is none.

    With it, every frame must have every harmonic and channel exactly once. If a number may as well be that of the frame
    as that of a harmonic or channel, the names suggest nothing. Numbers that are the modulation periods in whole ns, of
    which `period_ns` is the longest, name these.
    """
    periods = [f"{period_ns / number:.0f}" for number in harmonics] if period_ns else []
    split = [re.findall(_PIECES, name) for name in names]
    if len({len(pieces) for pieces in split}) != 1:
        return None
    columns, framed = [], ["", *split[0], ""]
    for place, pieces in enumerate(zip(*split, strict=True)):
        values = tuple(sorted(set(pieces), key=natural_key))
        if len(values) > 1:
            columns.append(_Column(place, values, (framed[place], framed[place + 2])))
    said = harmonics_in_words(names, harmonics), tuple(filter(None, map(channel_in_words, names)))
    pairs = [
        (harmonic, channel)
        for pair in itertools.permutations(columns, 2)
        if [len(column.values) for column in pair] == [len(harmonics), CHANNELS]
        for harmonic in _in_order_said(_in_order_of(periods, pair[0]), split, said[0])
        for channel in _in_order_said(pair[1], split, said[1])
    ]
    fitting = [(pair, layout) for pair in pairs if (layout := _layout(split, columns, *pair, harmonics))]
    most = max((_likeness(*pair) for pair, _ in fitting), default=0)
    likeliest = [(pair, layout) for pair, layout in fitting if _likeness(*pair) == most]
    if len({frozenset(pair) for pair, _ in likeliest}) != 1:
        return None
    # harmonics come before channels
    return min(likeliest, key=lambda one: one[0][0].place)[1]


def _in_order_of(periods: Sequence[str], column: _Column) -> _Column:
    """Return a column with its values in the order of the periods, the longest first, if they are these.

    Periods of 2 and 1 ns look like numbers of harmonics, and are taken for those.
    """
    are_periods = sorted(column.values) == sorted(periods) and "1" not in periods
    return replace(column, values=tuple(periods)) if are_periods else column


def _in_order_said(column: _Column, split: Sequence[Sequence[str]], numbers: Sequence[int]) -> tuple[_Column, ...]:
    """Return a column with its values in the order of the numbers that all names give in words, such as 40 ns before 20 ns.

    If not all names give one, it stays in natural order. If they give others than the column, nothing is returned.
    """
    if len(numbers) < len(split):
        return (column,)
    values = [pieces[column.place] for pieces in split]
    number_of = dict(zip(values, numbers, strict=True))
    if [number_of[value] for value in values] != list(numbers):
        return ()
    return (replace(column, values=tuple(sorted(column.values, key=number_of.__getitem__))),)


def _likeness(harmonic: _Column, channel: _Column) -> int:
    """Return how much speaks for two columns being harmonic and channel, and not channel and harmonic."""
    right = harmonic.likeness("harmonic") + channel.likeness("channel")
    return right - channel.likeness("harmonic") - harmonic.likeness("channel")


def _layout(
    split: list[list[str]], columns: list[_Column], harmonic: _Column, channel: _Column, harmonics: tuple[int, ...]
) -> Layout | None:
    """Return the layout with these two columns for harmonic and channel.

    None: the other columns are not a single piece of the name, or some planes are missing.
    """
    others = [column.place for column in columns if column.place not in (harmonic.place, channel.place)]
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
    by_number_or_place = harmonic.values in (
        tuple(map(str, harmonics)),
        tuple(str(place + 1) for place in range(len(harmonics))),
    )
    return Layout(
        pattern="".join(pieces),
        channel=None if channel.values == ("1", "2") else (channel.values[0], channel.values[1]),
        harmonic=None if by_number_or_place else tuple(zip(harmonic.values, harmonics, strict=True)),
    )
