"""Whether MPI varies over the view as the tail of the room would.

Some tail comes near the data of any patch, also near those of two true paths. But a tail follows from the geometry: it
is strong and early where other surfaces are near, and strong where a surface gets little direct light. So once the state
of the room is known, the model says which patches have more MPI than others, and later MPI. In rooms the data follow
this order. Two true paths have an order of their own.
"""

import numpy as np

from cadtof_cli.arrays import Bool, Float, median
from cadtof_cli.phasors.noise import MAD_PER_SIGMA

LEAST_CORRELATION = 0.2
"""Smallest correlation of the data with what the room foretells, over all kinds of data. Below it, the frame has no tail.
208 rendered rooms with two and three harmonics, at integration lengths of 500 and more, have .25 and more; of 450 others
with two harmonics, five have −.2 to .19. Most frames of two true paths have −.9 to .2. Panes may have .8: their light follows
the inverse-square law, as that of a tail does."""

LEAST_RELIABILITY = 0.25
"""Smallest share of the variance over the view, in the mean over all kinds of data, that must not be due to errors. Below
it, the correlation says nothing."""

MODEL_ERROR_SHARE = 0.5
"""Share of the variance of the model's error that counts as error of the data. Differences between patches that are
smaller than the model's error come out in any order, although the tail is right."""

LEAST_SNR, CLEAR_SHARE = 7.0, 0.9
"""Smallest amplitude of a patch, in units of the noise of one pixel, and the share of the patches that must have it.
The noise of the data is known to first order. With less light it is larger by a fifth and more, and the data are biased:
then the correlation says nothing."""

NO_VARIANCE = 1e-30
"""Keeps data that are the same in all patches from dividing by zero."""


def varies_like_the_tail(
    data: Float, foretold: Float, noise: Float, model_error: Float, snr: Float, patches: Bool, /
) -> bool:
    """Return whether the data vary over the view as the state of the room foretells, as far as that can be told.

    Each kind of data has a rank correlation with what is foretold, which errors of the data make smaller by √reliability.
    The correlation without errors is the one that explains these best, by least squares.

    Args:
        data: of every patch, (data, n).
        foretold: what the model expects of each patch if it knows only the state of the room, (data, n) or more.
        noise: covariance of the data by noise, (data, data, n) or more; only the variances are used.
        model_error: covariance by errors of the model, likewise.
        snr: amplitude of each patch, in units of the noise of one pixel, (n,).
        patches: which of them to use, (n,).
    """
    if np.mean(snr[patches] > LEAST_SNR) < CLEAR_SHARE:
        return True
    errors = noise + MODEL_ERROR_SHARE * model_error
    reliability, correlation = np.empty(len(data)), np.empty(len(data))
    for i in range(len(data)):
        values, expected = data[i, patches], foretold[i, patches]
        spread = _robust_variance(values)
        reliability[i] = (spread - float(median(errors[i, i, patches]))) / max(spread, NO_VARIANCE)
        correlation[i] = np.corrcoef(_ranks(values), _ranks(expected))[0, 1]
    reliability = np.maximum(reliability, 0.0)
    if reliability.mean() < LEAST_RELIABILITY:
        return True
    return bool((np.sqrt(reliability) * correlation).sum() >= LEAST_CORRELATION * reliability.sum())


def _robust_variance(values: Float) -> float:
    """Return the variance of values, (n,), that are normal but for some outliers."""
    return (float(median(np.abs(values - float(median(values))))) / MAD_PER_SIGMA) ** 2


def _ranks(values: Float) -> Float:
    """Return the place of each of the values, (n,), in their order."""
    return np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(np.float64)
