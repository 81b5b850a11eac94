"""One affine map takes out the offset, gain and phase of each pixel and the imbalance of the channels."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Voltage
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.response import HarmonicResponse
from cadtof_cli.phasors.voltages import phasors_from_stored, pixel_phasor_map

N = 7
AMPLITUDE_V, PER_COUNT, ZERO = 0.25, 1e-4, 8000.0
RESPONSES = (
    HarmonicResponse(1, ((1, 0.9 + 0.1j), (-1, 0.05j))),
    HarmonicResponse(2, ((1, 0.7 - 0.2j), (-1, -0.03 + 0.01j))),
)


def recorded(q: NDArray[np.complex128], offset: NDArray[np.float64], gain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return counts, (2, 2, n), of a camera with these offsets and gains; `q` already has the phases of the pixels."""
    planes = []
    for row, response in enumerate(RESPONSES):
        volts = AMPLITUDE_V * gain[row] * (response.main * q[row] + response.mirror * q[row].conj())
        planes.append(np.stack([volts.real, volts.imag]) + offset[row])
    return np.stack(planes) / PER_COUNT + ZERO


@pytest.mark.parametrize("block", [slice(0, N), slice(2, 5)])
@pytest.mark.parametrize("defects", ["all", "offset", "phase", "gain", "nothing"])
def test_offset_gain_and_phase_of_each_pixel_are_removed_in_any_block(block: slice, defects: str) -> None:
    rng = np.random.default_rng(1)
    p = rng.normal(size=(2, N)) + 1j * rng.normal(size=(2, N))
    offset = rng.normal(0.0, 0.02, (2, 2, N)) if defects in {"all", "offset"} else np.zeros((2, 2, N))
    phase = rng.normal(0.0, 0.5, (2, N)) if defects in {"all", "phase"} else np.zeros((2, N))
    gain = rng.uniform(0.5, 2.0, (2, N)) if defects in {"all", "gain"} else np.ones((2, N))
    counts = recorded(p * np.exp(1j * phase), offset, gain)
    metadata = CaptureMetadata(
        modulation=Modulation(amplitude_v=AMPLITUDE_V), voltage=Voltage(zero_counts=ZERO, volts_per_count=PER_COUNT)
    )
    phasor_map = pixel_phasor_map(
        RESPONSES,
        metadata,
        counts.dtype,
        offset_v=offset if defects in {"all", "offset"} else None,
        phase_rad=phase if defects in {"all", "phase"} else None,
        gain=gain if defects in {"all", "gain"} else None,
        pixels=N,
    )
    before = counts.copy()
    found = phasors_from_stored(counts[:, :, block], phasor_map[block])
    np.testing.assert_allclose(found, p[:, block], atol=1e-11)
    np.testing.assert_array_equal(counts, before)
    assert found.dtype == np.complex128


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_without_a_voltage_scale_floats_are_volts_and_counts_are_refused(dtype: type) -> None:
    volts = np.array([[[0.25, 0.5], [0.125, 0.75]], [[0.375, 0.0], [1.0, 0.5]]])
    metadata = CaptureMetadata(modulation=Modulation(amplitude_v=1.0))
    if dtype is np.uint16:
        with pytest.raises(SettingsError, match="set volts_per_count and zero_counts under"):
            pixel_phasor_map(RESPONSES, metadata, np.dtype(dtype), offset_v=None, phase_rad=None, gain=None, pixels=2)
        return
    phasor_map = pixel_phasor_map(
        RESPONSES, metadata, np.dtype(dtype), offset_v=None, phase_rad=None, gain=None, pixels=2
    )
    found = phasors_from_stored(volts, phasor_map)
    for row, response in enumerate(RESPONSES):
        answer = response.main * found[row] + response.mirror * found[row].conj()
        np.testing.assert_allclose(answer, volts[row, 0] + 1j * volts[row, 1], atol=1e-14)


def test_half_precision_values_give_the_same_phasors_and_nan_stays_nan() -> None:
    metadata = CaptureMetadata(modulation=Modulation(amplitude_v=1.0), voltage=Voltage(volts_per_count=1.0))
    phasor_map = pixel_phasor_map(
        RESPONSES, metadata, np.dtype(np.float64), offset_v=None, phase_rad=None, gain=None, pixels=3
    )
    values = np.array([[[1.0, 2.0, np.nan], [3.0, 4.0, 5.0]], [[5.0, 6.0, 7.0], [7.0, 8.0, 9.0]]])
    whole = phasors_from_stored(values, phasor_map)
    half = phasors_from_stored(values.astype(np.float16), phasor_map)
    np.testing.assert_array_equal(whole, half)
    assert np.isnan(whole[0, 2])
    assert np.isfinite(whole[1]).all()
