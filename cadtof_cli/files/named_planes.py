"""Which channel of which part of a file is which plane of a frame, where the channels have names."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, FrameLayout, NotAFrameError, harmonic_labels, plane_name

_VOLTAGE = re.compile(r"(?:H(?P<harmonic>[1-9]\d*)\.)?SC(?P<channel>[12])", re.IGNORECASE)
_PART = re.compile(r"H(?P<harmonic>[1-9]\d*)", re.IGNORECASE)


@dataclass(frozen=True)
class NamedPart:
    """One part of a file, such as all of it; its name is empty where it has none."""

    name: str
    channels: tuple[str, ...]


class Place(NamedTuple):
    """One channel of a file."""

    part: int
    channel: str


def voltage_places(parts: Sequence[NamedPart], layout: FrameLayout, *, where: str) -> list[Place]:
    """Return the places of a frame's planes in the order H1.SC1, H1.SC2, H2.SC1, …

    A channel says its harmonic itself (H2.SC1), or its part does (a part H2 with SC1 and SC2), or else the parts count
    as harmonics in their order. Harmonics are called by number or place: see `harmonic_labels`.

    Raises:
        NotAFrameError: no channel holds a voltage.
        FrameError: a harmonic or channel is missing or there twice.
    """
    found = _labelled(parts, layout, where)
    if not found:
        names = ", ".join(name for part in parts for name in part.channels)
        raise NotAFrameError(f"{where}: holds the channels {names}, expected voltages {', '.join(layout.plane_names)}")
    labels = harmonic_labels(layout.harmonics, {harmonic for harmonic, _ in found})
    wanted = [(harmonic, channel) for harmonic in labels for channel in range(1, CHANNELS + 1)]
    missing = [plane_name(*plane) for plane in wanted if plane not in found]
    if missing:
        there = ", ".join(plane_name(*plane) for plane in sorted(found))
        raise FrameError(
            f"{where}: no channel {', '.join(missing)}; found {there}, expected {', '.join(layout.plane_names)}"
        )
    return [found[plane] for plane in wanted]


def _labelled(parts: Sequence[NamedPart], layout: FrameLayout, where: str) -> dict[tuple[int, int], Place]:
    """Return the place of every voltage by harmonic label and channel."""
    by_part = _part_labels(parts, layout, where)
    found: dict[tuple[int, int], Place] = {}
    for index, part in enumerate(parts):
        for name in part.channels:
            match = _VOLTAGE.fullmatch(name)
            if match is None:
                continue
            plane = int(match["harmonic"] or by_part[index]), int(match["channel"])
            if plane in found:
                raise FrameError(f"{where}: found {plane_name(*plane)} twice, expected it once")
            found[plane] = Place(index, name)
    return found


def _part_labels(parts: Sequence[NamedPart], layout: FrameLayout, where: str) -> dict[int, int]:
    """Return the harmonic of each part whose channels leave it open."""
    matches = {i: [_VOLTAGE.fullmatch(name) for name in part.channels] for i, part in enumerate(parts)}
    open_parts = [i for i, names in matches.items() if any(match and not match["harmonic"] for match in names)]
    named = {i: match for i in open_parts if (match := _PART.fullmatch(parts[i].name))}
    if len(named) == len(open_parts):
        return {i: int(match["harmonic"]) for i, match in named.items()}
    if len(open_parts) > len(layout.harmonics):
        names = ", ".join(repr(parts[i].name) for i in open_parts)
        raise FrameError(
            f"{where}: found {len(open_parts)} parts with SC1 and SC2 ({names}), expected {len(layout.harmonics)},"
            " one a harmonic"
        )
    return {i: place for place, i in enumerate(open_parts, start=1)}
