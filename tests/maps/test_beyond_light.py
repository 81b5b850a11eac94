"""The paths of a pixel are shares of all its photons: the sum of their amplitudes is at most the modulation amplitude."""

from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.maps.depth import beyond_light
from tests.support.mixtures import noise_of

NOISE = noise_of((1, 2), n_av=1e6)


@pytest.mark.parametrize(
    ("amplitudes", "confidence", "beyond"),
    [
        ((0.7, 0.29), 0.5, False),
        ((0.7, 0.7), 0.5, True),
        ((1.2, np.nan), 0.5, True),
        ((0.6, np.nan), 0.5, False),
        ((np.nan, np.nan), 0.5, False),
        ((0.4, 0.4, 0.4), 0.5, True),
        ((0.3, 0.3, 0.3), 1.2, True),
        ((0.3, 0.3, np.nan), np.nan, False),
    ],
)
def test_the_sum_of_the_paths_and_the_first_phasor_are_at_most_the_modulation(
    amplitudes: tuple[float, ...], confidence: float, beyond: bool
) -> None:
    volts = [np.array([0.2746 * amplitude]) for amplitude in amplitudes]
    found = beyond_light(volts, np.array([0.2746 * confidence]), noise=NOISE, amplitude_v=0.2746)
    assert found.tolist() == [beyond]


@pytest.mark.parametrize(("amplitude", "beyond"), [(1.05, False), (1.15, True)])
def test_a_mean_of_a_hundred_samples_may_exceed_the_modulation_by_a_tenth_of_the_noise(
    amplitude: float, beyond: bool
) -> None:
    """At n_av 50, five standard deviations of both harmonics are .75 of the modulation amplitude.

    A mean of 100 samples has a tenth of that, .075. So an amplitude of 1.05 is possible, and 1.15 is not.
    """
    noise = replace(noise_of((1, 2), n_av=50.0), samples=np.array([100.0]))
    assert beyond_light([np.array([amplitude])], np.array([0.5]), noise=noise).tolist() == [beyond]
    assert not beyond_light([np.array([amplitude])], np.array([0.5]), noise=noise_of((1, 2), n_av=50.0)).any()
