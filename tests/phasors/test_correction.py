"""Every pixel's own offset, gain and phase are taken out, and the imbalance of the channels with them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.phasors.correction import corrected_phasors, pixel_correction
from cadtof_cli.phasors.response import HarmonicResponse

N = 7
AMPLITUDE_V, PER_COUNT, ZERO = 0.25, 1e-4, 8000.0
RESPONSES = (
    HarmonicResponse(1, ((1, 0.9 + 0.1j), (-1, 0.05j))),
    HarmonicResponse(2, ((1, 0.7 - 0.2j), (-1, -0.03 + 0.01j))),
)


def recorded(q: NDArray[np.complex128], offset: NDArray[np.float64], gain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Counts, (2, 2, n), of a camera with these defects, before the pixel's own phase."""
    planes = []
    for row, response in enumerate(RESPONSES):
        volts = AMPLITUDE_V * gain[row] * (response.main * q[row] + response.mirror * q[row].conj())
        planes.append(np.stack([volts.real, volts.imag]) + offset[row])
    return np.stack(planes) / PER_COUNT + ZERO


@pytest.mark.parametrize("block", [slice(0, N), slice(2, 5)])
@pytest.mark.parametrize("what", ["all", "offset", "phase", "gain", "nothing"])
def test_what_each_pixel_adds_is_taken_off_in_any_block(block: slice, what: str) -> None:
    rng = np.random.default_rng(1)
    p = rng.normal(size=(2, N)) + 1j * rng.normal(size=(2, N))
    offset = rng.normal(0.0, 0.02, (2, 2, N)) if what in {"all", "offset"} else np.zeros((2, 2, N))
    phase = rng.normal(0.0, 0.5, (2, N)) if what in {"all", "phase"} else np.zeros((2, N))
    gain = rng.uniform(0.5, 2.0, (2, N)) if what in {"all", "gain"} else np.ones((2, N))
    counts = recorded(p * np.exp(1j * phase), offset, gain)
    correction = pixel_correction(
        RESPONSES,
        volts_per_count=PER_COUNT,
        zero_counts=ZERO,
        amplitude_v=AMPLITUDE_V,
        offset_v=offset if what in {"all", "offset"} else None,
        phase_rad=phase if what in {"all", "phase"} else None,
        gain=gain if what in {"all", "gain"} else None,
        pixels=N,
    )
    before = counts.copy()
    found = corrected_phasors(counts[:, :, block], correction=correction, block=block)
    np.testing.assert_allclose(found, p[:, block], atol=1e-11)
    np.testing.assert_array_equal(counts, before)
    assert found.dtype == np.complex128


def test_half_and_whole_numbers_are_no_less_exact_and_nan_stays() -> None:
    correction = pixel_correction(
        RESPONSES,
        volts_per_count=1.0,
        zero_counts=0.0,
        amplitude_v=1.0,
        offset_v=None,
        phase_rad=None,
        gain=None,
        pixels=3,
    )
    values = np.array([[[1.0, 2.0, np.nan], [3.0, 4.0, 5.0]], [[5.0, 6.0, 7.0], [7.0, 8.0, 9.0]]])
    whole = corrected_phasors(values, correction=correction, block=slice(0, 3))
    half = corrected_phasors(values.astype(np.float16), correction=correction, block=slice(0, 3))
    np.testing.assert_array_equal(whole, half)
    assert np.isnan(whole[0, 2])
    assert np.isfinite(whole[1]).all()
