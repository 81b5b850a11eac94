"""What a user can choose about resolving; one frozen record that checks itself."""

import math
from dataclasses import dataclass
from typing import Literal

from cadtof_cli.errors import SettingsError

Solver = Literal["two-path", "one-path"]
Order = Literal["auto", "1", "2"]
Return = Literal["first", "strongest", "last"]

SOLVERS: tuple[Solver, ...] = ("two-path", "one-path")
ORDERS: tuple[Order, ...] = ("auto", "1", "2")
RETURNS: tuple[Return, ...] = ("first", "strongest", "last")


@dataclass(frozen=True, kw_only=True)
class ResolverSettings:
    """How phasors become paths.

    Attributes:
        solver: `two-path` in closed form, or `one-path` maximum likelihood.
        order: how many paths a pixel has: decided by the order test (`auto`), always one, or always two.
        false_alarm: probability that noise alone passes for a signal, or for a second path.
        returns: which path is called direct.
        min_return_ratio: least amplitude of a direct path, as a share of the strongest path's.
        min_confidence_v: pixels with a smaller first phasor, in V, have no answer; None: those with no signal above the noise.
    """

    solver: Solver = "two-path"
    order: Order = "auto"
    false_alarm: float = 0.01
    returns: Return = "first"
    min_return_ratio: float = 0.1
    min_confidence_v: float | None = None

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("--solver", self.solver, SOLVERS),
            ("--order", self.order, ORDERS),
            ("--return", self.returns, RETURNS),
        ):
            if value not in allowed:
                raise SettingsError(f"{name}: found {value!r}, expected one of {', '.join(allowed)}")
        if not 0.0 < self.false_alarm < 1.0:
            raise SettingsError(f"--false-alarm: found {self.false_alarm}, expected a probability between 0 and 1")
        if not 0.0 <= self.min_return_ratio <= 1.0:
            raise SettingsError(f"--min-return-ratio: found {self.min_return_ratio}, expected 0 to 1")
        least = self.min_confidence_v
        if least is not None and not (math.isfinite(least) and least >= 0.0):
            raise SettingsError(f"--min-confidence: found {least}, expected a voltage, 0 or more")
        if self.solver == "one-path" and self.order == "2":
            raise SettingsError("--solver one-path cannot give --order 2: use --solver two-path, or leave --order out")

    @property
    def max_paths(self) -> int:
        """The most paths that a pixel may get."""
        return 1 if self.solver == "one-path" or self.order == "1" else 2
