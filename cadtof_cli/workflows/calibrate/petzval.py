"""`cadtof calibrate petzval`: flat walls → the field curvature of the lens. Frames are read, never changed."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from cadtof_cli.calibration.fit.petzval import WallRanges, fit_petzval
from cadtof_cli.calibration.parts import FieldCurvature
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.frames import Capture
from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.figures.kinds import require_picture
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.frame_mean import MeanVolts
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings, SolverName
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.workflows.calibrate.captures import (
    CalibrateReport,
    CalibrateSettings,
    averaged_captures,
    save_with_report,
)
from cadtof_cli.workflows.progress import Progress


def calibrate_petzval(
    inputs: Sequence[Path], /, *, settings: CalibrateSettings, progress: Progress, plot: Path | None = None
) -> CalibrateReport:
    """Measure the Petzval part from captures of one or several flat walls, write it, and draw it into `plot` if that is given.

    Raise CadtofError as `averaged_captures` and `fit_petzval` do.
    """
    if plot is not None:
        require_picture(plot, overwrite=settings.overwrite)
    averaged = averaged_captures(inputs, "petzval", settings=settings, progress=progress)
    earlier = averaged.earlier
    walls = [_wall(capture, mean, settings.out, earlier) for capture, mean in averaged.captures]
    petzval = fit_petzval(walls, optics=averaged.captures[0][0].source.metadata.optics, origin=averaged.origin)
    if earlier and earlier.response:
        petzval = replace(petzval, curvature=_with_shared_uncertainty(petzval.curvature, earlier.response.curvature))
    tables, quality = petzval.tables(), petzval.quality
    figures = tables["coefficients"] | tables["residual"] | {"focal_length_px": quality.focal_length_px}
    report = save_with_report(
        petzval, settings, figures | {"walls": [asdict(wall) for wall in quality.walls]}, quality.findings
    )
    if plot is None:
        return report
    from cadtof_cli.figures.petzval import draw_petzval

    draw_petzval([wall.range_m for wall in walls], petzval, plot)
    return replace(report, written=(*report.written, str(plot)))


def _wall(capture: Capture, mean: MeanVolts, folder: Path, earlier: Calibration | None) -> WallRanges:
    """Resolve the mean of a wall's frames. Its noise is that of one frame, divided by the square root of their number.

    Harmonics that cannot tell one path from two give one path in each pixel.
    """
    metadata = capture.source.metadata
    n_av = metadata.pixel.integration_length
    lengths = tuple(length * mean.frames for length in n_av) if isinstance(n_av, tuple) else n_av and n_av * mean.frames
    pixel = replace(metadata.pixel, integration_length=lengths)
    use = CalibrationUse(folder, earlier.digest, curved=False) if earlier else None
    harmonics = metadata.modulation.harmonics
    solver: SolverName = "two-path" if harmonics == (1, 2) or len(harmonics) > 2 else "one-path"
    settings = MapSettings(resolver=ResolverSettings(mpi_model="discrete", solver=solver))
    in_volts = replace(metadata, voltage=Voltage(), pixel=pixel)
    plan = FramePlan(metadata=in_volts, settings=settings, calibration=use)
    maps = resolve_frame(mean.volts, plan=plan, calibration=earlier).maps
    single = (maps.status & StatusBit.ONE_PATH) != 0
    ranges, sigma = (
        np.where(single, maps.layer(name), np.nan).astype(np.float64) for name in (DIRECT_DEPTH, DIRECT_SIGMA)
    )
    return WallRanges(ranges, sigma, metadata.target.distance_m)


def _with_shared_uncertainty(found: FieldCurvature, earlier: FieldCurvature) -> FieldCurvature:
    """Add the uncertainty of the response calibration, which cannot tell curvature from pixel phases that look like it."""
    return replace(
        found,
        k2_stderr_m=float(np.hypot(found.k2_stderr_m, earlier.k2_stderr_m)),
        k4_stderr_m=float(np.hypot(found.k4_stderr_m, earlier.k4_stderr_m)),
    )
