"""Orders of axes that an array of frames may have, and the numpy calls that bring it into ours."""

import itertools
from collections.abc import Sequence

from cadtof_cli.files.frames import CHANNELS

_OURS = {3: ("PYX",), 4: ("HCYX", "TPYX"), 5: ("THCYX",)}
"""Orders of axes that we read, by the number of axes.

T is the frame, H the harmonic, C the channel; P is one axis for harmonic and channel together.
"""

_NAMED = 2
"""The most orders of axes that a message names with rows first, and the most with columns first.

With two harmonics, H and C have the same length, so two orders are possible.
"""


_SHORT = 2
"""How many times longer rows and columns must be than a last axis that may hold the planes of several frames."""


def transpositions(call: tuple[str, str], shape: Sequence[int], harmonics: int, /) -> str:
    """Return, in words for a message, the calls that bring an array of this shape into our order of axes.

    The shape tells which orders of axes the array may have: rows and columns are neighbours, and each is longer than
    the number of planes in a frame. Columns may come first, as MATLAB stores them; that is considered only if the array
    would then have more columns than rows. The text is empty if the array may already be in our order, or if no frame
    can have this shape. `call` is a Python call that saves the array: the parts before and after the place of the
    transposition.
    """
    planes = CHANNELS * harmonics
    lengths = {"H": harmonics, "C": CHANNELS, "P": planes}
    if len(shape) == len("YXP") and shape[-1] % planes == 0 and _SHORT * shape[-1] < min(shape[:-1]):
        # the planes of several frames
        lengths["P"] = shape[-1]

    def may_be(axis: str, size: int) -> bool:
        return size == lengths[axis] if axis in lengths else size > planes or axis == "T"

    found = [
        (axes, tuple(axes.index(axis) for axis in ours))
        for ours in _OURS.get(len(shape), ())
        for axes in map("".join, itertools.permutations(ours))
        if ("YX" in axes or "XY" in axes) and all(map(may_be, axes, shape))
    ]
    if any(order == tuple(range(len(shape))) for _, order in found):
        return ""
    found.sort(key=lambda one: -one[0].index("X"))
    columns_first = [one for one in found if "XY" in one[0] and shape[one[0].index("X")] > shape[one[0].index("Y")]]
    rows_first = [one for one in found if "YX" in one[0]]
    return "; ".join(
        f"if its axes are {' '.join(axes).replace('P', str(lengths['P']))}: {call[0]}.transpose{order}{call[1]}"
        for axes, order in columns_first[:_NAMED] + rows_first[:_NAMED]
    )
