"""Paths of channel pairs that answer with more than a sine: decided and resolved by the exact equations of the response."""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.order import worth_another
from cadtof_cli.resolver.paths import Path, ResolvedPaths
from cadtof_cli.resolver.response.refine import refined_one_path, refined_two_paths
from cadtof_cli.resolver.response.table import ResponseBlock
from cadtof_cli.resolver.returns import direct_and_mpi
from cadtof_cli.resolver.screening import screened
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, is_single, phase_of
from cadtof_cli.resolver.two_path.one_path import one_path
from cadtof_cli.resolver.two_path.uncertainty import two_path_sigmas

REFINED_STEPS = {1: 6, 2: 2}
"""Gauss–Newton steps of the one-path fit to a full response, by the most paths there may be."""


def paths_by_response(
    phasors: Complex,
    /,
    *,
    response: ResponseBlock,
    saturated: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    amplitude_v: float,
    samples: Float | None,
) -> ResolvedPaths:
    """Resolve phasors (2, n) of harmonics 1 and 2 as the closed form does, then refine both answers with the response.

    The order test compares fits of the full response: to a sine, a triangle's third harmonic looks like a second path.
    """
    with np.errstate(all="ignore"):
        frame = fundamental_frame(phasors[0], phasors[1])
        status, confidence = screened(
            frame.u,
            frame.powers,
            saturated=saturated,
            settings=settings,
            noise=noise,
            amplitude_v=amplitude_v,
            samples=samples,
        )
        answered = status == 0
        frame = replace(frame, u=np.where(answered, frame.u, np.nan))
        root = 1.0 if samples is None else np.sqrt(samples)
        start = one_path(frame, noise=noise, steps=1)
        steps = REFINED_STEPS[min(settings.max_paths, 2)]
        fit = refined_one_path(start, phasors, response=response, noise=noise, steps=steps)
        alone = Path(fit.amplitude, phase_of(fit.cos, fit.sin), fit.sigma_rad / root)
        if settings.max_paths == 1:
            two = np.zeros(answered.shape, np.bool_)
        elif settings.order == "2":
            two = ~is_single(frame)
        else:
            two = fit.chi_squared * root**2 > chi_squared_threshold(settings.false_alarm, pairs=1)
        refined = refined_two_paths(fit, phasors, two, response=response, noise=noise)
        sigma_x, sigma_y = (sigma / root for sigma in two_path_sigmas(refined.paths, noise=noise))
        x, y = refined.paths.phases()
        direct, mpi = direct_and_mpi(Path(refined.paths.a, x, sigma_x), Path(refined.paths.b, y, sigma_y), settings)
        if settings.order == "auto":
            two &= worth_another(direct, alone)
        doubtful = np.maximum(sigma_x, sigma_y) > refined.paths.sin_half
        status |= (answered & two) * np.uint32(StatusBit.TWO_PATHS)
        status |= (answered & ~two) * np.uint32(StatusBit.ONE_PATH)
        status |= (answered & two & doubtful) * np.uint32(StatusBit.ILL_CONDITIONED)
        status |= (answered & two & refined.failed) * np.uint32(StatusBit.NOT_CONVERGED)
        single = np.flatnonzero(~two)
        direct.put(single, alone.at(single))
        for path in (direct, mpi):
            for values in (path.amplitude, path.phase_rad, path.sigma_rad):
                values[~answered if path is direct else ~(answered & two)] = np.nan
    return ResolvedPaths(direct, mpi, confidence, status)
