"""Values of `capture.toml` that are allowed, but that no camera has: they were probably given in another unit."""

import math

from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.units import unambiguous_range_m

_LONGEST_PERIOD_NS = 1e4
"""Fundamental period, for depths up to 1.5 km, above which it is probably not in ns."""

_WIDEST_VIEW_DEG = 140.0
"""Widest angle of view for which a lens can be treated as a pinhole."""

_FAR_LAMP_M = 1.0
"""Distance of the lamp from the camera above which its position is probably not in m."""

_LARGE_ARRAY = 16
"""Width or height in pixels above which a principal point in the first pixel is probably a mistake."""


def mistaken_unit(metadata: CaptureMetadata, pixels: tuple[int, int], /) -> str | None:
    """Return in words which value is allowed, but probably in another unit, for an array (Y, X); None: none seems to be."""
    optics, across, period = metadata.optics, max(pixels), metadata.modulation.periods_ns[0]
    focal, point = optics.focal_length_px, optics.principal_point_px
    lamp_m = math.hypot(*optics.lamp_offset_m or ())
    if period > _LONGEST_PERIOD_NS:
        far_m = unambiguous_range_m(period)
        return f"modulation.periods_ns = {period:g}, … means depths up to {far_m:.4g} m: is it in ps instead of ns?"
    if focal is not None and (view_deg := 2.0 * math.degrees(math.atan(across / 2.0 / focal))) > _WIDEST_VIEW_DEG:
        return (
            f"optics.focal_length_px = {focal:g} means a view of {view_deg:.0f}°: is the value in mm instead of pixels?"
        )
    if point is not None and across > _LARGE_ARRAY and min(point) >= 0.0 and max(point) <= 1.0:
        return (
            f"optics.principal_point_px = {point[0]:g}, {point[1]:g} lies in a corner of the frame: is the value a share of "
            "width and height instead of pixels?"
        )
    if lamp_m > _FAR_LAMP_M:
        return f"optics.lamp_offset_m puts the lamp {lamp_m:g} m from the camera: is the value in cm instead of m?"
    return None
