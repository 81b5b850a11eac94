import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.paths import Paths
from cadtof_cli.resolver.response.as_sine import phasors_of_sine
from cadtof_cli.resolver.response.table import response_block


@pytest.mark.parametrize("own_phase", [False, True])
def test_a_triangle_s_phasors_of_known_paths_become_those_of_a_sine(own_phase: bool) -> None:
    rng = np.random.default_rng(3)
    n = 500
    amplitude, phase = rng.uniform(0.05, 0.3, (2, n)), rng.uniform(0, 2 * np.pi, (2, n))
    amplitude[1, ::7] = phase[1, ::7] = np.nan
    turned = rng.normal(0, 0.1, (2, n)) if own_phase else None
    responses = ideal_response(CaptureMetadata(modulation=Modulation(waveform="triangle")))
    model = response_block(responses, turned)
    seen, expected = np.zeros((2, n), complex), np.zeros((2, n), complex)
    for row, response in enumerate(responses):
        own = turned[row] if turned is not None else 0.0
        for a, x in zip(np.nan_to_num(amplitude), np.nan_to_num(phase), strict=True):
            theta = response.harmonic * x + own
            seen[row] += a * response.without_mirror(response.at(theta)) * np.exp(-1j * np.asarray(own))
            expected[row] += a * np.exp(1j * response.harmonic * x)
    got = phasors_of_sine(seen, Paths(amplitude, phase, phase), response=model.block(slice(0, n)))
    assert np.abs(seen - expected).max() > 0.01
    np.testing.assert_allclose(got, expected, atol=1e-6)
