"""Noise of a frame that is not that of the integration lengths: of all harmonics, or of one beside the others."""

import itertools
import math
from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Complex, Stored, median
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.doubts.pixels import FEWEST, LOOKED_AT, left_by_one_path, tells_scene
from cadtof_cli.phasors.noise import ambient_noise_v, estimated_integration_length
from cadtof_cli.phasors.voltages import (
    PhasorMap,
    ideal_phasor_map,
    phasors_from_stored,
    saturated_pixels,
    volts_per_count,
)

_FULLY_LIT = 0.8
"""Median |p| of a frame above which nearly all light is the laser's. The noise is then not judged: it is hardly any."""

_MORE_NOISE, _MORE_LEFT, _LESS_NOISE = 8.0, 5.0, 4.0
"""The noise of a frame is doubted if its variance is more than 8 times as large as the integration length explains, or
more than 4 times smaller. Texture adds scatter: up to a factor of 5 in rendered rooms. Nothing makes scatter smaller.

Without depth and brightness, the variance must be more than 5 times as large: not all of an offset is left then."""

_LEAST_NOISE = 0.1
"""Least variance of a pixel's noise, over that of a pixel in ambient light, that is reckoned with."""

_COARSE_STEPS = 2.0
"""Noise of fewer steps of whole numbers than this is not judged to be too small, nor that of one harmonic beside another:
rounding may hide it."""

_MOST_RATIO = 2.0
"""Largest ratio of the noise variances of two harmonics that should be equal. Texture turns the phasor of harmonic h by h times
as much as that of harmonic 1, so the higher one may scatter more, by the square of their ratio. In 89 frames of rooms and other
scenes, n_av 1e3 to 1e8, the ratio is 1.7 at most after that, and 1.2 at most the other way round."""

_FEWEST_OF_EACH = 1024
"""Least number of pixels from which the noise of one harmonic is compared with that of another: with fewer, the ratio of two
estimates is not well known."""


def other_noise(stored: Stored, metadata: CaptureMetadata, phasor_map: PhasorMap | None = None, /) -> str | None:
    """Return a message if neighbours, calibrated by a map, differ by far more or less than the integration lengths explain.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    n_av, whole = metadata.pixel.mean_length, stored.dtype.kind in "iu"
    phasors = None if n_av is None else _pairs_of_rows(stored, metadata, phasor_map)
    if n_av is None or phasors is None:
        return None
    step_v = abs(volts_per_count(metadata.voltage, stored.dtype)) if whole else 0.0
    fine = ambient_noise_v(metadata, integration_length=n_av) > _COARSE_STEPS * step_v
    seen = estimated_integration_length(phasors.reshape(len(phasors), 2, -1), metadata, quantised=whole)
    more = seen < n_av / _MORE_NOISE
    if more and tells_scene(metadata):
        more = not _length_without_scene(phasors, metadata, quantised=whole) >= n_av / _MORE_LEFT
    if more:
        return (
            f"neighbouring pixels scatter as with integration_length = {seen:.2g} instead of {n_av:g}: standard deviations "
            f"are about {math.sqrt(n_av / seen):.2g} times too small, and noise is taken for light and for second paths. "
            "Correct integration_length or leave it out; or, if the pixels have offsets of their own, run calibrate dark. Only a "
            "view of fine mesh, such as a fence, looks like that, too: integration_length may then be right"
        )
    if fine and _LESS_NOISE * n_av < seen < math.inf:
        return (
            f"neighbouring pixels scatter as with integration_length = {seen:.2g} instead of {n_av:g}: standard deviations "
            f"are about {math.sqrt(seen / n_av):.2g} times too large, and weak light and MPI are not found. Correct "
            "integration_length or leave it out; or, if a filter smooths the frames, record without it: else sigma is wrong"
        )
    return _unequal_noise(phasors, metadata, quantised=whole) if fine else None


def _pairs_of_rows(stored: Stored, metadata: CaptureMetadata, phasor_map: PhasorMap | None) -> Complex | None:
    """Return the phasors of pairs of neighbouring rows that are spread over a frame, (H, n), the upper rows first; saturated
    ones are NaN.

    None if they are too few, or if nearly all light is the laser's, so that there is hardly any noise.
    """
    height, width = stored.shape[2:]
    if min(height, width) < 2:
        return None
    pairs = np.arange(height // 2 * 2).reshape(-1, 2)
    pairs = pairs[:: max(1, pairs.size * width // LOOKED_AT)]
    if len(pairs) * width < FEWEST:
        return None
    # pairs of rows, one beside the other: a frame of two rows
    rows = pairs.T.ravel()
    values = stored[:, :, rows].reshape(*stored.shape[:2], -1)
    places = np.add.outer(rows * width, np.arange(width)).ravel()
    phasors = phasors_from_stored(values, (phasor_map or ideal_phasor_map(metadata, stored.dtype))[places])
    phasors[:, saturated_pixels(values, metadata.voltage.saturated_counts)] = np.nan
    lengths = np.abs(phasors[0][np.isfinite(phasors[0])])
    if lengths.size < FEWEST or not median(lengths) < _FULLY_LIT:
        return None
    return phasors


def _length_without_scene(phasors: Complex, metadata: CaptureMetadata, *, quantised: bool) -> float:
    """Return the n_av that explains how phasors of two rows of pixels, (H, 2·n), differ, apart from depth and brightness."""
    left = left_by_one_path(phasors, metadata.modulation.harmonics)
    # the more of its light is the laser's, the less noise a pixel has
    left /= np.sqrt(np.maximum(1.0 - np.mean(np.abs(phasors) ** 2, axis=0), _LEAST_NOISE))
    return estimated_integration_length(left.reshape(len(left), 2, -1), metadata, quantised=quantised)


def _unequal_noise(phasors: Complex, metadata: CaptureMetadata, *, quantised: bool) -> str | None:
    """Return a message if the noise of two harmonics, in two rows of pixels, (H, 2·n), differs far more than their
    integration lengths explain."""
    modulation, given = metadata.modulation, metadata.pixel.integration_length
    if len(phasors) < 2 or phasors.shape[1] < _FEWEST_OF_EACH:
        return None
    seen = []
    for plane, period_ns in zip(phasors, modulation.periods_ns, strict=True):
        alone = replace(metadata, modulation=replace(modulation, periods_ns=(period_ns,)), pixel=Pixel())
        seen.append(estimated_integration_length(plane.reshape(1, 2, -1), alone, quantised=quantised))
    # a single length is that of all harmonics: it drops out of the ratios
    expected = given if isinstance(given, tuple) else (1.0,) * len(seen)
    for i, j in itertools.combinations(range(len(seen)), 2):
        ratio = (seen[i] / expected[i]) / (seen[j] / expected[j])
        texture = (modulation.harmonics[j] / modulation.harmonics[i]) ** 2
        if math.isfinite(ratio) and (ratio > _MOST_RATIO * texture or ratio * _MOST_RATIO < 1.0):
            found = ", ".join(f"{length:.2g}" for length in seen)
            return (
                f"the harmonics scatter as with integration_length = [{found}], not as given: give a list with that of each "
                "modulation period, or leave integration_length out; else sigma is wrong, and noise is taken for second paths"
            )
    return None
