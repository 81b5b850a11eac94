"""What the search of Eq. (9) is told, and what it finds."""

from dataclasses import dataclass

from cadtof_cli.arrays import Bool, Float, Index


@dataclass(frozen=True, kw_only=True)
class Stopping:
    """When a start has ended, and how it begins.

    It has converged once a step promises to lower its cost by no more than `relative`·cost + `absolute`: one on its way to the
    answer lowers its cost by a share of it with every step, one that does not is in a false minimum.

    Attributes:
        max_steps: steps after which a start that has not converged is given up.
        relative: share of the cost that is not worth a step.
        absolute: cost that is not worth a step, nor another start.
        first_damping: damping of the first step, in units of the misfit.
    """

    max_steps: int = 100
    relative: float = 1e-3
    absolute: float = 1e-29
    first_damping: float = 0.5


STOPPING = Stopping()


@dataclass(frozen=True)
class Ends:
    """Where the searches of n pixels ended.

    Re z and Im z, (2, n), the cost there, (n,), which of them converged, and after how many steps.
    """

    z: Float
    cost: Float
    converged: Bool
    steps: Index
