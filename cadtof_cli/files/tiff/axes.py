"""The order of a TIFF's planes: from the axes that a file declares to frame, harmonic and channel."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, FrameLayout

_CHANNEL_LABELS = "CS"


def plane_table(labels: str, sizes: Sequence[int], layout: FrameLayout, *, where: str) -> NDArray[np.intp]:
    """Return which plane of a file holds each frame, harmonic and channel.

    Parameters:
        labels: the file's axes besides Y and X, slowest first: T frame, H harmonic, C or S channel, others unnamed.
        sizes: lengths of those axes.
        layout: harmonics of the capture, and frames of a stack where the metadata says it.
        where: what the file is and what was found in it, to begin a message with.

    Returns:
        Indices of planes in the order of the file, shape (T, H, C).

    Raises:
        FrameError: the planes do not make up whole frames, or their order is not certain.
    """
    total = math.prod(sizes)
    count = _frame_count(total, layout, where)
    axes = [(label, size) for label, size in zip(labels, sizes, strict=True) if size != 1]
    order = _frame_order(axes, count, layout)
    if order is None:
        found = " ".join(f"{label}={size}" for label, size in axes)
        raise FrameError(
            f"{where} in axes {found}, expected {layout.planes} planes a frame in the order {_names(layout)}"
            f"{_advice(total, layout)}"
        )
    planes = np.arange(total).reshape([size for _, size in axes]).transpose(order)
    return planes.reshape(count, len(layout.harmonics), CHANNELS)


def _names(layout: FrameLayout) -> str:
    return ", ".join(layout.plane_names)


def _advice(total: int, layout: FrameLayout) -> str:
    count, rest = divmod(total, layout.planes)
    if rest or count < 2 or layout.frames == count:
        return ""
    return f"; if this is a stack of {count} frames, set [layout] frames = {count}"


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
            f"{where}, expected {layout.planes} for one frame ({_names(layout)}), or a whole multiple for a stack"
        )
    return count


def _frame_order(axes: list[tuple[str, int]], count: int, layout: FrameLayout) -> list[int] | None:
    """Return the axes in the order frame, harmonic, channel; None where that is a guess.

    Labels decide where there are any: C, or samples S, of length 2 is the channel, T of the right length the frame.
    The rest must come in our order already, since nothing else tells harmonics from frames.
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
