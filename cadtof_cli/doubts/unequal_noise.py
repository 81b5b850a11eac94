"""Noise that differs from harmonic to harmonic in another way than the integration lengths say."""

import itertools
import math
from dataclasses import replace

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.doubts.pixels import pairs_of_rows
from cadtof_cli.phasors.noise import ambient_noise_v, estimated_integration_length
from cadtof_cli.phasors.voltages import PhasorMap, volts_per_count

_MOST_RATIO = 2.0
"""Largest ratio of the noise variances of two harmonics that should be equal. Texture turns the phasor of harmonic h by h times
as much as that of harmonic 1, so the higher one may scatter more, by the square of their ratio. In 89 frames of rooms and other
scenes, n_av 1e3 to 1e8, the ratio is 1.7 at most after that, and 1.2 at most the other way round."""

_FEWEST = 1024
"""Least number of pixels: with fewer, the ratio of two estimates is not well known."""

_COARSE_STEPS = 2.0
"""Noise of fewer steps of whole numbers than this is not judged: rounding may hide it."""


def unequal_noise(stored: Stored, metadata: CaptureMetadata, phasor_map: PhasorMap | None = None, /) -> str | None:
    """Return a message if the noise of two harmonics differs far more than their integration lengths explain.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    modulation, n_av = metadata.modulation, metadata.pixel.mean_length
    if n_av is None or len(modulation.harmonics) < 2:
        return None
    quantised = stored.dtype.kind in "iu"
    step_v = abs(volts_per_count(metadata.voltage, stored.dtype)) if quantised else 0.0
    phasors = pairs_of_rows(stored, metadata, phasor_map)
    if phasors is None or phasors.shape[1] < _FEWEST:
        return None
    if not ambient_noise_v(metadata, integration_length=n_av) > _COARSE_STEPS * step_v:
        return None
    seen = []
    for plane, period_ns in zip(phasors, modulation.periods_ns, strict=True):
        alone = replace(metadata, modulation=replace(modulation, periods_ns=(period_ns,)), pixel=Pixel())
        seen.append(estimated_integration_length(plane.reshape(1, 2, -1), alone, quantised=quantised))
    given = metadata.pixel.integration_length
    expected = given if isinstance(given, tuple) else (n_av,) * len(seen)
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
