"""Which pixels get an answer at all: those that are recorded soundly and hold more than noise."""

from collections.abc import Sequence

import numpy as np

from cadtof_cli.arrays import Bool, Float, Status
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit


def screened(
    modulus: Float,
    squares: Sequence[Float],
    /,
    *,
    saturated: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    amplitude_v: float,
    samples: Float | None,
) -> tuple[Status, Float]:
    """Return the status of pixels that get no answer, 0 for the others, and the confidence of all, (n,) each.

    Args:
        modulus: |p| of the first harmonic, in units of the modulation amplitude.
        squares: |p|² of every harmonic.
        saturated: pixels that a saturated value went into.
        settings: least confidence, or the false alarms that decide it.
        noise: noise of a recorded pixel.
        amplitude_v: modulation amplitude.
        samples: recorded pixels that each has been averaged over; None: 1.
    """
    power = squares[0] * (1.0 / noise.harmonics[0].dark_variance)
    for square, harmonic in zip(squares[1:], noise.harmonics[1:], strict=True):
        power += square * (1.0 / harmonic.dark_variance)
    if samples is not None:
        power *= samples
    if settings.min_confidence_v is None:
        low = power <= chi_squared_threshold(settings.false_alarm, pairs=len(squares))
    else:
        low = (modulus < settings.min_confidence_v / amplitude_v) | (power == 0.0)
    status = low * np.uint32(StatusBit.LOW_CONFIDENCE)
    not_finite = ~np.isfinite(power)
    confidence = modulus
    if saturated.any() or not_finite.any():
        status[not_finite] = StatusBit.NOT_FINITE
        status[saturated] = StatusBit.SATURATED | status[saturated] & StatusBit.NOT_FINITE
        confidence = np.where(saturated | not_finite, np.nan, modulus)
    return status, confidence
