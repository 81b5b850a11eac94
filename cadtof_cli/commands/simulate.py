"""`cadtof simulate`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cadtof_cli.commands.progress import progress_bar
from cadtof_cli.commands.simulation_options import (
    MODULATION_OPTIONS,
    NUMBERS,
    PIXEL_OPTIONS,
    PROCESS_OPTIONS,
    RUN_OPTIONS,
    averaging_from_options,
    job_count,
    model_from_options,
    modulation_from_options,
    refuse_options,
    resolver_from_options,
    with_options,
)
from cadtof_cli.errors import SettingsError

if TYPE_CHECKING:
    from cadtof_cli.simulation.scene.light import Scene
    from cadtof_cli.simulation.trials import PathSummary, Trials, TrialsSummary
    from cadtof_cli.workflows.simulate.record import RecordSettings

SCENE_NAMES = ("pixel", "card", "wall", "corner", "inter-reflection")

PIXEL_ONLY = (
    *("runs", "order", "false_alarm", "as_json", "second_ns", "photons", "photons_per_cycle", "cycles", "dead_time_ns"),
    *("jitter_ns", "temperature", "sample_noise_v", "gain_mismatch", "offsets_v", "f1_hz", "f2_hz", "stages"),
)
"""What a scene does not take: it is recorded from exact statistics, by Eq. (1), and resolved by `cadtof resolve`."""

SCENE_ONLY = (
    *("frames", "frame_format", "compress", "distance_m", "tilt_deg", "albedo", "opening_deg", "width", "height"),
    *("petzval_m", "dark_offset_v", "fixed_delay_ns"),
)

SCENE_SETTINGS = {
    "card": {"mpi": "mpi_ratios", "distance_m": "distance_m"},
    "wall": {"distance_m": "distance_m", "tilt_deg": "tilt_deg", "albedo": "albedo"},
    "corner": {"distance_m": "distance_m", "opening_deg": "opening_deg", "albedo": "albedo"},
    "inter-reflection": {"mpi": "mpi_ratio", "distance_m": "distance_m", "albedo": "albedo"},
}
"""Which options each scene takes besides --asr, and the attribute that each one sets."""


@click.command(short_help="A simulated pixel, resolved many times; or a scene recorded as a capture.")
@click.option("--scene", type=click.Choice(SCENE_NAMES), default="pixel", show_default=True, help="What is looked at.")
@click.option("-o", "--out", type=click.Path(path_type=Path), help="New folder for pictures and CSV, or the capture.")
@click.option("--asr", type=float, help="Ambient to laser photons.  [default: 5; scenes: 2]")
@click.option("--mpi", type=float, help="MPI to laser photons.  [default: 0.3; scenes: their own]")
@click.option("--direct", "direct_ns", type=float, help="Arrival of the direct path, ns.  [default: 5]")
@click.option("--second", "second_ns", type=float, default=16.0, show_default=True, help="Arrival of the MPI, ns.")
@click.option("--integration-length", type=float, help="n_av of Eq. (1), per harmonic.  [default: 1e5]")
@with_options(*RUN_OPTIONS, *PROCESS_OPTIONS)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
@with_options(*MODULATION_OPTIONS, *PIXEL_OPTIONS)
@click.option("--frames", type=int, default=1, show_default=True, help="Frames of the capture.")
@click.option(
    "--format", "frame_format", type=click.Choice(["tif", "exr"]), default="tif", show_default=True, help="Of frames."
)
@click.option("--compress", is_flag=True, help="Deflate TIFF, ZIP EXR.")
@click.option("--distance-m", "--distance", type=float, help="Distance of the scene, m.")
@click.option("--tilt-deg", "--tilt", type=NUMBERS, help="Tilt of the wall to the right and down, degrees.")
@click.option("--albedo", type=float, help="Albedo of wall, corner or panel.")
@click.option("--opening-deg", "--opening", type=float, help="Angle of the corner, degrees.")
@click.option("--width", type=int, default=320, show_default=True, help="Columns of the camera.")
@click.option("--height", type=int, default=240, show_default=True, help="Rows of the camera.")
@click.option("--petzval-m", "--petzval", type=NUMBERS, default="0,0", help="Field curvature k2,k4 of the lens, m.")
@click.option("--dark-offset-v", "--dark-offset", type=float, default=0.0, help="Spread of pixels' own offsets, V.")
@click.option("--fixed-delay-ns", "--fixed-delay", type=float, default=0.0, help="Spread of pixels' own delays, ns.")
@click.pass_context
def simulate(context: click.Context, /, scene: str, out: Path | None, **options: Any) -> None:
    """Simulate a CA-dToF pixel, or record a scene.

    Without --scene: a pixel that sees laser, MPI and ambient photons as 1 : MPI : ASR is recorded --runs times and
    resolved; prints how well both paths' times come back, beside the Cramér–Rao bound. OUT gets one recording as
    histogram, voltages and phase.

    With --scene: records a capture with its truth into OUT, for `cadtof resolve`.

    \b
    Exit status: 0 done; 2 wrong usage or settings, or OUT exists; 130 interrupted.
    """
    if scene == "pixel":
        refuse_options(context, SCENE_ONLY, "without --scene")
        _simulate_pixel(out, options)
    else:
        refuse_options(context, PIXEL_ONLY, f"with --scene {scene}")
        if out is None:
            raise SettingsError(f"--scene {scene}: found no -o, expected -o DIR, the folder of the capture")
        _record_scene(scene, out, options)


def _simulate_pixel(out: Path | None, options: dict[str, Any]) -> None:
    from cadtof_cli.files.new_folder import require_absent
    from cadtof_cli.workflows.simulate.simulate import json_report, simulate_pixel, write_evolution

    trials = _trials(options)
    if out is not None:
        require_absent(out)
    with progress_bar("simulate", "blocks", quiet=options["quiet"]) as bar:
        bar.total(len(trials.blocks))
        outcome = simulate_pixel(trials, jobs=job_count(options["jobs"]), advance=bar.advance)
    if out is not None:
        write_evolution(trials, outcome, out)
    if options["as_json"]:
        click.echo(json.dumps(json_report(trials, outcome)))
    else:
        click.echo("\n".join(_table(trials, outcome)))


def _trials(options: dict[str, Any]) -> "Trials":
    from cadtof_cli.simulation.trials import Condition, Trials

    averaging = averaging_from_options(options, options["integration_length"])
    return Trials(
        condition=Condition(
            asr=_or_default(options["asr"], 5.0),
            mpi_ratio=_or_default(options["mpi"], 0.3),
            direct_ns=_or_default(options["direct_ns"], 5.0),
            second_ns=options["second_ns"],
            fwhm_ns=options["fwhm_ns"],
        ),
        model=model_from_options(options, averaging),
        resolver=resolver_from_options(options),
        runs=options["runs"],
        photon_by_photon=options["photons"],
        seed=options["seed"],
    )


def _table(trials: "Trials", outcome: "TrialsSummary") -> list[str]:
    condition, way = trials.condition, "photon by photon" if trials.photon_by_photon else "by statistics"
    difference = outcome.confidence_v / outcome.confidence_model_v - 1.0
    return [
        f"laser : MPI : ambient = 1 : {condition.mpi_ratio:g} : {condition.asr:g}, "
        f"n_av {trials.model.averaging.integration_length:g}, pulse {condition.fwhm_ns:g} ns, {trials.runs} runs {way}",
        f"{'path':8}{'true ns':>10}{'mean ns':>10}{'bias ns':>10}{'std ns':>10}{'bound ns':>10}{'within ±1 ns':>14}",
        _row("direct", outcome.direct),
        _row("second", outcome.second),
        f"confidence {1e3 * outcome.confidence_v:.3f} mV, "
        f"analytical model {1e3 * outcome.confidence_model_v:.3f} mV ({difference:+.2%})",
    ]


def _row(name: str, path: "PathSummary") -> str:
    values = (path.true_ns, path.mean_ns, path.bias_ns, path.std_ns, path.bound_ns)
    if path.true_ns != path.true_ns:
        return f"{name:8}" + "".join(f"{'–':>10}" for _ in values) + f"{'–':>14}"
    return f"{name:8}" + "".join(f"{value:10.3f}" for value in values) + f"{path.within_1ns:14.1%}"


def _record_scene(name: str, out: Path, options: dict[str, Any]) -> None:
    from cadtof_cli.workflows.simulate.record import record_scene, record_steps

    settings = _record_settings(name, options)
    with progress_bar(f"record {name}", "steps", quiet=options["quiet"]) as bar:
        bar.total(record_steps(settings))
        report = record_scene(settings, out, jobs=job_count(options["jobs"]), advance=bar.advance)
    near, far = report.depths_m
    if not options["quiet"]:
        click.echo(
            f"{out}: {report.frames} frames of {name}, direct depth {near:.3f} to {far:.3f} m, "
            f"median MPI/direct {report.mpi_ratio:.3f}; truth in truth.exr",
            err=True,
        )


def _record_settings(name: str, options: dict[str, Any]) -> "RecordSettings":
    from cadtof_cli.capture.metadata import CaptureMetadata, Pixel, Pulse, Target, Voltage
    from cadtof_cli.simulation.scene.camera import Camera
    from cadtof_cli.simulation.scene.exposure import Exposure
    from cadtof_cli.simulation.scene.scenes import Wall
    from cadtof_cli.workflows.simulate.record import RecordSettings

    averaging = averaging_from_options(options, options["integration_length"])
    camera = Camera(
        width=options["width"],
        height=options["height"],
        petzval_m=_pair("--petzval", options["petzval_m"]),
        dark_offset_v=options["dark_offset_v"],
        fixed_delay_ns=options["fixed_delay_ns"],
    )
    scene = _scene(name, options)
    metadata = CaptureMetadata(
        modulation=modulation_from_options(options),
        pixel=Pixel(integration_length=averaging.integration_length),
        pulse=Pulse(fwhm_ns=options["fwhm_ns"]),
        voltage=camera.voltage if options["frame_format"] == "tif" else Voltage(),
        optics=camera.optics,
        target=Target(distance_m=scene.distance_m if isinstance(scene, Wall) else None),
    )
    return RecordSettings(
        exposure=Exposure(scene=scene, camera=camera, metadata=metadata, seed=options["seed"]),
        frames=options["frames"],
        frame_format=options["frame_format"],
        compress=options["compress"],
    )


def _scene(name: str, options: dict[str, Any]) -> "Scene":
    """Build the scene from the options that it takes; the others must be absent."""
    from cadtof_cli.simulation.scene.scenes import SCENES

    taken, given = SCENE_SETTINGS[name], {"asr": options["asr"]}
    for option in ("mpi", "direct_ns", "distance_m", "tilt_deg", "albedo", "opening_deg"):
        value = options[option]
        if value is None:
            continue
        if option not in taken:
            shown = "--" + option.rsplit("_", maxsplit=1)[0]
            raise SettingsError(f"{shown}: found with --scene {name}, which it does not change; leave it out")
        given[taken[option]] = value
    if "tilt_deg" in given:
        given["tilt_deg"] = _pair("--tilt", given["tilt_deg"])
    if "mpi_ratios" in given:
        given["mpi_ratios"] = (given["mpi_ratios"], given["mpi_ratios"])
    return SCENES[name](**{key: value for key, value in given.items() if value is not None})


def _pair(option: str, values: list[float]) -> tuple[float, float]:
    if len(values) != 2:
        raise SettingsError(f"{option}: found {len(values)} values, expected 2")
    return values[0], values[1]


def _or_default(value: float | None, default: float) -> float:
    return default if value is None else value
