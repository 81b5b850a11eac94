"""A calibration made ready for frames of one size and type: what the pipeline applies to every block."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Stored
from cadtof_cli.calibration.petzval import curvature_m, middle_px
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.correction import PixelCorrection, corrected_phasors, pixel_correction
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.phasors.voltages import PhasorScale, phasors_from_voltages
from cadtof_cli.resolver.response.table import ResponseModel, response_model


@dataclass(frozen=True, eq=False)
class FrameCorrection:
    """What is done to the pixels of a frame besides the ideal sine's arithmetic; None is nothing.

    Attributes:
        phasors: phasors, (H, n), from the stored values, (H, 2, n), of the block that a slice names.
        response: for resolving paths, where the channel pairs answer with more than k = ±1.
        hot: (Y·X,), pixels that get no answer.
        range_offset_m: (Y·X,), what the lens adds to every range.
    """

    phasors: Callable[[Stored, slice], Complex]
    response: ResponseModel | None = None
    hot: Bool | None = None
    range_offset_m: Float | None = None


def frame_correction(
    calibration: Calibration | None, metadata: CaptureMetadata, scale: PhasorScale, pixels: tuple[int, int], /
) -> FrameCorrection:
    """Return the correction of frames of `pixels` (Y, X); without a calibration, what waveform and pulse alone call for.

    Raises:
        SettingsError: the calibration does not belong to the capture.
    """
    if calibration is None:
        return FrameCorrection(partial(_ideal_phasors, scale=scale), response_model(ideal_response(metadata), None))
    calibration.require_match(metadata, pixels)
    dark, response = calibration.dark, calibration.response
    responses = response.responses if response else ideal_response(metadata)
    count = pixels[0] * pixels[1]
    phase = response.phase_rad.reshape(-1, count).astype(np.float64) if response else None
    correction = pixel_correction(
        responses,
        volts_per_count=metadata.voltage.volts_per_count or 1.0,
        zero_counts=scale.zero,
        amplitude_v=scale.amplitude_v,
        offset_v=dark.offset_v.reshape(*dark.offset_v.shape[:2], count) if dark else None,
        phase_rad=phase,
        gain=response.gain.reshape(-1, count) if response else None,
        pixels=count,
    )
    hot = dark.hot.ravel() if dark is not None and dark.hot.any() else None
    return FrameCorrection(
        partial(_corrected, correction=correction),
        response_model(responses, phase),
        hot,
        _range_offset(calibration, metadata, pixels),
    )


def _range_offset(calibration: Calibration, metadata: CaptureMetadata, pixels: tuple[int, int]) -> Float | None:
    """Return what the Petzval calibration says, or else what the response's phase maps were freed of."""
    if calibration.petzval is not None:
        return calibration.petzval.range_offset_m.ravel()
    if calibration.response is not None and any(calibration.response.field_curvature_m):
        point = metadata.optics.principal_point_px or middle_px(pixels)
        return curvature_m(pixels, point, calibration.response.field_curvature_m).ravel()
    return None


def _ideal_phasors(stored: Stored, _block: slice, *, scale: PhasorScale) -> Complex:
    return phasors_from_voltages(stored, scale=scale)


def _corrected(stored: Stored, block: slice, *, correction: PixelCorrection) -> Complex:
    return corrected_phasors(stored, correction=correction, block=block)
