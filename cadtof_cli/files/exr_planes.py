"""Finds which channel of which part of an EXR is which plane of a frame, by the names of channels and parts."""

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cadtof_cli.arrays import plane_name
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout, NotAFrameError
from cadtof_cli.files.maps import is_map_layer
from cadtof_cli.files.named_planes import (
    PlaneLabel,
    channel_in_words,
    harmonics_in_words,
    labels_in_words,
    plane_label,
    planes_in_order,
    require_own_frequencies,
)
from cadtof_cli.records import dataclass

_COLOURS = frozenset({"R", "G", "B", "A", "Y", "RY", "BY"})
"""Names of the channels of a picture: colours, opacity, luminance and chroma."""


@dataclass(frozen=True)
class NamedPart:
    """One part of a file, or the whole file, with the names of its channels; `name` is empty if it has no name."""

    name: str
    channels: tuple[str, ...]


class Place(NamedTuple):
    """One channel of a file: the index of its part, and its name."""

    part: int
    channel: str


def places_in(parts: Sequence[NamedPart], /) -> list[Place]:
    """Return the place of every channel, in the order of the file."""
    return [Place(index, name) for index, part in enumerate(parts) for name in part.channels]


def voltage_places(parts: Sequence[NamedPart], layout: FrameLayout, *, where: str) -> list[Place]:
    """Return the places of a frame's planes in the order H1.SC1, H1.SC2, H2.SC1, …

    The name of a channel gives its harmonic (H2.SC1), or the name of its part gives it (a part H2 with the channels SC1
    and SC2). If neither does, the parts are the harmonics in their order. If a part called H2.SC1 has only one channel,
    the channel may have any name. If no name has this form, names in other words are used: see `labels_in_words`.

    Raises:
        NotAFrameError: no channel holds a voltage.
        FrameError: a plane is missing or appears twice.
    """
    found = _labelled(parts, layout, where)
    if not found:
        names = [place.channel for place in places_in(parts)]
        if any(map(is_map_layer, names)):
            raise NotAFrameError(f"{where}: holds maps ({', '.join(names)}), expected voltages")
        what = "a colour picture, " if _COLOURS.issuperset(names) else ""
        raise NotAFrameError(
            f"{where}: holds {what}the channels {', '.join(names)}, expected voltages {', '.join(layout.plane_names)}"
        )
    return planes_in_order(found, layout, where=where)


def _labelled(parts: Sequence[NamedPart], layout: FrameLayout, where: str) -> dict[tuple[int, int], Place]:
    """Return the place of every plane by its harmonic label and channel."""
    places = places_in(parts)
    names = [_telling_name(parts[place.part], place.channel) for place in places]
    labels: list[PlaneLabel | None] = [plane_label(name) for name in names]
    if not any(labels):
        require_own_frequencies(names, layout, where=where)
        # a label for every name, or none at all
        labels = list(labels_in_words(names, layout.harmonics)) or labels
    named = [(place, label) for place, label in zip(places, labels, strict=True) if label and label.channel]
    open_parts = {place.part: parts[place.part].name for place, label in named if not label.harmonic}
    harmonic_of = _harmonics_of_parts(open_parts, layout, where)
    found: dict[tuple[int, int], Place] = {}
    for place, label in named:
        plane = label.harmonic or harmonic_of[place.part], label.channel or 0
        if plane in found:
            raise FrameError(f"{where}: found {plane_name(*plane)} twice, expected it once")
        found[plane] = place
    return found


def _telling_name(part: NamedPart, channel: str) -> str:
    """Return the name that says which plane a channel is: its own, or that of its part if it is the only channel there."""
    if len(part.channels) > 1 or plane_label(channel):
        return channel
    label = plane_label(part.name)
    says_more = not channel_in_words(channel) if label is None else None not in label
    return part.name if says_more else channel


def _harmonics_of_parts(names: Mapping[int, str], layout: FrameLayout, where: str) -> dict[int, int]:
    """Return the harmonic label of the parts with these names by their place; their channels say only SC1 or SC2."""
    labels = {place: label.harmonic for place, name in names.items() if (label := plane_label(name)) and label.harmonic}
    if len(labels) == len(names):
        return labels
    told = list(names.values())
    if len(told) > len(layout.harmonics):
        raise FrameError(
            f"{where}: found {len(told)} parts with SC1 and SC2 ({', '.join(map(repr, told))}), expected"
            f" {len(layout.harmonics)}, one per harmonic"
        )
    require_own_frequencies(told, layout, where=where)
    return dict(zip(names, harmonics_in_words(told, layout.harmonics) or itertools.count(1), strict=False))
