"""Draw and resolve one condition of two paths many times: bias, scatter, predicted sigma, and share of two paths."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from limits.drawn import CM_PER_RAD, SEEDS, drawn, errors_cm, resolved, rms
from tests.support.mixtures import F, Mixture

RATIOS = (0.05, 0.1, 0.3, 0.6)
SEPARATIONS_NS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0, 16.0, 20.0)
ASRS = (1.0, 2.0, 4.0, 6.0)
LENGTHS = (1e3, 1e4, 1e5, 1e6)

SHOWN = ((6.0, 1e4), (2.0, 1e4), (6.0, 1e5), (2.0, 1e5), (2.0, 1e6))
"""ASR and n_av of the page's tables, from much noise to little."""

SEAM = 0.02
"""A condition lies on the seam between one and two paths if at least this share of pixels is found as each."""

WORTH = 1.05
"""Goal for the RMSE of the order test: at most this many times that of the better fixed order."""


@dataclass(frozen=True)
class Cell:
    """One condition; lengths in cm, shares of pixels.

    Attributes:
        rmse_cm, rmse_one_cm, rmse_two_cm: RMSE with the order test, with always one path, with always two paths.
        sigma_cm: median of the predicted sigma.
        two: share found as two paths.
        beyond: share wrong by more than three times the pixel's own sigma.
        doubtful: share with the bit `ill-conditioned`.
        missed: share beyond three sigma without this bit.
        over_better, over_better_error: RMSE of the order test divided by that of the better fixed order, and the
            standard error of this ratio over the seeds.
        strict, loose: this ratio with a false alarm of 0.001 and of 0.1 instead of 0.01.
    """

    mpi_ratio: float
    separation_ns: float
    asr: float
    n_av: float
    bias_cm: float
    rmse_cm: float
    rmse_one_cm: float
    rmse_two_cm: float
    sigma_cm: float
    two: float
    beyond: float
    doubtful: float
    missed: float
    over_better: float
    over_better_error: float
    strict: float
    loose: float


def measured(
    ratio: float, separation_ns: float, asr: float, n_av: float, *, pixels: int, harmonics: tuple[int, ...] = (1, 2)
) -> Cell:
    """Resolve one condition many times, with the order test and with fixed orders.

    `n_av` is that of two harmonics; other numbers of harmonics share the same light.
    """
    light = Mixture((1.0, ratio) if ratio else (1.0,), (5.0, 5.0 + separation_ns) if ratio else (5.0,), asr=asr)
    key = [round(1e3 * value) for value in (ratio, separation_ns, asr, n_av)]
    length = n_av * 2.0 / len(harmonics)
    phasors = drawn(light, harmonics, length, pixels=pixels, key=key)
    found, one, two = (
        resolved(phasors, harmonics, length, ResolverSettings(order=order)) for order in ("auto", "1", "2")
    )
    error, error_one, error_two = (errors_cm(paths, light) for paths in (found, one, two))
    strict, loose = (
        rms(errors_cm(resolved(phasors, harmonics, length, ResolverSettings(false_alarm=chance)), light))
        for chance in (0.001, 0.1)
    )
    better = min(rms(error_one), rms(error_two))
    sigma = CM_PER_RAD * found.paths[0].sigma_rad
    beyond = np.abs(error) > 3.0 * sigma
    doubtful = (found.status & StatusBit.ILL_CONDITIONED) > 0
    over = [
        rms(some[0]) / min(rms(some[1]), rms(some[2]))
        for some in zip(*map(_by_seed, (error, error_one, error_two)), strict=True)
    ]
    return Cell(
        *(ratio, separation_ns, asr, n_av),
        float(np.nanmean(error)),
        *(rms(error), rms(error_one), rms(error_two)),
        float(np.nanmedian(sigma)),
        float(np.mean((found.status & StatusBit.TWO_PATHS) > 0)),
        float(beyond.mean()),
        float(doubtful.mean()),
        float((beyond & ~doubtful).mean()),
        rms(error) / better,
        float(np.std(over, ddof=1) / SEEDS**0.5),
        strict / better,
        loose / better,
    )


def _by_seed(values: F) -> F:
    return values.reshape(SEEDS, -1)
