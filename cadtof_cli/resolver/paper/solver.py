"""Two paths the paper's way, by Eq. (9); one path, which Eq. (9) cannot tell, by maximum likelihood."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.likelihood.k_paths import fisher_fit
from cadtof_cli.resolver.likelihood.solver import Likelihood
from cadtof_cli.resolver.paper.shares import two_shares
from cadtof_cli.resolver.paper.starts import RandomStarts
from cadtof_cli.resolver.paths import Fit
from cadtof_cli.resolver.settings import ResolverSettings


class PaperWay:
    """Eq. (9) as a solver."""

    def __init__(self, phasors: Complex, noise: NoiseModel, settings: ResolverSettings, first: int, /) -> None:
        self._likelihood, self._settings = Likelihood(phasors, noise), settings
        self._first = first
        self.modulus, self.powers = self._likelihood.modulus, self._likelihood.powers

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[Index, Fit]:
        """Fit one or two paths (see `Solver`)."""
        if count == 1:
            return self._likelihood.fit(count, pixels, limit=limit)
        chosen = np.flatnonzero(pixels)
        measured = self._likelihood.measured[chosen]
        two = two_shares(
            measured.re + 1j * measured.im,
            harmonics=measured.harmonics,
            places=chosen + self._first,
            starts=RandomStarts(self._settings.starts, self._settings.seed),
        )
        likely = fisher_fit(measured, two.paths, converged=two.converged, noise=self._likelihood.noise)
        return chosen, likely.fit()


def solver(
    phasors: Complex, /, *, noise: NoiseModel, settings: ResolverSettings, response: None, first: int
) -> PaperWay:
    """Return the solver for a block of phasors, complex128 (H, n), whose first pixel has the flat index `first`."""
    del response
    return PaperWay(phasors, noise, settings, first)
