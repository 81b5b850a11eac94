"""A bit of the converter that is the same in all pixels."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Voltage
from cadtof_cli.doubts.camera import stuck_bit

AMPLITUDE_V, STEP = 0.2746, 6e-5
COUNTS = Voltage(zero_counts=8192.0, volts_per_count=STEP)


def counts(share: float = 0.4) -> NDArray[np.uint16]:
    """Return counts, (2, 2, 4000), of phasors with `share` of the modulation amplitude and random phases."""
    phase = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (2, 4000))
    volts = share * AMPLITUDE_V * np.stack([np.cos(phase), np.sin(phase)], axis=1)
    return np.rint(volts / STEP + 8192.0).astype(np.uint16)


@pytest.mark.parametrize("value", [0, 1])
@pytest.mark.parametrize(("plane", "which"), [(slice(None), "all planes"), (1, "H2.SC2")])
def test_a_bit_that_is_stuck_is_told(value: int, plane: int | slice, which: str) -> None:
    """Bit 9 moved depths by decimetres to metres, with a sigma of millimetres, in silence."""
    known = CaptureMetadata(modulation=Modulation(amplitude_v=AMPLITUDE_V), voltage=COUNTS)
    frame = counts().reshape(2, 2, 40, 100)
    assert stuck_bit(frame, known) is None
    # whole numbers of fewer bits have lower bits that never change
    assert stuck_bit(frame & np.uint16(0xFFC0), known) is None
    spoiled = frame.copy()
    one = spoiled if isinstance(plane, slice) else spoiled[plane, plane]
    one[...] = one | np.uint16(512) if value else one & ~np.uint16(512)
    told = stuck_bit(spoiled, known)
    assert told is not None
    assert told.startswith(f"bit 9 (512) of {which} is {value} in every pixel")


@pytest.mark.parametrize("bit", range(5, 12))
def test_surfaces_of_few_depths_have_no_stuck_bit(bit: int) -> None:
    """The bits of narrow values are the same by chance."""
    known = CaptureMetadata(modulation=Modulation(amplitude_v=AMPLITUDE_V), voltage=COUNTS)
    noise = np.random.default_rng(bit).normal(0.0, 8.0, (2, 2, 40, 100))
    steps = np.array([[6500.0, 9200.0], [7000.0, 9900.0]])[..., np.newaxis, np.newaxis] + (1 << bit) * (
        np.arange(100) // 50
    )
    assert stuck_bit(np.rint(steps + noise).astype(np.uint16), known) is None


def test_a_fence_before_a_wall_has_no_stuck_bit() -> None:
    """In each plane, bit 9 is 0 in both, and one gap lies between the two."""
    known = CaptureMetadata(modulation=Modulation(amplitude_v=AMPLITUDE_V), voltage=COUNTS)
    bars = np.where(np.arange(100) % 2, 8192 + 480, 8192 + 1024 + 30)
    stored = np.rint(bars + np.random.default_rng(1).normal(0.0, 7.0, (2, 2, 40, 100))).astype(np.uint16)
    assert not (stored & 512).any()
    assert stuck_bit(stored, known) is None


@pytest.mark.parametrize("dtype", [np.int16, np.uint16, np.int32])
@pytest.mark.parametrize(("bit", "is_told"), [(4, False), (5, True), (8, True), (11, True)])
def test_a_stuck_bit_is_told_if_it_moves_depths_by_millimetres(
    dtype: type[np.signedinteger | np.unsignedinteger], bit: int, is_told: bool
) -> None:
    """A step of 60 µV is a five thousandth of the modulation amplitude; bit 4 is a third of a hundredth."""
    zero = 0 if np.issubdtype(dtype, np.signedinteger) else 8192
    known = CaptureMetadata(
        modulation=Modulation(amplitude_v=AMPLITUDE_V), voltage=Voltage(zero_counts=zero, volts_per_count=STEP)
    )
    frame = (counts(0.9).reshape(2, 2, 40, 100).astype(np.int32) - 8192 + zero).astype(dtype)
    assert stuck_bit(frame, known) is None
    told = stuck_bit(frame | dtype(1 << bit), known)
    assert (told is not None) == is_told
    assert told is None or told.startswith(f"bit {bit} ({1 << bit}) of all planes is 1 in every pixel")


def test_a_stuck_bit_is_found_in_large_frames_of_bytes() -> None:
    known = CaptureMetadata(
        modulation=Modulation(amplitude_v=AMPLITUDE_V), voltage=Voltage(zero_counts=128.0, volts_per_count=4e-3)
    )
    frame = np.random.default_rng(1).integers(30, 220, (2, 2, 200, 300), np.uint8)
    assert stuck_bit(frame, known) is None
    frame[1, 0] &= np.uint8(0xEF)
    assert str(stuck_bit(frame, known)).startswith("bit 4 (16) of H2.SC1 is 0 in every pixel")
