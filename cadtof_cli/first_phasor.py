"""What the first phasor alone says of a frame: the depth that MPI pulls off, and that the resolver is held against.

It is given all that the resolver is given: the same calibration, the same means over frames and neighbours, the same units.
"""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Float, Stored
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.maps.layers import without_offset
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.pipeline import frame_stages, prepare_frame
from cadtof_cli.resolver.response.as_sine import first_phase


def first_phasor_depth(
    frame: Stored | FrameMean, /, *, plan: FramePlan, calibration: Calibration | None = None
) -> Float:
    """Return the depth that the fundamental's phase alone gives, float64 (Y, X) in m; NaN where pixels are saturated or hot.

    Args:
        frame: stored values, (H, 2, Y, X), or the mean of several frames.
        plan: that of the maps; it says whether depth is radial range or planar.
        calibration: the one that the plan names.

    Raises:
        FrameError: the noise must be estimated from the frame, and too few of its pixels are finite.
        SettingsError: the plan does not fit the frame's type.
    """
    settings = replace(plan.settings, resolver=replace(plan.settings.resolver, mpi_model="discrete"))
    pixels = prepare_frame(frame, plan=replace(plan, settings=settings), calibration=calibration)
    stages, everywhere = frame_stages(plan, calibration, pixels.dtype, pixels.size), slice(0, pixels.count)
    response = stages.correction.response
    phase = first_phase(stages.phasors(pixels)[0], response=response.block(everywhere) if response else None)
    phase = without_offset(phase, stages.depth.phase_offset_rad(everywhere))
    phase[stages.status(pixels) != 0] = np.nan
    depth: Float = phase * stages.depth.metres(everywhere)
    return depth.reshape(pixels.size)
