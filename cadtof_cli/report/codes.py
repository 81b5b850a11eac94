"""Layers as 16-bit codes: what a page holds of them, and what that loses. `page/decode.js` reads what is written here."""

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
"""Between the codes 1 and 65534, which stand for the lowest and the highest value."""

WIDE_RATIO = 1000.0
"""Positive values other than depths that range over more than this get codes even in their logarithm."""

Codes = NDArray[np.uint16]


@dataclass(frozen=True)
class Scale:
    """What the codes of a layer stand for.

    Attributes:
        kind: `linear` and `log`: `first` plus a code less one times `step` is the value, or its natural logarithm;
            `table`: a code less one is a place in `values`.
        first: value, or logarithm, of code 1.
        step: from one code to the next.
        values: of a table.
    """

    kind: Literal["linear", "log", "table"]
    first: float = 0.0
    step: float = 0.0
    values: tuple[int, ...] = ()

    @property
    def loss(self) -> float:
        """The largest rounding: in the layer's unit, or of a `log` scale the share of the value."""
        return math.expm1(self.step / 2.0) if self.kind == "log" else self.step / 2.0

    def as_json(self) -> dict[str, Any]:
        """Return what the page has to know."""
        named = {"kind": self.kind, "first": self.first, "step": self.step}
        return {"kind": self.kind, "values": list(self.values)} if self.kind == "table" else named


def coded_values(values: NDArray[np.floating], /, *, is_depth: bool) -> tuple[Codes, Scale]:
    """Return the codes of a layer of any shape and their scale; NaN and −∞ have no answer, +∞ keeps a code of its own.

    Depths get even steps; so does what else is not positive, or ranges over a factor of `WIDE_RATIO` at most.
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
    """Return the codes of status bits of any shape, without loss: places in a table of the values that occur.

    Raises:
        ValueError: there are more different values than codes.
    """
    values, places = np.unique(status, return_inverse=True)
    if values.size > STEPS:
        raise ValueError(f"found {values.size} different values of status bits, expected {STEPS} at most")
    codes: Codes = (1 + places.reshape(status.shape)).astype(np.uint16)
    return codes, Scale("table", values=tuple(int(value) for value in values))


def packed(planes: Sequence[Codes], /) -> str:
    """Return planes of codes as text that stands in a page: base64 of one deflated stream.

    It holds, of each plane, the differences along it, high bytes first, then low bytes.
    """
    pieces = []
    for plane in planes:
        flat = plane.reshape(-1)
        differences = np.diff(flat, prepend=np.uint16(0))
        pieces += [(differences >> 8).astype(np.uint8).tobytes(), (differences & 255).astype(np.uint8).tobytes()]
    return base64.b64encode(zlib.compress(b"".join(pieces), 6)).decode("ascii")
