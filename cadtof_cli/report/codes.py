"""Layers as 16-bit codes, which a page holds, and the rounding error of the codes. `page/decode.js` reads the codes."""

import base64
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float

NO_ANSWER = 0
"""The code of NaN."""

INFINITE = 65535
"""The code of infinity."""

STEPS = 65533
"""Number of steps from code 1, the lowest value, to code 65534, the highest value."""

WIDE_RATIO = 1000.0
"""A positive layer that is no depth gets codes of its logarithm if its highest value over its lowest is larger."""

Codes = NDArray[np.uint16]


@dataclass(frozen=True)
class Scale:
    """The values that the codes of a layer stand for.

    Attributes:
        kind: `linear`: the value is `first + (code - 1) * step`. `log`: this is the natural logarithm of the value.
            `table`: the value is `values[code - 1]`.
        first: value of code 1, or its logarithm.
        step: from one code to the next.
        values: of a table.
    """

    kind: Literal["linear", "log", "table"]
    first: float = 0.0
    step: float = 0.0
    values: tuple[int, ...] = ()

    @property
    def loss(self) -> float:
        """The largest rounding error: in the unit of the layer, or for a `log` scale as a share of the value."""
        return math.expm1(self.step / 2.0) if self.kind == "log" else self.step / 2.0

    def as_json(self) -> dict[str, Any]:
        """Return the scale in the form that the scripts of the page read."""
        steps = {"first": self.first, "step": self.step}
        return {"kind": self.kind, **({"values": list(self.values)} if self.kind == "table" else steps)}


def coded_values(values: NDArray[np.floating], /, *, is_depth: bool) -> tuple[Codes, Scale]:
    """Return the codes of a layer of any shape, and their scale. NaN and −∞ become `NO_ANSWER`, +∞ becomes `INFINITE`.

    Depths get steps of equal size. So do other layers, unless all values are positive and their ratio exceeds `WIDE_RATIO`.
    """
    exact: Float = values.astype(np.float64)
    finite = np.isfinite(exact)
    codes: Codes = np.where(exact == np.inf, INFINITE, NO_ANSWER).astype(np.uint16)
    known = exact[finite]
    if not known.size:
        return codes, Scale("linear")
    lowest, highest = float(known.min()), float(known.max())
    wide = not is_depth and lowest > 0.0 and highest > WIDE_RATIO * lowest
    if wide:
        known, lowest, highest = np.log(known), math.log(lowest), math.log(highest)
    step = (highest - lowest) / STEPS
    steps = np.rint((known - lowest) / step) if step > 0.0 else np.zeros(known.shape)
    codes[finite] = 1 + np.clip(steps, 0, STEPS).astype(np.uint16)
    return codes, Scale("log" if wide else "linear", lowest, step)


def coded_bits(status: NDArray[Any], /) -> tuple[Codes, Scale]:
    """Return the codes of status bits of any shape, and their scale. Codes are places in a table of values: no loss."""
    values, places = np.unique(status, return_inverse=True)
    codes: Codes = (1 + places.reshape(status.shape)).astype(np.uint16)
    return codes, Scale("table", values=tuple(int(value) for value in values))


def packed(planes: Sequence[Codes], /) -> str:
    """Return planes of codes as text for a page: one compressed stream (zlib), as base64.

    For each plane, the stream holds the differences between successive codes: first all high bytes, then all low bytes.
    """
    pieces = []
    for plane in planes:
        flat = plane.reshape(-1)
        differences = np.diff(flat, prepend=np.uint16(0))
        pieces += [(differences >> 8).astype(np.uint8).tobytes(), (differences & 255).astype(np.uint8).tobytes()]
    return base64.b64encode(zlib.compress(b"".join(pieces), 6)).decode("ascii")
