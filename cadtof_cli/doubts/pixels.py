"""The pixels of a frame that are looked at, without NaN and saturated ones, and what one path leaves over of their phasors."""

import math

import numpy as np

from cadtof_cli.arrays import Complex, Float, Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.voltages import (
    ideal_phasor_map,
    phasors_from_stored,
    sound_pixels,
)

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


@np.errstate(over="ignore", invalid="ignore")
def left_by_one_path(phasors: Complex, harmonics: tuple[int, ...], /) -> Complex:
    """Return what one path leaves over of phasors of two harmonics or more, complex (H, n), with as much noise as they have.

    Surfaces of any depth and brightness leave nothing but noise, so texture and edges of a scene do not show.
    """
    h = np.array(harmonics, np.float64)[:, np.newaxis]
    real, imaginary = left_over(turned_by_phase(phasors, h)[0], h)
    # amplitude and phase take up one of H real and one of H imaginary parts
    return np.asarray(math.sqrt(len(h) / (len(h) - 1.0)) * (real + 1j * imaginary))


def squared_misfits(phasors: Complex, h: Float, /) -> Float:
    """Return the squared misfit of one path of each pixel, (H, n) → (n,)."""
    real, imaginary = left_over(turned_by_phase(phasors, h)[0], h)
    return np.asarray((real * real).sum(axis=0) + (imaginary * imaginary).sum(axis=0))


def turned_by_phase(phasors: Complex, h: Float, /) -> tuple[Complex, Complex]:
    """Return phasors, (H, n), turned back by the phase x of the one path that fits each pixel, and exp(−ihx)."""
    phase = np.angle(phasors[0])
    for _ in range(2):
        turned = phasors * np.exp(-1j * h * phase)
        slope, bend = (h * turned.imag).sum(axis=0), (h * h * turned.real).sum(axis=0)
        phase = phase + np.clip(slope / np.maximum(bend, 1e-30), -0.3, 0.3)
    back = np.exp(-1j * h * phase)
    return phasors * back, back


def left_over(turned: Complex, h: Float, /) -> tuple[Float, Float]:
    """Return what amplitude and phase of a path leave over of the real and of the imaginary parts of turned phasors, (H, n)."""
    real, imaginary = left_over_projections(h)
    return real @ turned.real, imaginary @ turned.imag


def left_over_projections(h: Float, /) -> tuple[Float, Float]:
    """Return the projections, (H, H), of real and of imaginary parts onto what amplitude and phase of a path leave over."""
    return np.eye(len(h)) - 1.0 / len(h), np.eye(len(h)) - h * h.T / (h * h).sum()


def tells_scene(metadata: CaptureMetadata, /) -> bool:
    """Return whether texture and edges of a scene can be told from errors of the camera: the further terms of a triangle differ
    from pixel to pixel."""
    return metadata.modulation.waveform == "sine" and len(metadata.modulation.harmonics) > 1
