"""The pixels of a frame that are looked at: some, spread over it, without NaN and saturated ones."""

import numpy as np

from cadtof_cli.arrays import Complex, Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.voltages import ideal_phasor_map, phasors_from_stored, sound_pixels

LOOKED_AT = 4096
"""A larger frame is judged by at least this many pixels, spread evenly over it."""

FEWEST = 64
"""Least number of pixels from which a fault of the planes is concluded."""


def sound_values(some: Stored, metadata: CaptureMetadata, /) -> Stored:
    """Return the stored values of the sound ones of some pixels, (H, 2, …) → (H, 2, m)."""
    return some[:, :, sound_pixels(some, metadata.voltage.saturated_counts)]


def sound_phasors(some: Stored, metadata: CaptureMetadata, /) -> Complex:
    """Return the phasors, as if the camera had no defects, of the sound ones of some pixels, (H, 2, …) → (H, m).

    Raises:
        SettingsError: see `volts_per_count`.
    """
    return phasors_from_stored(sound_values(some, metadata), ideal_phasor_map(metadata, some.dtype))


def scatters(rows: Stored, steps_of_whole_numbers: float, /) -> bool:
    """Return whether the median difference between neighbours, in any of the planes (planes, n), exceeds so many steps
    of whole numbers; for floating-point values, whether it exceeds 0."""
    least = steps_of_whole_numbers if rows.dtype.kind in "iu" else 0.0
    with np.errstate(invalid="ignore"):
        steps = np.abs(np.diff(rows.astype(np.float64), axis=1))
    known = (row[np.isfinite(row)] for row in steps)
    return any(float(np.median(row)) > least for row in known if row.size)
