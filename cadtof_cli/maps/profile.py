"""Maps along a line: what a cross-section holds."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float, Index


@dataclass(frozen=True, eq=False)
class Curve:
    """A layer of one map along the line, (n,) each: values, standard deviations, and the first phasor's; None: not known."""

    name: str
    values: Float
    sigma: Float | None = None
    first_phasor: Float | None = None


@dataclass(frozen=True, eq=False)
class Profile:
    """Maps along a line.

    Attributes:
        layer: whose values they are.
        unit: of the values.
        line: where it is, in words.
        axis: what the distance along it is: `row`, `column`, or `along the line`.
        rows, columns: of its pixels, (n,) each.
        depth: what depths are, in words.
        curves: one or more.
        truth: what is true along the line, (n,); None where that is not known.
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
