"""`cadtof calibrate dark | response | petzval`."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

from cadtof_cli.commands.help import HelpContext, SectionedCommand, example
from cadtof_cli.commands.map_options import CAPTURE_HEADING, capture_options, settings_option
from cadtof_cli.commands.options import Decorator, RecordOptions, declared_options, input_paths, note_given, null_option
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import INPUT, PATH
from cadtof_cli.units import counted
from cadtof_cli.workflows.calibrate.captures import CalibrateReport, CalibrateSettings
from cadtof_cli.workflows.calibrate.dark import calibrate_dark
from cadtof_cli.workflows.calibrate.petzval import calibrate_petzval
from cadtof_cli.workflows.calibrate.response import calibrate_response

_SMALL = "--width 80 --height 60"
_COVERED = f"cadtof simulate --scene wall --asr 1e6 {_SMALL} --frames 20 -o covered"
_TARGETS = tuple(
    f"cadtof simulate --scene wall --distance {metres} {_SMALL} --frames 5 -o wall_{metres}m" for metres in (1, 2, 3)
)

_OF_LIGHT = {"capture_fwhm_ns", "capture_focal_length_px", "capture_principal_point_px", "capture_lamp_offset_m"}
"""Options that describe light or its way, of which covered frames have none."""


class _StepsInOrder(click.Group):
    """A group whose help lists the steps in the order in which they are taken and are defined below."""

    context_class = HelpContext

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the steps."""
        return list(self.commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a step. If the user forgot the step and typed a capture in its place, the message names the steps."""
        if cmd_name not in self.commands and not ctx.resilient_parsing:
            ctx.fail(f"found '{cmd_name}', expected one of the steps {', '.join(self.list_commands(ctx))}")
        return super().get_command(ctx, cmd_name)


@click.group(
    cls=_StepsInOrder,
    epilog=example(
        _COVERED,
        "cadtof calibrate dark covered -o camera",
        f"cadtof simulate --scene corner {_SMALL} -o corner",
        "cadtof resolve corner -o maps --calibration camera",
    ),
)
def calibrate() -> None:
    """Measure the dark offsets, the channel response and the field curvature of a camera, in three steps and in this order.

    Each step adds one part to the calibration folder given by -o, and applies the parts that this folder already has.
    `cadtof resolve --calibration FOLDER` then applies all parts. Captures are only read, never changed.
    """


_distance = click.option(
    "--distance",
    "--distance-m",
    "distances_m",
    type=float,
    multiple=True,
    metavar="M",
    help="Distance of the flat target along the optical axis: given once for all captures, or once for each, in their order: "
    "--distance 1 --distance 3.  [default: target.distance_m of capture.toml]",
)


@dataclass(frozen=True, kw_only=True)
class _Step:
    """The options that all steps share."""

    captures: tuple[str, ...]
    null: bool
    settings: CalibrateSettings
    as_json: bool
    quiet: bool

    def take(
        self, measure: Callable[..., CalibrateReport], lines: Callable[[Mapping[str, Any]], list[str]], **more: Any
    ) -> None:
        """Take the step by calling `measure`, and print its report; `lines` puts the measured figures into words."""
        with progress_bar("reading", "frames", quiet=self.quiet) as bar:
            paths = input_paths(self.captures, null=self.null)
            report = measure(paths, settings=self.settings, progress=bar, **more)
        if self.as_json:
            tell(json.dumps(asdict(report)))
            return
        frames, written = counted(report.frames, "frame"), ", ".join(report.written)
        tell(f"{report.part}: from {frames}, written to {written}, digest {report.digest}")
        for line in (*lines(report.figures), *report.findings):
            tell(f"  {line}")


def _step(*more: Decorator[Any]) -> Decorator[Any]:
    """Return a decorator that adds the options of a step as one record, `step`: those that all share, and `more` settings."""
    return RecordOptions(
        "step",
        _Step,
        click.argument("captures", nargs=-1, type=INPUT, required=True, metavar="CAPTURE..."),
        null_option(),
        RecordOptions(
            "settings",
            CalibrateSettings,
            settings_option(),
            *declared_options(CalibrateSettings).values(),
            *more,
            capture_options("target.distance_m"),
        ),
        click.option("--json", "as_json", is_flag=True, help="Print the report as one JSON object on stdout."),
        click.option(
            "-q", "--quiet", is_flag=True, help="Print only errors on stderr: no progress bar, warnings or notes."
        ),
    )


@calibrate.command(
    cls=SectionedCommand,
    headings=CAPTURE_HEADING,
    short_help="Measure offsets, noise and bad pixels, from frames with the lens covered.",
    epilog=example(_COVERED, "cadtof calibrate dark covered -o camera"),
)
@_step()
def dark(step: _Step) -> None:
    """Measure the offset and noise of each pixel from frames recorded with the lens covered, and find hot and dead pixels."""
    note_given(_OF_LIGHT, "on a dark calibration")
    step.take(calibrate_dark, _dark_lines)


@calibrate.command(
    cls=SectionedCommand,
    headings=CAPTURE_HEADING,
    short_help="Measure channel response, and phase and gain of each pixel, from flat targets.",
    epilog=example(*_TARGETS, "cadtof calibrate response wall_1m wall_2m wall_3m -o camera"),
)
@_step(_distance)
def response(step: _Step) -> None:
    """Measure the response of the channels to light, from captures of a flat target at known distances, without MPI.

    One distance gives the phase and gain of every pixel. Several distances, spread over the range, also give the imbalance of
    SC1 and SC2 and the deviation of the waveform from the ideal one.
    """
    step.take(calibrate_response, _response_lines)


@calibrate.command(
    cls=SectionedCommand,
    headings=CAPTURE_HEADING,
    short_help="Measure field curvature of the lens, from flat walls.",
    epilog=example(
        f"cadtof simulate --scene wall --petzval 0.05,0.01 {_SMALL} --frames 5 -o curved",
        "cadtof calibrate petzval curved -o camera",
    ),
)
@_step(_distance)
@click.option(
    "--plot", type=PATH, metavar="PNG", help="Draw cross-sections of the walls before and after the correction."
)
def petzval(step: _Step, plot: Path | None) -> None:
    """Measure the field curvature k2 ρ² + k4 ρ⁴ of the lens from one or more flat walls, one capture each.

    ρ is the distance from the principal point over half the diagonal of the array. The tilt of each wall is fitted, and its
    distance if it is not given. Pixels that are not part of the wall (MPI, objects in view) are left out.
    """
    step.take(calibrate_petzval, _petzval_lines, plot=plot)


def _dark_lines(figures: Mapping[str, Any]) -> list[str]:
    return [
        f"offsets: {1000 * figures['offset_mean_v']:.2f} mV on average, {1000 * figures['offset_std_v']:.2f} mV from pixel to "
        f"pixel, each known to {1000 * figures['offset_stderr_v']:.3f} mV",
        f"noise of one frame: {1000 * figures['noise_v']:.3f} mV per channel",
        f"bad pixels: {figures['bad_pixels']}",
    ]


def _response_lines(figures: Mapping[str, Any]) -> list[str]:
    lines = ["distances: " + ", ".join(f"{distance:g} m" for distance in figures["distances_m"])]
    of_pixels = ("pixel_phase_std_rad", "pixel_phase_stderr_rad", "pixel_gain_std", "pixel_gain_stderr")
    rows = zip(figures["terms"], *(figures[name] for name in ("gain", "phase_rad", *of_pixels)), strict=True)
    for harmonic, gain, phase, spread, error, gain_spread, gain_error in rows:
        lines.append(
            f"harmonic {harmonic.removeprefix('H')}: gain {gain:.4f}, phase {phase:+.4f} rad; pixel to pixel {spread:.4f} rad "
            f"(each known to {error:.4f}), {gain_spread:.2%} of gain (known to {gain_error:.2%})"
        )
    lines.append(f"residual over noise: {figures['residual']:.3f} (about 1 or less: nothing but noise is left)")
    return lines


def _petzval_lines(figures: Mapping[str, Any]) -> list[str]:
    lines = [
        ", ".join(f"{k} = {figures[k + '_m']:.5f} ± {figures[k + '_stderr_m']:.5f} m" for k in ("k2", "k4")),
        f"residual RMS: {1000 * figures['rms_before_m']:.3f} mm before, {1000 * figures['rms_after_m']:.3f} mm after, "
        f"{1000 * figures['noise_rms_m']:.3f} mm by noise alone",
    ]
    for index, wall in enumerate(figures["walls"], start=1):
        given = "given" if wall["distance_known"] else f"± {1000 * wall['distance_stderr_m']:.2f} mm"
        alpha, beta = wall["slopes"]
        lines.append(
            f"wall {index}: {wall['distance_m']:.4f} m ({given}), slopes {alpha:+.4f} {beta:+.4f}, {wall['pixels']} pixels, RMS "
            f"{1000 * wall['rms_before_m']:.2f} mm before, {1000 * wall['rms_after_m']:.2f} mm after"
        )
    return lines
