"""Any number of paths from any harmonics of a sine: a search for the maximum of the likelihood."""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.likelihood.k_paths import found_paths, most_likely
from cadtof_cli.resolver.likelihood.mixture import Measured
from cadtof_cli.resolver.paths import Fit
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame
from cadtof_cli.resolver.two_path.one_path import one_path

SURELY_MORE = 2.0
"""If the misfit with white noise exceeds the threshold by this factor, the pixel surely has more paths. In any
direction, the noise variance of any light is at most twice that of ambient light. So the best fit with the noise of the
light that was found cannot fall below the threshold."""


class Likelihood:
    """Maximum likelihood as a solver for a block of phasors, complex128 (H, n).

    It gathers the pixels to be fitted, because that costs less than one step.
    """

    def __init__(self, phasors: Complex, /, *, noise: NoiseModel, **_others: object) -> None:
        self.measured, self.noise = Measured.of_phasors(phasors, harmonics=noise.harmonics), noise
        self.powers = [re * re + im * im for re, im in zip(self.measured.re, self.measured.im, strict=True)]
        self.modulus = np.sqrt(self.powers[0])

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[Index, Fit]:
        """Fit any number of paths (see `Solver`)."""
        chosen: Index = np.flatnonzero(pixels)
        if limit is None:
            found, _ = found_paths(self.measured[chosen], count, noise=self.noise[chosen])
        else:
            most = np.broadcast_to(SURELY_MORE * limit, pixels.shape)
            chosen = chosen[~surely_more_paths(self.measured[chosen], count, most=most[chosen], noise=self.noise)]
            found, misfit = found_paths(self.measured[chosen], count, noise=self.noise[chosen])
            maybe = np.flatnonzero(misfit <= most[chosen])
            chosen, found = chosen[maybe], found[maybe]
        return chosen, most_likely(self.measured[chosen], found, noise=self.noise[chosen]).fit()


solver = Likelihood


def surely_more_paths(measured: Measured, count: int, /, *, most: Float, noise: NoiseModel) -> Bool:
    """Return True where one path leaves a misfit above `most`, (n,), in the first two harmonics alone; without a search.

    The misfit of all harmonics is at least that of the first two. The fit is `one_path` without a step. It is exact to
    first order in the noise, and the factor `SURELY_MORE` covers the rest.
    """
    if count > 1 or measured.harmonics[:2] != (1, 2):
        return np.zeros(most.size, np.bool_)
    fit = one_path(fundamental_frame(*measured.phasors(2)), noise=replace(noise, each=noise.each[:2]), steps=0)
    return np.asarray(fit.chi_squared > most)
