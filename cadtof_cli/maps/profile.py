"""Maps along a line: the values of a cross-section."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float, Index


@dataclass(frozen=True, eq=False)
class Curve:
    """A layer of one map along the line: its values, their standard deviations, and the values by the first phasor alone.

    All are (n,); None: not known.
    """

    name: str
    values: Float
    sigma: Float | None = None
    first_phasor: Float | None = None


@dataclass(frozen=True, eq=False)
class Profile:
    """Maps along a line.

    Attributes:
        layer: name of the layer.
        unit: unit of the layer's values.
        line: where the line is, in words.
        axis: what the distance along the line is: `row`, `column`, or `along the line`.
        rows, columns: places of the line's pixels, (n,) each.
        depth: what depths are, in words.
        curves: one for each map.
        truth: the true values along the line, (n,); None if they are not known.
    """

    layer: str
    unit: str
    line: str
    axis: str
    rows: Index
    columns: Index
    depth: str
    curves: tuple[Curve, ...]
    truth: Float | None

    @property
    def along(self) -> Float:
        """Distances from the first pixel, (n,), in pixels."""
        return np.asarray(np.hypot(self.columns - self.columns[0], self.rows - self.rows[0]), np.float64)
