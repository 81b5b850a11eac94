"""One or two paths from harmonics 1 and 2 of a sine: in closed form, the same work for every pixel."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, SomePixels
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.paths import CLOSE_ENOUGH, Fit, Paths
from cadtof_cli.resolver.two_path.closed_form import FundamentalFrame, fundamental_frame, two_paths
from cadtof_cli.resolver.two_path.one_path import one_path
from cadtof_cli.resolver.two_path.uncertainty import misfit_spread, two_path_sigmas

ORDER_TEST_STEPS = 0
"""Newton steps of the one-path fit before the order test. Pixels that the test accepts deviate from one path by no more
than noise, and the start of the fit is exact to first order in the noise. A step would change the scatter by less than
0.1 %."""

ONE_PATH_STEPS = 6
"""Newton steps if the settings allow one path only, because then the path may fit badly."""


class ClosedForm:
    """The closed form as a solver for a block of phasors, complex128 (2, n)."""

    def __init__(self, phasors: Complex, /, *, noise: NoiseModel, **_others: object) -> None:
        self._frame, self._noise = fundamental_frame(*phasors), noise
        self.modulus, self.powers = self._frame.u, self._frame.powers

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[SomePixels, Fit]:
        """Fit one or two paths (see `Solver`)."""
        if count == 2:
            return self._two(pixels)
        if limit is not None:
            pixels = pixels & may_be_one_path(self._frame, limit, noise=self._noise)
        chosen = np.flatnonzero(pixels)
        steps = ONE_PATH_STEPS if limit is None else ORDER_TEST_STEPS
        return chosen, one_path(self._frame[chosen], noise=self._noise, steps=steps).fit()

    def _two(self, pixels: Bool) -> tuple[SomePixels, Fit]:
        """Fit two paths. If at least half of the pixels need them, fit all, which is faster than gathering pixels."""
        everywhere = 2 * np.count_nonzero(pixels) >= pixels.size
        chosen: SomePixels = slice(None) if everywhere else np.flatnonzero(pixels)
        frame = self._frame if everywhere else self._frame[chosen]
        two = two_paths(frame)
        paths = Paths(two.amplitude, two.phases(), two_path_sigmas(two, noise=self._noise))
        fit = fit_of_two(paths, two.sin_half, np.ones(two.single.size, np.bool_))
        if two.single.any():
            fit[two.single] = one_path(frame[two.single], noise=self._noise, steps=ORDER_TEST_STEPS).fit()
        return chosen, fit


solver = ClosedForm


def fit_of_two(paths: Paths, sin_half: Float, converged: Bool, /) -> Fit:
    """Return two paths, which explain their phasors exactly, as the `Fit` of a solver.

    `sin_half`, (n,), is the sine of half the distance of the two paths. `converged`, (n,), is True where the paths are
    the answer.
    """
    doubt = np.maximum(*paths.sigma_rad) / (CLOSE_ENOUGH * sin_half)
    return Fit(paths, np.zeros(doubt.size), converged, doubt)


def may_be_one_path(frame: FundamentalFrame, limit: Float | float, /, *, noise: NoiseModel) -> Bool:
    """Return False where one path certainly leaves a χ² above the limit; no fit is needed for this.

    Let n1 and n2 be the residuals of the two phasors after the best single path. Then the modulus of |p1| − p2·conj(ρ)²
    is at most (1+π)|n1| + |n2|, because n1 turns ρ by no more than π|n1|/2a. And the noise along and across a phasor
    has at most twice the dark variance.
    """
    may: Bool = frame.d2 <= 2.0 * limit * misfit_spread(noise.each)
    return may
