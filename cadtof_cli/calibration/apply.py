"""A calibration made ready for frames of one size and type: what the pipeline applies to every block."""

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.optics import curvature_m
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.phasors.voltages import PhasorMap, ideal_phasor_map, pixel_phasor_map
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration
    from cadtof_cli.resolver.response.table import ResponseBlock


STEPS_PER_OCTAVE = 4
"""Powers of light that are told apart, for every factor of two: frames of about the same light share what follows from noise."""


@dataclass(frozen=True)
class CalibrationNoise:
    """What the noise of a calibration's own frames leaves in a pixel's phasors, the same in all frames that it is applied to.

    Attributes:
        dark: variance per channel and harmonic by the dark frames, in units of the modulation amplitude.
        response: by the frames of targets, over the power |p|² of the light.
    """

    dark: tuple[float, ...]
    response: tuple[float, ...]

    def added_to(self, noise: NoiseModel, /, *, powers: Float, frames: float) -> NoiseModel:
        """Return the noise of a pixel recorded in so many frames with what is the same in all of them.

        Args:
            noise: of a single recording; the mean of all has that over `frames`, in which the calibration's must be found whole.
            powers: typical |p|² of each harmonic, (H,).
            frames: over which the pixel is a mean.
        """
        steps = np.round(STEPS_PER_OCTAVE * np.log2(np.clip(powers, 1e-6, 1.0)))
        return _with_calibration(noise, self, tuple((2.0 ** (steps / STEPS_PER_OCTAVE)).tolist()), frames)


@lru_cache(maxsize=8)
def _with_calibration(
    noise: NoiseModel, left: CalibrationNoise, powers: tuple[float, ...], frames: float
) -> NoiseModel:
    return noise.with_more(
        [frames * (dark + share * power) for dark, share, power in zip(left.dark, left.response, powers, strict=True)]
    )


@dataclass(frozen=True, eq=False)
class FrameCorrection:
    """What is done to the n = Y·X pixels of a frame.

    Attributes:
        phasor_map: from stored values to phasors.
        response: for resolving paths, where the channel pairs answer with more than k = ±1; None where they do not.
        hot: (n,), pixels that get no answer; None where there are none.
        range_offset_m: (n,), what the lens adds to every range; None where that is nothing.
        noise: what is left of the calibration's own; None without a dark or response calibration.
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
    """Return the correction of frames of `pixels` (Y, X); without a calibration, what waveform and pulse alone require.

    Raises:
        SettingsError: the calibration does not belong to the capture, or nothing says how many volts one count stands for.
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
        _range_offset_m(calibration, metadata, pixels),
        _noise(calibration, responses, metadata.modulation.amplitude_v),
    )


def tabulated_responses(responses: Sequence[HarmonicResponse], phase_rad: Float | None) -> "ResponseBlock | None":
    """Return the responses, tabulated; None where they have no terms but k = ±1, which are inverted before paths are resolved."""
    if all(response.linear for response in responses):
        return None
    from cadtof_cli.resolver.response.table import response_block

    return response_block(responses, phase_rad)


def _noise(
    calibration: "Calibration", responses: Sequence[HarmonicResponse], amplitude_v: float
) -> CalibrationNoise | None:
    """Return what is left of the noise of dark frames and of targets; a part whose frames do not tell theirs adds nothing."""
    dark, response = calibration.dark, calibration.response
    if dark is None and response is None:
        return None
    offsets_v = dark.offset_stderr_v() if dark else (0.0,) * len(responses)
    phases = response.quality.phase_stderr_rad if response else (0.0,) * len(responses)
    # how far a pixel's gain is known follows from the same noise as its phase
    return CalibrationNoise(
        tuple((volts / amplitude_v / abs(one.main)) ** 2 for volts, one in zip(offsets_v, responses, strict=True)),
        tuple(phase**2 for phase in phases),
    )


def _range_offset_m(calibration: "Calibration", metadata: CaptureMetadata, pixels: tuple[int, int]) -> Float | None:
    """Return the offset of the Petzval calibration, or else the curvature that was taken out of the response's phase maps."""
    if calibration.petzval is not None:
        return calibration.petzval.range_offset_m.ravel()
    if calibration.response is not None and any(calibration.response.field_curvature_m):
        point = metadata.optics.principal_point(pixels)
        return curvature_m(pixels, point, calibration.response.field_curvature_m).ravel()
    return None
