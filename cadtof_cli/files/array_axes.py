"""Which axes an array may have that are in another order than ours, and the call of numpy that puts them right."""

import itertools
from collections.abc import Iterator, Sequence

from cadtof_cli.files.frames import CHANNELS

_OURS = {3: ("PYX",), 4: ("HCYX", "TPYX"), 5: ("THCYX",)}
"""Orders of axes that are read, by how many there are: T frame, H harmonic, C channel, P harmonic and channel as one."""

_NAMED = 2
"""Orders that are told of, rows first and columns first: with two harmonics nothing tells their axis from the channels'."""


def transpositions(call: str, shape: Sequence[int], harmonics: int, /) -> str:
    """Return the calls that bring an array into our order of axes, for the orders that it may have by its shape.

    Empty where it may be in our order, or has the shape of no frame. Rows and columns follow each other, and are more than
    the planes of a frame; where there would be more rows than columns, columns may come first, as in what MATLAB stored. `call`
    is one of Python, with `{}` where the array is transposed.
    """
    lengths = {"H": harmonics, "C": CHANNELS, "P": CHANNELS * harmonics}

    def may_be(axis: str, size: int) -> bool:
        return size == lengths[axis] if axis in lengths else size > lengths["P"] or axis == "T"

    found = [
        (axes, tuple(axes.index(axis) for axis in ours))
        for ours in _OURS.get(len(shape), ())
        for axes in _orders(ours)
        if all(map(may_be, axes, shape))
    ]
    if any(order == tuple(range(len(shape))) for _, order in found):
        return ""
    found.sort(key=lambda one: -one[0].index("X"))
    columns_first = [one for one in found if "XY" in one[0] and shape[one[0].index("X")] > shape[one[0].index("Y")]]
    rows_first = [one for one in found if "YX" in one[0]]
    planes = str(lengths["P"])
    return "; ".join(
        f"if its axes are {' '.join(axes).replace('P', planes)}, {call.format(f'.transpose{order}')} mends it"
        for axes, order in columns_first[:_NAMED] + rows_first[:_NAMED]
    )


def _orders(ours: str) -> Iterator[str]:
    return (axes for axes in map("".join, itertools.permutations(ours)) if "YX" in axes or "XY" in axes)
