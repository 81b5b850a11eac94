"""A calibration prepared for frames of one size and type: the correction that the pipeline applies to every block."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.phasors.voltages import PhasorMap, ideal_phasor_map, pixel_phasor_map
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration
    from cadtof_cli.resolver.response.table import ResponseBlock


STEPS_PER_OCTAVE = 4
"""Number of steps per factor of two to which the power of light is rounded: frames with about the same light then share
everything that is computed from their noise."""


@dataclass(frozen=True)
class CalibrationNoise:
    """The noise in a pixel's phasors that comes from noise of the calibration's own frames. It is the same in all
    frames that the calibration is applied to.

    Attributes:
        dark: variance per channel that the dark frames cause, one per harmonic, in units of the modulation amplitude.
        response: variance per channel that the frames of targets cause, divided by the power |p|² of the light, one per
            harmonic.
    """

    dark: tuple[float, ...]
    response: tuple[float, ...]

    def added_to(self, noise: NoiseModel, /, *, powers: Float, frames: float) -> NoiseModel:
        """Return the noise of a pixel with the noise of the calibration added.

        The noise model describes a single recording, and the variance of a mean is that over `frames`. The
        calibration's noise does not get smaller in a mean, so `frames` times its variance is added. `powers`, (H,), are
        the typical |p|² of each harmonic.
        """
        steps = np.round(STEPS_PER_OCTAVE * np.log2(np.clip(powers, 1e-6, 1.0)))
        return _with_calibration(noise, self, tuple((2.0 ** (steps / STEPS_PER_OCTAVE)).tolist()), frames)


@lru_cache(maxsize=8)
def _with_calibration(
    noise: NoiseModel, left: CalibrationNoise, powers: tuple[float, ...], frames: float
) -> NoiseModel:
    each = tuple(
        replace(one, floor=float(one.floor + frames * (dark + share * power)))
        for one, dark, share, power in zip(noise.each, left.dark, left.response, powers, strict=True)
    )
    return replace(noise, each=each)


@dataclass(frozen=True, eq=False)
class FrameCorrection:
    """The corrections of the n = Y·X pixels of a frame.

    Attributes:
        phasor_map: from stored values to phasors.
        response: the response with which paths are resolved, if a channel pair has terms besides k = ±1; else None.
        hot: (n,), pixels that get no answer; None if there are none.
        range_offset_m: (n,), the length that the lens adds to every range; None: 0.
        noise: the noise of the calibration's own frames; None without a dark or response calibration.
    """

    phasor_map: PhasorMap
    response: "ResponseBlock | None" = None
    hot: Bool | None = None
    range_offset_m: Float | None = None
    noise: CalibrationNoise | None = None


def frame_correction(
    calibration: "Calibration | None",
    metadata: CaptureMetadata,
    dtype: np.dtype[np.generic],
    pixels: tuple[int, int],
    /,
) -> FrameCorrection:
    """Return the correction of frames of `pixels` (Y, X); without a calibration, it follows from waveform and pulse alone.

    Raises:
        SettingsError: the calibration does not belong to the capture; or see `volts_per_count`.
    """
    ideal = ideal_response(metadata)
    if calibration is None:
        return FrameCorrection(ideal_phasor_map(metadata, dtype), tabulated_responses(ideal, None))
    calibration.require_match(metadata, pixels)
    dark, response = calibration.dark, calibration.response
    responses = response.responses if response else ideal
    count = pixels[0] * pixels[1]
    phase = response.phase_rad.reshape(-1, count).astype(np.float64) if response else None
    phasor_map = pixel_phasor_map(
        responses,
        metadata,
        dtype,
        offset_v=dark.offset_v.reshape(*dark.offset_v.shape[:2], count) if dark else None,
        phase_rad=phase,
        gain=response.gain.reshape(-1, count) if response else None,
        pixels=count,
    )
    return FrameCorrection(
        phasor_map,
        tabulated_responses(responses, phase),
        dark.hot.ravel() if dark is not None and dark.hot.any() else None,
        calibration.curvature.added_m(pixels).ravel() if calibration.curvature else None,
        _noise(calibration, responses, metadata.modulation.amplitude_v),
    )


def tabulated_responses(responses: Sequence[HarmonicResponse], phase_rad: Float | None, /) -> "ResponseBlock | None":
    """Return the responses as tables; None if they have no terms but k = ±1, which the phasor map inverts."""
    if all(response.linear for response in responses):
        return None
    from cadtof_cli.resolver.response.table import response_block

    return response_block(responses, phase_rad)


def _noise(
    calibration: "Calibration", responses: Sequence[HarmonicResponse], amplitude_v: float
) -> CalibrationNoise | None:
    """Return the noise of dark frames and of frames of targets that is left in phasors; a part of unknown noise adds
    nothing."""
    dark, response = calibration.dark, calibration.response
    if dark is None and response is None:
        return None
    offsets_v = dark.offset_stderr_v() if dark else (0.0,) * len(responses)
    phases = response.quality.phase_stderr_rad if response else (0.0,) * len(responses)
    # the relative error of a pixel's gain is as large as the error of its phase, because both come from the same noise
    return CalibrationNoise(
        tuple((volts / amplitude_v / abs(one.main)) ** 2 for volts, one in zip(offsets_v, responses, strict=True)),
        tuple(phase**2 for phase in phases),
    )
