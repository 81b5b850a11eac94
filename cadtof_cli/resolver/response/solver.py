"""One or two paths for channel pairs whose response is no pure sine, by the exact equations of the response."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, SomePixels
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.paths import Fit, Paths
from cadtof_cli.resolver.response.one_path import one_path_of_response
from cadtof_cli.resolver.response.table import ResponseBlock
from cadtof_cli.resolver.response.two_paths import two_paths_of_response
from cadtof_cli.resolver.response.uncertainty import response_sigmas
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.closed_form import TwoPaths, fundamental_frame, is_single
from cadtof_cli.resolver.two_path.one_path import OnePath, one_path
from cadtof_cli.resolver.two_path.solver import fit_of_two

ORDER_TEST_STEPS = 2
"""Gauss–Newton steps of the one-path fit if the order test or two paths follow."""

ONE_PATH_STEPS = 6
"""Gauss–Newton steps of the one-path fit if the settings allow one path only."""

SURELY_MORE = 18.0
"""If the misfit of one path exceeds the threshold by this factor, the pixel surely has two paths, whatever they do to the
direct one. The closed form draws this line at 7 to 18 times the threshold (`may_be_one_path`), for differences of phases
and of moduli."""


class FullResponse:
    """The solver for a block of phasors, complex128 (2, n), and the response of the same pixels.

    Its iterations start from the answers of the closed form.

    The order test compares fits with the full response, because with a pure sine, a triangle's third harmonic looks
    like a second path.
    """

    def __init__(
        self,
        phasors: Complex,
        /,
        *,
        noise: NoiseModel,
        settings: ResolverSettings,
        response: ResponseBlock,
        **_others: object,
    ) -> None:
        self._phasors, self._noise, self._response = phasors, noise, response
        self._always_two = settings.order == "2"
        steps = ONE_PATH_STEPS if settings.max_paths == 1 else ORDER_TEST_STEPS
        self._frame = fundamental_frame(*phasors)
        self.modulus, self.powers = self._frame.u, self._frame.powers
        self._alone: OnePath = one_path_of_response(
            one_path(self._frame, noise=noise, steps=1), phasors, response=response, noise=noise, steps=steps
        )

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[SomePixels, Fit]:
        """Fit one or two paths (see `Solver`)."""
        if count == 1:
            surely_more = False if limit is None else self._alone.chi_squared > SURELY_MORE * limit
            chosen = np.flatnonzero(pixels & ~np.asarray(surely_more))
            return chosen, self._alone.fit()[chosen]
        single = is_single(self._frame) & self._always_two
        in_two = pixels & ~single
        two, converged = two_paths_of_response(
            self._alone, self._phasors, in_two, response=self._response, noise=self._noise
        )
        fit = fit_of_two(self._with_sigmas(two, in_two), two.sin_half, converged)
        if single.any():
            in_one = np.flatnonzero(single)
            fit[in_one] = self._alone.fit()[in_one]
        return slice(None), fit

    def _with_sigmas(self, two: TwoPaths, pixels: Bool) -> Paths:
        """Return two paths, with standard deviations in some pixels; infinite in all other pixels."""
        phase_rad, sigma_rad = two.phases(), np.full(two.amplitude.shape, np.inf)
        sigma_rad[:, pixels] = response_sigmas(
            two.amplitude[:, pixels],
            phase_rad[:, pixels],
            response=self._response.block(pixels),
            noise=self._noise,
        )
        return Paths(two.amplitude, phase_rad, sigma_rad)


solver = FullResponse
