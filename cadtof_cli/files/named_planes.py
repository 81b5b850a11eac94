"""What the name of a channel, page, band or file says about the plane that it holds: its harmonic and its channel."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

from cadtof_cli.arrays import plane_name
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, FrameLayout, harmonic_labels

EXAMPLE_PATTERN = "{frame}_h{harmonic}_sc{channel}.tif"
"""A pattern of the names of files of one plane each, for messages."""

_PLANE = r"(?i)(?:H(?P<harmonic>[1-9]\d*))?[\s._/:-]?(?:SC(?P<channel>[12]))?"

_HARMONIC_WORD = r"(?i)(?<![a-z])h(?:arm(?:oni[a-z]+)?)?[\s._#:-]*0*([1-9]\d*)"
_CHANNEL_WORD = r"(?i)(?<![a-z])sc[\s._#:-]*0*([12])(?!\d)"
_COSINE_OR_SINE = (
    r"(?i)(?<![a-z])(?:(i|[ck]os(?:ine|inus)?|in[\s_-]?phase|real)|(q|sin(?:e|us)?|quad(?:rature)?|imag))(?![a-z])",
    r"(?i)(?<![\d.,-])(?:(0)|(90))[\s_]?(?:deg|°)(?![a-z])",
)
"""Words for the first and the second channel. The second pattern counts in names without the words of the first: it may be the
angle of a target."""

_FREQUENCY_WORD = r"(?i)(?<![\d.])(\d+(?:\.\d+)?)[\s_]*MHz(?![a-z])"
_PERIOD_WORD = r"(?i)(?<![\d.])(\d+(?:\.\d+)?)[\s_]*ns(?![a-z])"
_CHANNEL_BEFORE_NUMBER = rf"{_CHANNEL_WORD}[\s._/:-]*"
"""A word for the channel and the separators after it, so that SC1.25MHz is SC1 at 25 MHz, not 1.25 MHz."""

_LONGEST_NAME = 256
"""Most letters of a name; a longer text is a description."""

_ROUNDING = 0.03
"""Largest relative difference between a frequency in a name and a multiple of the fundamental that fits all of them.

Names hold rounded frequencies, such as 17 and 33 MHz.
"""

_OTHER_FREQUENCY = 0.1
"""Least relative difference between a frequency in a name and that of the capture at which the two contradict each other."""

Found = TypeVar("Found")


class PlaneLabel(NamedTuple):
    """The harmonic and the channel that a name gives for its plane; None: the name does not give it."""

    harmonic: int | None
    channel: int | None


def plane_label(name: str, /) -> PlaneLabel | None:
    """Return the label that a name such as H1.SC2, h1_sc2, H1/SC2, SC2 or H1 gives its plane; None: it gives none."""
    match = re.fullmatch(_PLANE, name.strip())
    if match is None or (match["harmonic"] is None and match["channel"] is None):
        return None
    return PlaneLabel(*(None if digits is None else int(digits) for digits in match.group("harmonic", "channel")))


def plane_labels(names: Sequence[str], layout: FrameLayout, *, where: str) -> dict[int, PlaneLabel]:
    """Return the labels that the names of a file's planes give, by the place of the name; empty if names say nothing.

    If some names are labels in our form (H1.SC2), only these count. If not, names in other words count: all must give
    harmonic and channel, or else all the channel (`SC1 A`, `I`), or else all the harmonic (`H1 A`, `50 MHz B`). What names
    give alone must be given equally often.

    Raises:
        FrameError: the names give frequencies, but not those of the capture.
    """
    ours = {place: label for place, name in enumerate(names) if (label := plane_label(name))}
    if ours or not names:
        return ours
    require_own_frequencies(names, layout, where=where)
    if whole := labels_in_words(names, layout.harmonics):
        return dict(enumerate(whole))
    channels = [channel_in_words(name) for name in names]
    if _equally_often(channels, CHANNELS):
        return {place: PlaneLabel(None, channel) for place, channel in enumerate(channels)}
    numbers = harmonics_in_words(names, layout.harmonics)
    if len(layout.harmonics) > 1 and _equally_often(numbers, len(layout.harmonics)):
        return {place: PlaneLabel(number, None) for place, number in enumerate(numbers)}
    return {}


def labels_in_words(names: Sequence[str], harmonics: Sequence[int], /) -> tuple[PlaneLabel, ...]:
    """Return the labels that names such as `sc1_h2`, `Harmonic 2, SC1`, `rec_h2_sc1.tif`, `SC1.50MHz` or `Q 20 ns` give.

    Every name must give exactly one harmonic and one channel, and every plane must be named. If not, the result is
    empty.
    """
    channels = [channel_in_words(name) for name in names]
    numbers = harmonics_in_words(names, harmonics)
    labels = tuple(
        PlaneLabel(number, channel) for number, channel in zip(numbers, channels, strict=False) if channel is not None
    )
    wanted = {PlaneLabel(number, channel) for number in set(numbers) for channel in range(1, CHANNELS + 1)}
    return labels if len(labels) == len(names) and wanted == set(labels) else ()


def _equally_often(said: Sequence[int | None], kinds: int) -> bool:
    """Return whether every name says a number, of which there are so many different ones, each equally often."""
    counts = Counter(said)
    return None not in counts and len(counts) == kinds and len(set(counts.values())) == 1


def channel_in_words(name: str, /) -> int | None:
    """Return the channel that a name gives, as SC1 or SC2 or else as cosine (I) or sine (Q); None: not exactly once."""
    number = _only(_CHANNEL_WORD, name)
    if number is not None:
        return int(number)
    found = (re.findall(pattern, name) for pattern in _COSINE_OR_SINE) if len(name) <= _LONGEST_NAME else ()
    words = next(filter(None, found), [])
    return (1 if words[0][0] else 2) if len(words) == 1 else None


def is_of_a_plane(name: str, /) -> bool:
    """Return whether a name gives a harmonic or channel in our form (H1.SC2), or a channel in another form."""
    return plane_label(name) is not None or channel_in_words(name) is not None


def says_a_harmonic(name: str, /) -> bool:
    """Return whether a text is a name that gives a harmonic: as a number, as a frequency in MHz, or as a period in ns."""
    label = plane_label(name)
    if label is not None:
        return label.harmonic is not None
    return harmonic_in_words(name) is not None or _frequency_mhz(name) is not None


def harmonics_in_words(names: Sequence[str], harmonics: Sequence[int], /) -> tuple[int, ...]:
    """Return the harmonic that each name gives: as a number, as a frequency in MHz, or as a period in ns.

    Every name must give exactly one harmonic, and every harmonic must be named. If not, the result is empty.
    """
    numbers = [harmonic_in_words(name) for name in names]
    if None not in numbers:
        found = tuple(number for number in numbers if number)
        return found if len(set(found)) == len(harmonics) else ()
    frequencies = [mhz for name in names if (mhz := _frequency_mhz(name))]
    different = sorted(set(frequencies))
    if len(frequencies) < len(names) or len(different) != len(harmonics):
        return ()
    numbers_of = dict(zip(different, harmonics, strict=True))
    fundamental = sum(different) / sum(harmonics)
    in_ratio = all(abs(one - number * fundamental) < _ROUNDING * one for one, number in numbers_of.items())
    return tuple(numbers_of[one] for one in frequencies) if in_ratio else ()


def require_own_frequencies(names: Sequence[str], layout: FrameLayout, *, where: str) -> None:
    """Raise FrameError if names give as many frequencies or periods as the capture has harmonics, but others."""
    if layout.period_ns is None or all(map(harmonic_in_words, names)):
        return
    expected = [1e3 * harmonic / layout.period_ns for harmonic in layout.harmonics]
    given = [_frequency_mhz(name) for name in names]
    found = sorted({mhz for mhz in given if mhz})
    if None in given or len(found) != len(expected):
        return
    if any(abs(one - own) > _OTHER_FREQUENCY * own for one, own in zip(found, expected, strict=True)):
        here, there = (", ".join(f"{mhz:.4g}" for mhz in several) for several in (found, expected))
        raise FrameError(
            f"{where}: found planes named by {here} MHz, expected {there} MHz as of modulation.periods_ns: correct periods_ns "
            "(--periods-ns), or the names"
        )


def _frequency_mhz(name: str) -> float | None:
    """Return the frequency in MHz that a name gives, directly or by a period in ns; None: it gives none."""
    without_channel = re.sub(_CHANNEL_BEFORE_NUMBER, " ", name) if len(name) <= _LONGEST_NAME else name
    frequency, period = (_only(word, without_channel) for word in (_FREQUENCY_WORD, _PERIOD_WORD))
    if frequency is not None:
        return float(frequency)
    return 1e3 / float(period) if period is not None and float(period) > 0.0 else None


def harmonic_in_words(name: str, /) -> int | None:
    """Return the harmonic in a name such as `H2 A` or `rec_h2.tif`; None: not exactly once."""
    number = _only(_HARMONIC_WORD, name)
    return int(number) if number is not None else None


def _only(word: str, name: str) -> str | None:
    """Return the number in the only match of the pattern `word` in a name; None: no match, or several."""
    found = re.findall(word, name) if len(name) <= _LONGEST_NAME else []
    return found[0] if len(found) == 1 else None


def planes_in_order(found: Mapping[tuple[int, int], Found], layout: FrameLayout, *, where: str) -> list[Found]:
    """Return the values of `found`, keyed by harmonic and channel, in the order H1.SC1, H1.SC2, H2.SC1, …; all must be there.

    Files name a harmonic by its number or by its place: see `harmonic_labels`.
    """
    labels = harmonic_labels(layout.harmonics, {harmonic for harmonic, _ in found})
    wanted = [(harmonic, channel) for harmonic in labels for channel in range(1, CHANNELS + 1)]
    missing = [plane_name(*plane) for plane in wanted if plane not in found]
    if missing:
        there = ", ".join(plane_name(*plane) for plane in sorted(found))
        raise FrameError(
            f"{where}: no channel {', '.join(missing)}; found {there}, expected {', '.join(layout.plane_names)}"
        )
    return [found[plane] for plane in wanted]
