"""The depth of the first phasor alone. MPI makes it wrong, and the resolver is compared with it.

It gets all that the resolver gets: the same calibration, the same means over frames and neighbours, the same units.
"""

import math
from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Float, Stored
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.maps.layers import without_offset
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.pipeline.frame import prepare_frame, stages_of
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.response.as_sine import first_phase


def first_phasor_depth(
    frame: Stored | FrameMean, /, *, plan: FramePlan, calibration: Calibration | None = None
) -> Float:
    """Return the depth from the phase of the fundamental alone, float64 (Y, X) in m; NaN if a pixel is saturated or hot.

    Args:
        frame: stored values, (H, 2, Y, X), or the mean of several frames.
        plan: plan of the maps; it says whether depth is radial range or planar.
        calibration: the calibration that the plan names.

    Raises:
        FrameError: the noise must be estimated from the frame, and too few of its pixels are finite.
        SettingsError: the plan does not fit the frame's type.
    """
    settings = replace(plan.settings, resolver=replace(plan.settings.resolver, mpi_model="discrete"))
    pixels = prepare_frame(frame, stages_of(frame, replace(plan, settings=settings), calibration))
    stages = stages_of(frame, plan, calibration)
    everywhere = slice(0, math.prod(pixels.size))
    response = stages.response
    phase = first_phase(stages.phasors(pixels)[0], response=response.block(everywhere) if response else None)
    phase = without_offset(phase, stages.depth.phase_offset_rad(everywhere))
    phase[stages.status(pixels) != 0] = np.nan
    return stages.depth.from_camera(phase * stages.depth.metres(everywhere), everywhere).reshape(pixels.size)
