"""Phasors of known paths under a triangle, converted to those of a sine or of pixels without phases of their own."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.paths import Paths
from cadtof_cli.resolver.response.as_sine import phasors_of_sine, without_own_phases
from cadtof_cli.resolver.response.table import ResponseBlock, response_block


@pytest.mark.parametrize("with_phases", [False, True])
def test_phasors_of_a_triangle_become_those_of_a_sine(with_phases: bool) -> None:
    rng = np.random.default_rng(3)
    n = 500
    amplitude, phase = rng.uniform(0.05, 0.3, (2, n)), rng.uniform(0, 2 * np.pi, (2, n))
    amplitude[1, ::7] = phase[1, ::7] = np.nan
    phases_rad = rng.normal(0, 0.1, (2, n)) if with_phases else None
    responses = ideal_response(CaptureMetadata(modulation=Modulation(waveform="triangle")))
    model = response_block(responses, phases_rad)
    seen, expected = np.zeros((2, n), complex), np.zeros((2, n), complex)
    for row, response in enumerate(responses):
        phase_of_pixels = phases_rad[row] if phases_rad is not None else 0.0
        for a, x in zip(np.nan_to_num(amplitude), np.nan_to_num(phase), strict=True):
            theta = response.harmonic * x + phase_of_pixels
            seen[row] += a * response.without_mirror(response.at(theta)) * np.exp(-1j * np.asarray(phase_of_pixels))
            expected[row] += a * np.exp(1j * response.harmonic * x)
    found = phasors_of_sine(seen, Paths(amplitude, phase, phase), response=model.block(slice(0, n)))
    assert np.abs(seen - expected).max() > 0.01
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_phasors_lose_the_effect_of_the_pixels_own_phases() -> None:
    """Two paths of a triangle are recorded by pixels that add phases of up to a radian of their own.

    Afterwards the phasors are those of pixels that add nothing, higher terms of the triangle included.
    """
    responses = ideal_response(CaptureMetadata(modulation=Modulation(waveform="triangle")))
    rng = np.random.default_rng(1)
    phases_rad = rng.uniform(-1.0, 1.0, (2, 200))
    model, plain = response_block(responses, phases_rad), response_block(responses, None)
    amplitude = np.array([[0.3], [0.1]]) * np.ones(200)
    phase = np.stack([rng.uniform(0.0, 3.0, 200), rng.uniform(3.5, 6.0, 200)])
    paths = Paths(amplitude, phase, np.zeros_like(phase))
    phasors, expected = (_light(paths, response) for response in (model, plain))
    assert np.abs(phasors - expected).max() > 0.02
    np.testing.assert_allclose(without_own_phases(phasors, paths, response=model), expected, atol=1e-6)
    np.testing.assert_array_equal(without_own_phases(expected, paths, response=plain), expected)


def _light(paths: Paths, response: ResponseBlock) -> NDArray[np.complex128]:
    """Return the phasors of paths, (2, n), turned back by the phases that the pixels add."""
    phasors = np.zeros((2, paths.amplitude.shape[1]), np.complex128)
    for row in range(2):
        for a, x in zip(paths.amplitude, paths.phase_rad, strict=True):
            answer = response.at(row, x.astype(np.float32))
            re, im = response.turned_back(row, answer.re, answer.im)
            phasors[row] += a * (re + 1j * im)
    return phasors
