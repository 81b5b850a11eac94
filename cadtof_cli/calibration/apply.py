"""A calibration made ready for frames of one size and type: what the pipeline applies to every block."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.optics import curvature_m
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.phasors.voltages import PhasorMap, ideal_phasor_map, pixel_phasor_map
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration
    from cadtof_cli.resolver.response.table import ResponseBlock


@dataclass(frozen=True, eq=False)
class FrameCorrection:
    """What is done to the n = Y·X pixels of a frame.

    Attributes:
        phasor_map: from stored values to phasors.
        response: for resolving paths, where the channel pairs answer with more than k = ±1; None where they do not.
        hot: (n,), pixels that get no answer; None where there are none.
        range_offset_m: (n,), what the lens adds to every range; None where that is nothing.
    """

    phasor_map: PhasorMap
    response: "ResponseBlock | None" = None
    hot: Bool | None = None
    range_offset_m: Float | None = None


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
    )


def tabulated_responses(responses: Sequence[HarmonicResponse], phase_rad: Float | None) -> "ResponseBlock | None":
    """Return the responses, tabulated; None where they have no terms but k = ±1, which are inverted before paths are resolved."""
    if all(response.linear for response in responses):
        return None
    from cadtof_cli.resolver.response.table import response_block

    return response_block(responses, phase_rad)


def _range_offset_m(calibration: "Calibration", metadata: CaptureMetadata, pixels: tuple[int, int]) -> Float | None:
    """Return the offset of the Petzval calibration, or else the curvature that was taken out of the response's phase maps."""
    if calibration.petzval is not None:
        return calibration.petzval.range_offset_m.ravel()
    if calibration.response is not None and any(calibration.response.field_curvature_m):
        point = metadata.optics.principal_point(pixels)
        return curvature_m(pixels, point, calibration.response.field_curvature_m).ravel()
    return None
