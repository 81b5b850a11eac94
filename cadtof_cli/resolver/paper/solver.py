"""Two paths by Eq. (9), the method of the paper; one path by maximum likelihood, because Eq. (9) cannot give it."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index, Int64
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.rotors import Rotor, product, unit_rotor
from cadtof_cli.resolver.likelihood.k_paths import fisher_fit
from cadtof_cli.resolver.likelihood.mixture import Mixture
from cadtof_cli.resolver.likelihood.solver import Likelihood
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath, first_rotor
from cadtof_cli.resolver.paper.levenberg_marquardt import best_ends
from cadtof_cli.resolver.paper.starts import RandomStarts
from cadtof_cli.resolver.paths import Fit
from cadtof_cli.resolver.settings import ResolverSettings


class PaperWay:
    """Eq. (9) as a solver for a block of phasors, complex128 (H, n), whose first pixel has the flat index `first`."""

    def __init__(
        self, phasors: Complex, /, *, noise: NoiseModel, settings: ResolverSettings, first: int, **_others: object
    ) -> None:
        self._likelihood, self._first = Likelihood(phasors, noise=noise), first
        self._starts = RandomStarts(settings.starts, settings.seed)
        self.modulus, self.powers = self._likelihood.modulus, self._likelihood.powers

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[Index, Fit]:
        """Fit one or two paths (see `Solver`)."""
        if count == 1:
            return self._likelihood.fit(count, pixels, limit=limit)
        chosen = np.flatnonzero(pixels)
        measured = self._likelihood.measured[chosen]
        two = two_shares(
            measured.phasors(),
            harmonics=measured.harmonics,
            places=chosen + self._first,
            starts=self._starts,
        )
        likely = fisher_fit(measured, two.paths, converged=two.converged, noise=self._likelihood.noise)
        return chosen, likely.fit()


solver = PaperWay


@dataclass(frozen=True)
class TwoShares:
    """Two paths of n pixels, and the residual cost of Eq. (9), (n,): 0 where the equation is met.

    `converged` is False where the best search ran out of steps.
    """

    paths: Mixture
    cost: Float
    converged: Bool


def two_shares(phasors: Complex, /, *, harmonics: tuple[int, ...], places: Index, starts: RandomStarts) -> TwoShares:
    """Solve Eq. (9) for every pixel of phasors, complex128 (N, n), and keep the best end.

    `places` are the flat indices of the pixels in the frame, (n,). A pixel whose first phasor is 0 has no q_j: it gets
    NaN, and `converged` is False. The starts are tried one after the other. A pixel that meets its equations to
    rounding error tries no more, because no start can be better.
    """
    found = best_ends(EliminatedPath.of_phasors(phasors, harmonics=harmonics), places, starts)
    return TwoShares(_paths(found.z, *first_rotor(phasors)), found.cost, found.converged)


def steps_of_starts(phasors: Complex, /, *, harmonics: tuple[int, ...], places: Index, starts: RandomStarts) -> Int64:
    """Return the number of steps of each start of every pixel, (S, n). All starts run, as all ten do in the paper."""
    equations = EliminatedPath.of_phasors(phasors, harmonics=harmonics)
    each = (best_ends(equations, places, starts, numbers=range(one, one + 1)) for one in range(starts.count))
    return np.stack([found.steps for found in each])


def _paths(z: Float, modulus: Float, rotor: Rotor) -> Mixture:
    """Return α = z·p_1 and β = (1 − z)·p_1."""
    share, own = unit_rotor(np.stack([z[0], 1.0 - z[0]]), np.stack([z[1], -z[1]]))
    return Mixture(share * modulus, *product(own, rotor))
