"""Figs. 4 and 5: the inter-reflection and the corner, recorded in simulation and resolved."""

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from with_truth import resolved

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.execution.workers import Workers
from cadtof_cli.figures.canvas import legend_beside
from cadtof_cli.files.documents import write_rows
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.pipeline.first_phasor import first_phasor_depth
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Band, Exposure, frame_voltages
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import Corner, InterReflection
from cadtof_cli.workflows.simulate.record import expose
from paper.effort import SEED, Effort

ROW = 120
DIRECT, MEASURED, TRUTH, DISCRETE = "#1b6ca8", "#d1495b", "#e8871e", "#5aa469"

STYLES = ("-", "--", "-.", ":")
"""Lines of the four curves: colours alone do not tell them apart in black and white."""

PETZVAL_M = (-0.12, 0.03)
"""Field curvature of Fig. 4(c), which bends the measured distance by some centimetres over the panel."""


@dataclass(frozen=True)
class Recorded:
    """A scene recorded over some frames.

    Attributes:
        truth_m: (Y, X) range.
        first_m: (T, Y, X) range from the first phasor alone.
        direct_m: (T, Y, X) range of the resolved direct path by the default MPI model, which decides for each frame.
        discrete_m: (T, Y, X) range of the resolved direct path with MPI as separate paths.
        taken: what the default model takes the MPI of the frames for, `diffuse` or `discrete`.
    """

    truth_m: Float
    first_m: Float
    direct_m: Float
    discrete_m: Float
    taken: str


def recorded(scene: Scene, effort: Effort, *, camera: Camera | None = None) -> Recorded:
    """Record frames of a scene through the converter, and resolve them."""
    camera = camera or Camera()
    metadata = CaptureMetadata(pixel=Pixel(integration_length=1.0e5), optics=camera.optics, voltage=camera.voltage)
    exposure = Exposure(scene=scene, camera=camera, metadata=metadata, seed=SEED)
    whole = expose(exposure, workers=Workers(jobs=effort.jobs))
    frames = [_frame(exposure, whole, index) for index in range(effort.frames)]
    first, direct, discrete = (np.stack(maps) for maps in list(zip(*frames, strict=True))[:3])
    taken = " or ".join(sorted({frame[3] for frame in frames}))
    return Recorded(whole.truth["direct.depth"], first, direct, discrete, taken)


def _frame(exposure: Exposure, whole: Band, index: int) -> tuple[Float, Float, Float, str]:
    counts = exposure.camera.counts_from_voltages(frame_voltages(exposure, whole, index))
    auto, alone = (
        resolved(counts, exposure.metadata, model="auto"),
        resolved(counts, exposure.metadata, model="discrete"),
    )
    direct, discrete = (one.maps.layer(DIRECT_DEPTH).astype(np.float64) for one in (auto, alone))
    first = first_phasor_depth(counts, plan=FramePlan(metadata=exposure.metadata))
    return first, direct, discrete, auto.mpi.taken if auto.mpi else "discrete"


@dataclass(frozen=True)
class Figure4:
    """Distance of the panel's middle in cm.

    Attributes:
        without_cm: without the second object.
        with_cm: with the second object, by the first phasor.
        resolved_cm: with the second object, by the default MPI model.
        discrete_cm: with the second object, with MPI as separate paths.
        taken: what the default model takes the MPI for.
    """

    without_cm: float
    with_cm: float
    resolved_cm: float
    discrete_cm: float
    taken: str


def figure_4(effort: Effort) -> Figure4:
    """Record the panel without and with the second object, and draw a profile across it."""
    camera = Camera(petzval_m=PETZVAL_M)
    without = recorded(InterReflection(mpi_ratio=0.0), effort, camera=camera)
    with_object = recorded(InterReflection(), effort, camera=camera)
    planar = camera.rays(slice(ROW - 5, ROW + 5))
    scale = 1.0 / np.linalg.norm(planar, axis=0)
    columns = np.arange(104, 217)

    def profile(depth: Float) -> Float:
        return np.asarray(100 * np.nanmedian(depth[:, ROW - 5 : ROW + 5] * scale, axis=(0, 1))[columns])

    lines = {
        "without the second object": profile(without.first_m),
        "with it, first phasor": profile(with_object.first_m),
        f"with it, resolved: MPI {with_object.taken}, by default": profile(with_object.direct_m),
        "with it, resolved: MPI discrete": profile(with_object.discrete_m),
    }
    figure = Figure(figsize=(13.5, 4.4), dpi=110, layout="constrained")
    image, axes = figure.subplots(1, 2, width_ratios=(1, 1.3))
    shown = image.imshow(100 * (with_object.first_m - without.first_m).mean(axis=0), vmin=-3, vmax=3, cmap="RdBu_r")
    figure.colorbar(shown, ax=image, label="change by the second object, cm", shrink=0.75)
    image.set(xlabel="column, px", ylabel="row, px", title="first phasor")
    image.axhline(ROW, color="black", lw=0.6)
    for (label, line), colour, style in zip(lines.items(), ("black", MEASURED, DIRECT, DISCRETE), STYLES, strict=True):
        axes.plot(columns, line, style, color=colour, lw=1.2, label=label)
    axes.set(xlabel="column, px", ylabel="planar distance, cm", title="profile across the panel; bent by the lens")
    legend_beside(axes)
    axes.grid(alpha=0.3)
    figure.savefig(effort.out / "fig4.png")
    write_rows(
        effort.out / "fig4.csv",
        ("column_px", "without_cm", "with_cm", "resolved_cm", "resolved_discrete_cm"),
        zip(columns, *lines.values(), strict=True),
    )
    middle = np.abs(columns - 159.5) < 12
    without_cm, with_cm, resolved_cm, discrete_cm = (float(np.mean(line[middle])) for line in lines.values())
    return Figure4(without_cm, with_cm, resolved_cm, discrete_cm, with_object.taken)


@dataclass(frozen=True)
class Figure5:
    """Depth errors of the corner in cm, and its angles in degrees.

    Each error has three values: first phasor, default MPI model, and MPI as separate paths.

    Attributes:
        spread_cm: median and 90 % of the magnitude of the error.
        bias_cm: median of the error.
        opening_deg: angle between the planes: the true angle first, then of the three depths.
        taken: what the default model takes the MPI for.
    """

    spread_cm: tuple[tuple[float, float], ...]
    bias_cm: tuple[float, ...]
    opening_deg: tuple[float, ...]
    taken: str


def figure_5(effort: Effort) -> Figure5:
    """Record the corner, and draw its depth profile before and after."""
    camera = Camera()
    corner = recorded(replace(Corner(), asr=1.0), effort)
    rays = camera.rays(slice(0, camera.height))
    planar = 1.0 / np.linalg.norm(rays, axis=0)
    rows = slice(ROW - 5, ROW + 5)
    truth = corner.truth_m * planar
    found = [depth * planar for depth in (corner.first_m, corner.direct_m, corner.discrete_m)]
    lines = [np.nanmedian(truth[rows], axis=0), *(np.nanmedian(depth[:, rows], axis=(0, 1)) for depth in found)]
    _draw_corner(effort, lines, found[0][0], found[1][0], taken=corner.taken)
    write_rows(
        effort.out / "fig5.csv",
        ("column_px", "truth_m", "first_phasor_m", "resolved_m", "resolved_discrete_m"),
        zip(range(camera.width), *lines, strict=True),
    )

    def spread(depth: Float) -> tuple[float, float]:
        error = 100 * np.abs(depth - truth)
        return float(np.nanmedian(error)), float(np.nanquantile(error, 0.9))

    biases = (float(100 * np.nanmedian(depth - truth)) for depth in found)
    angles = (_opening_deg(rays[0, ROW], line) for line in lines)
    return Figure5(tuple(map(spread, found)), tuple(biases), tuple(angles), corner.taken)


def _opening_deg(sides: Float, depth_m: Float) -> float:
    """Return the angle between straight lines through the left and the right profile, within 0.35 m of the edge."""
    x = sides * depth_m
    slopes = []
    for side in (-1.0, 1.0):
        near = (side * x > 0.02) & (side * x < 0.35) & np.isfinite(depth_m)
        slopes.append(np.polyfit(x[near], depth_m[near], 1)[0])
    return float(180.0 - np.degrees(np.arctan(slopes[0]) - np.arctan(slopes[1])))


def _draw_corner(effort: Effort, lines: list[Float], first: Float, direct: Float, *, taken: str) -> None:
    figure = Figure(figsize=(16.5, 4.2), dpi=110, layout="constrained")
    before, after, axes = figure.subplots(1, 3, width_ratios=(1, 1, 1.4))
    for image, depth, title in ((before, first, "first phasor"), (after, direct, "resolved, one frame")):
        shown = image.imshow(depth, vmin=1.25, vmax=2.05, cmap="viridis")
        image.axhline(ROW, color="white", lw=0.6)
        image.set(title=title, xlabel="column, px", ylabel="row, px")
    figure.colorbar(shown, ax=(before, after), label="planar depth, m", shrink=0.75)
    for line, colour, style, label in zip(
        lines,
        (TRUTH, MEASURED, DIRECT, DISCRETE),
        STYLES,
        ("true", "first phasor, as measured", f"resolved: MPI {taken}, by default", "resolved: MPI discrete"),
        strict=True,
    ):
        axes.plot(line, style, color=colour, lw=1.3, label=label)
    axes.set(xlabel="column, px", ylabel="planar depth, m", title=f"cross-section, {effort.frames} frames")
    legend_beside(axes)
    axes.grid(alpha=0.3)
    figure.savefig(effort.out / "fig5.png")
