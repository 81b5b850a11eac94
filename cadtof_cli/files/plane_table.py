"""Finds the frame, harmonic and channel of every plane of a file, from names and from the axes of the file."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import plane_name
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, FrameLayout, harmonic_labels
from cadtof_cli.files.named_planes import EXAMPLE_PATTERN, PlaneLabel, plane_labels, planes_in_order
from cadtof_cli.units import counted

_CHANNEL_LABELS = "CS"

_ONE_PLANE_PER_FILE = (
    f'; if each plane has a file of its own, give their names by [layout] pattern, such as "{EXAMPLE_PATTERN}"'
)


def plane_table(
    labels: str, sizes: Sequence[int], layout: FrameLayout, *, where: str, names: Sequence[str] = ()
) -> NDArray[np.intp]:
    """Return the index of the plane, in the order of the file, that holds each frame, harmonic and channel, (T, H, C).

    If names give labels, the labels decide, not the order.

    Args:
        labels: labels of the file's axes besides Y and X, slowest first: T frame, H harmonic, C or S channel; other
            labels have no meaning.
        sizes: lengths of these axes.
        layout: harmonics of the capture, and the number of frames in a stack if the metadata gives it.
        where: the file and what was found in it, as the beginning of a message.
        names: names of the planes, an empty text for a plane without a name.

    Raises:
        FrameError: the planes do not make up whole frames, or their order is ambiguous.
    """
    named = plane_labels(names, layout, where=where)
    if not named:
        return _table_by_order(labels, sizes, layout, where)
    if math.prod(sizes) == layout.planes:
        named = _with_harmonics_counted(named, layout)
    if all(None not in label for label in named.values()):
        return _table_by_names(named, layout, where)
    return _reordered(_table_by_order(labels, sizes, layout, where), named, layout, where)


def _with_harmonics_counted(named: dict[int, PlaneLabel], layout: FrameLayout) -> dict[int, PlaneLabel]:
    """Return the labels of the planes of one frame, with harmonics added if the labels give only channels.

    The n-th plane of a channel then belongs to the n-th harmonic.
    """
    channels = [label.channel for label in named.values()]
    as_many = all(channels.count(channel) == len(layout.harmonics) for channel in range(1, CHANNELS + 1))
    if not as_many or any(label.harmonic for label in named.values()):
        return named
    left = {channel: iter(layout.harmonics) for channel in channels}
    return {place: PlaneLabel(next(left[label.channel]), label.channel) for place, label in named.items()}


def _table_by_names(named: dict[int, PlaneLabel], layout: FrameLayout, where: str) -> NDArray[np.intp]:
    """Return the table of planes that all have complete labels. Of equal labels, the n-th belongs to frame n."""
    found: dict[tuple[int, int], list[int]] = {}
    for place, (harmonic, channel) in named.items():
        found.setdefault((harmonic or 0, channel or 0), []).append(place)
    planes = planes_in_order(found, layout, where=where)
    # the message is about the name that is unlike the others
    (count, _), *_ = Counter(map(len, planes)).most_common(1)
    for plane, places in found.items():
        if places in planes and len(places) != count:
            raise FrameError(
                f"{where}: {len(places)} of them are named {plane_name(*plane)}, expected each name once per frame"
            )
    if layout.frames not in (None, count):
        raise FrameError(f"{where}: found {count} planes of each name, expected layout.frames = {layout.frames}")
    return np.array(planes, np.intp).T.reshape(count, len(layout.harmonics), CHANNELS)


def _reordered(
    table: NDArray[np.intp], named: dict[int, PlaneLabel], layout: FrameLayout, where: str
) -> NDArray[np.intp]:
    """Return the table with each plane at the channel or harmonic of its label; a label may give only one of both."""
    labels = harmonic_labels(layout.harmonics, {label.harmonic for label in named.values() if label.harmonic})
    ordered = np.full_like(table, -1)
    for frame, harmonic, channel in np.ndindex(table.shape):
        place = int(table[frame, harmonic, channel])
        label = named.get(place, PlaneLabel(None, None))
        if label.harmonic is not None and label.harmonic not in labels:
            raise FrameError(f"{where}: found a plane of harmonic {label.harmonic}, expected {list(labels)}")
        at_harmonic = harmonic if label.harmonic is None else labels.index(label.harmonic)
        ordered[frame, at_harmonic, channel if label.channel is None else label.channel - 1] = place
    if (ordered < 0).any():
        raise FrameError(
            f"{where}: found two planes whose names mean the same plane, expected {_names(layout)} once per frame"
        )
    return ordered


def _table_by_order(labels: str, sizes: Sequence[int], layout: FrameLayout, where: str) -> NDArray[np.intp]:
    """Return the table that follows from the axes, without any names."""
    total = math.prod(sizes)
    count = _frame_count(total, layout, where)
    axes = [(label, size) for label, size in zip(labels, sizes, strict=True) if size != 1]
    order = _frame_order(axes, count, layout)
    if order is None:
        found = " ".join(f"{label}={size}" for label, size in axes)
        raise FrameError(
            f"{where} in axes {found}, expected {layout.planes} planes per frame in the order {_names(layout)}"
            f"{_advice(total, layout)}"
        )
    planes = np.arange(total).reshape([size for _, size in axes]).transpose(order)
    return planes.reshape(count, len(layout.harmonics), CHANNELS)


def _names(layout: FrameLayout) -> str:
    return ", ".join(layout.plane_names)


def _advice(total: int, layout: FrameLayout) -> str:
    count, rest = divmod(total, layout.planes)
    if rest or not count or layout.frames == count:
        return ""
    if layout.frames is not None:
        own = "move such files into a folder of their own, with its own capture.toml"
        return f"; this may be {counted(count, 'frame')}: correct it (--stack-frames {count}), or {own}"
    if count < 2:
        return ""
    return f"; if this is a stack of {count} frames, say so: --stack-frames {count}, or frames = {count} under [layout]"


def _frame_count(total: int, layout: FrameLayout, where: str) -> int:
    """Return how many frames the planes make up."""
    count, rest = divmod(total, layout.planes)
    if layout.frames is not None and total != layout.frames * layout.planes:
        raise FrameError(
            f"{where}, expected {layout.frames * layout.planes}: layout.frames = {layout.frames} frames of"
            f" {layout.planes} planes ({_names(layout)}){_advice(total, layout)}"
        )
    if rest or not count:
        raise FrameError(
            f"{where}, expected {layout.planes} for one frame ({_names(layout)}), two for each of modulation.periods_ns, or a "
            f"whole multiple for a stack{_ONE_PLANE_PER_FILE if total == 1 else ''}"
        )
    return count


def _frame_order(axes: list[tuple[str, int]], count: int, layout: FrameLayout) -> list[int] | None:
    """Return the indices of the axes in the order frame, harmonic, channel; None: the order is ambiguous.

    Labels decide first: C or S (samples) of length 2 is the channel, T of the right length is the frame. The other axes
    must already be in our order, because nothing else distinguishes harmonics from frames.
    """
    channel = [i for i, (label, size) in enumerate(axes) if label in _CHANNEL_LABELS and size == CHANNELS]
    if len(channel) != 1:
        channel = []
    frame = [i for i, (label, size) in enumerate(axes) if label == "T" and size == count and count > 1]
    rest = [i for i in range(len(axes)) if i not in channel + frame]
    order = frame + rest + channel
    sizes, harmonics = [axes[i][1] for i in rest], len(layout.harmonics)
    inner = [[harmonics]] if channel else [[harmonics, CHANNELS], [layout.planes]]
    wanted = [[size for size in (1 if frame else count, *tail) if size != 1] for tail in inner]
    return order if sizes in wanted or (layout.frames is not None and not frame and len(sizes) == 1) else None
