"""The phase from the first harmonic alone: the phase of the single path that would give this phasor."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.response.as_sine import first_phase, single_path
from cadtof_cli.resolver.response.table import response_block

PHASE = np.linspace(0.0, 2.0 * np.pi, 721, endpoint=False)


def phase_error(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(np.mod(found - expected + np.pi, 2.0 * np.pi) - np.pi))


def test_under_a_sine_it_is_the_phase_of_the_phasor() -> None:
    found = first_phase(0.3 * np.exp(1j * (PHASE - 4.0 * np.pi)), response=None)
    assert phase_error(found, PHASE).max() < 1e-12
    assert found.min() >= 0.0
    assert found.max() < 2.0 * np.pi


@pytest.mark.parametrize("phase_of_pixels", [None, 0.7, -2.0, 3.1])
def test_under_a_triangle_it_is_the_phase_of_the_path(phase_of_pixels: float | None) -> None:
    responses = ideal_response(CaptureMetadata(modulation=Modulation(waveform="triangle")))
    phases_rad = (
        None if phase_of_pixels is None else np.stack([np.full(PHASE.size, phase_of_pixels), np.full(PHASE.size, 1.0)])
    )
    model = response_block(responses, phases_rad)
    turn = phase_of_pixels or 0.0
    phasor = 0.2 * responses[0].at(PHASE + turn) / responses[0].main * np.exp(-1j * turn)
    assert phase_error(np.angle(phasor), PHASE).max() > 0.05
    found = first_phase(phasor, response=model.block(slice(None)))
    assert phase_error(found, PHASE).max() < 1e-5
    assert found.min() >= 0.0
    assert found.max() < 2.0 * np.pi
    path = single_path(phasor, response=model.block(slice(None)))
    assert path.amplitude.shape == (1, PHASE.size)
    assert_allclose(path.amplitude[0], 0.2, rtol=1e-5)
    assert_allclose(path.phase_rad[0], found)
    assert np.isnan(path.sigma_rad).all()


def test_nan_stays_nan() -> None:
    model = response_block(ideal_response(CaptureMetadata(modulation=Modulation(waveform="triangle"))), None)
    phasors = np.array([0.1 + 0.1j, complex(np.nan, 0.1)])
    for response in (None, model.block(slice(None))):
        assert_allclose(np.isnan(first_phase(phasors, response=response)), [False, True])
