"""Figs. 4 and 5: the inter-reflection and the corner, recorded in simulation and resolved."""

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.execution.workers import Workers
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.pipeline import resolve_frame
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Band, Exposure, frame_voltages
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import Corner, InterReflection
from cadtof_cli.workflows.simulate.record import expose
from cadtof_cli.workflows.simulate.simulate import write_rows
from paper.effort import SEED, Effort

ROW = 120
DIRECT, MEASURED, TRUTH = "#1b6ca8", "#d1495b", "#e8871e"

PETZVAL_M = (-0.12, 0.03)
"""Field curvature of Fig. 4(c), which bends the measured distance by some centimetres over the panel."""


@dataclass(frozen=True)
class Recorded:
    """A scene recorded over some frames.

    Attributes:
        truth_m: (Y, X) range.
        first_m: (T, Y, X) range from the first phasor alone.
        direct_m: (T, Y, X) range of the resolved direct path.
    """

    truth_m: Float
    first_m: Float
    direct_m: Float


def recorded(scene: Scene, effort: Effort, *, camera: Camera | None = None) -> Recorded:
    """Record frames of a scene through the converter, and resolve them."""
    camera = camera or Camera()
    metadata = CaptureMetadata(pixel=Pixel(integration_length=1.0e5), optics=camera.optics, voltage=camera.voltage)
    exposure = Exposure(scene=scene, camera=camera, metadata=metadata, seed=SEED)
    whole = expose(exposure, workers=Workers(jobs=effort.jobs))
    plan = FramePlan(metadata=metadata)
    frames = [_frame(exposure, whole, plan, index) for index in range(effort.frames)]
    first, direct = (np.stack(maps) for maps in zip(*frames, strict=True))
    return Recorded(whole.truth["direct.depth"], first, direct)


def _frame(exposure: Exposure, whole: Band, plan: FramePlan, index: int) -> tuple[Float, Float]:
    counts = exposure.camera.counts_from_voltages(frame_voltages(exposure, whole, index))
    maps = resolve_frame(counts, plan=plan).maps
    volts = (counts[0].astype(np.float64) - exposure.camera.zero_counts) * exposure.camera.volts_per_count
    turns = np.mod(np.arctan2(volts[1], volts[0]) / (2 * np.pi), 1.0)
    reach = 0.299792458 * exposure.metadata.modulation.periods_ns[0] / 2.0
    return turns * reach, maps.pages[maps.names.index("direct.depth")].astype(np.float64)


@dataclass(frozen=True)
class Figure4:
    """Distance of the panel's middle, in cm: without and with the second object, and resolved with it."""

    without_cm: float
    with_cm: float
    resolved_cm: float


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
        "with it, resolved": profile(with_object.direct_m),
    }
    figure = Figure(figsize=(11, 4.4), dpi=110, layout="constrained")
    image, axes = figure.subplots(1, 2, width_ratios=(1, 1.3))
    shown = image.imshow(100 * (with_object.first_m - without.first_m).mean(axis=0), vmin=-3, vmax=3, cmap="RdBu_r")
    figure.colorbar(shown, ax=image, label="change by the second object (cm)", shrink=0.75)
    image.set(xlabel="column (px)", ylabel="row (px)", title="first phasor")
    image.axhline(ROW, color="black", lw=0.6)
    for (label, line), colour in zip(lines.items(), ("black", MEASURED, DIRECT), strict=True):
        axes.plot(columns, line, color=colour, lw=1.2, label=label)
    axes.set(xlabel="column (px)", ylabel="planar distance (cm)", title="profile across the panel; bent by the lens")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(effort.out / "fig4.png")
    write_rows(
        effort.out / "fig4.csv",
        ("column_px", "without_cm", "with_cm", "resolved_cm"),
        zip(columns, *lines.values(), strict=True),
    )
    middle = np.abs(columns - 159.5) < 12
    return Figure4(*(float(np.mean(line[middle])) for line in lines.values()))


@dataclass(frozen=True)
class Figure5:
    """Median and 90 % of the absolute depth error of the corner in cm, first phasor and resolved; angle in degrees."""

    first_cm: tuple[float, float]
    resolved_cm: tuple[float, float]
    bias_cm: tuple[float, float]
    opening_deg: tuple[float, float, float]


def figure_5(effort: Effort) -> Figure5:
    """Record the corner, and draw its depth profile before and after."""
    camera = Camera()
    corner = recorded(replace(Corner(), asr=1.0), effort)
    rays = camera.rays(slice(0, camera.height))
    planar = 1.0 / np.linalg.norm(rays, axis=0)
    rows = slice(ROW - 5, ROW + 5)
    truth = corner.truth_m * planar
    first, direct = corner.first_m * planar, corner.direct_m * planar
    lines = [
        np.nanmedian(truth[rows], axis=0),
        np.nanmedian(first[:, rows], axis=(0, 1)),
        np.nanmedian(direct[:, rows], axis=(0, 1)),
    ]
    _draw_corner(effort, lines, first[0], direct[0])
    write_rows(
        effort.out / "fig5.csv",
        ("column_px", "truth_m", "first_phasor_m", "resolved_m"),
        zip(range(camera.width), *lines, strict=True),
    )

    def spread(depth: Float) -> tuple[float, float]:
        error = 100 * np.abs(depth - truth)
        return float(np.nanmedian(error)), float(np.nanquantile(error, 0.9))

    biases = [float(100 * np.nanmedian(depth - truth)) for depth in (first, direct)]
    sides = rays[0, ROW]
    angles = [_opening_deg(sides, line) for line in lines]
    return Figure5(spread(first), spread(direct), (biases[0], biases[1]), (angles[0], angles[1], angles[2]))


def _opening_deg(sides: Float, depth_m: Float) -> float:
    """Return the angle between straight lines through the left and the right profile, within 0.35 m of the edge."""
    x = sides * depth_m
    slopes = []
    for side in (-1.0, 1.0):
        near = (side * x > 0.02) & (side * x < 0.35) & np.isfinite(depth_m)
        slopes.append(np.polyfit(x[near], depth_m[near], 1)[0])
    return float(180.0 - np.degrees(np.arctan(slopes[0]) - np.arctan(slopes[1])))


def _draw_corner(effort: Effort, lines: list[Float], first: Float, direct: Float) -> None:
    figure = Figure(figsize=(14, 4.2), dpi=110, layout="constrained")
    before, after, axes = figure.subplots(1, 3, width_ratios=(1, 1, 1.4))
    for image, depth, title in ((before, first, "first phasor"), (after, direct, "resolved, one frame")):
        shown = image.imshow(depth, vmin=1.25, vmax=2.05, cmap="viridis")
        image.axhline(ROW, color="white", lw=0.6)
        image.set(title=title, xlabel="column (px)", ylabel="row (px)")
    figure.colorbar(shown, ax=(before, after), label="planar depth (m)", shrink=0.75)
    for line, colour, label in zip(
        lines, (TRUTH, MEASURED, DIRECT), ("true", "first phasor, as measured", "resolved direct path"), strict=True
    ):
        axes.plot(line, color=colour, lw=1.3, label=label)
    axes.set(xlabel="column (px)", ylabel="planar depth (m)", title=f"cross-section, {effort.frames} frames")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(effort.out / "fig5.png")
