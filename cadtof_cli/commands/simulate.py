"""`cadtof simulate`."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from cadtof_cli.capture.metadata import Pulse
from cadtof_cli.commands.options import NUMBERS, gathered, setting_option
from cadtof_cli.commands.progress import progress_bar
from cadtof_cli.commands.simulation_options import (
    ModulationOptions,
    PixelOptions,
    modulation_options,
    pair,
    pixel_options,
    quiet_option,
    refuse_options,
    resolver_options,
    runs_option,
    seed_option,
    triple,
    workers_option,
)
from cadtof_cli.commands.terminal import tell
from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.atomic import require_absent
from cadtof_cli.files.formats import FRAME_FORMATS, format_named
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import SCENES
from cadtof_cli.workflows.simulate.record import RecordSettings, record_scene, scene_exposure
from cadtof_cli.workflows.simulate.simulate import json_report, simulate_pixel, write_evolution
from cadtof_cli.workflows.simulate.trials import PathSummary, Trials, TrialsSummary

PIXEL_ONLY = (
    *("runs", "order", "false_alarm", "as_json", "second_ns", "photon_by_photon", "photons_per_cycle", "cycles"),
    *(
        "dead_time_ns",
        "jitter_ns",
        "temperature",
        "sample_noise_v",
        "gain_mismatch",
        "offsets_v",
        "f1_hz",
        "f2_hz",
        "drive",
    ),
)
"""What a scene does not take: it is recorded from exact statistics, by Eq. (1), and resolved by `cadtof resolve`."""

SCENE_ONLY = (
    *("frames", "frame_format", "compress", "distance_m", "tilt_deg", "albedo", "opening_deg", "width", "height"),
    *("petzval_m", "dark_offset_v", "fixed_delay_ns", "furniture", "lamp_offset_m", "lamp_beam_deg", "light_paths"),
)

SCENE_SETTINGS = {
    "card": {"mpi": "mpi_ratios", "distance_m": "distance_m"},
    "wall": {"distance_m": "distance_m", "tilt_deg": "tilt_deg", "albedo": "albedo"},
    "corner": {"distance_m": "distance_m", "opening_deg": "opening_deg", "albedo": "albedo"},
    "inter-reflection": {"mpi": "mpi_ratio", "distance_m": "distance_m", "albedo": "albedo"},
    "room": {
        "seed": "seed",
        "furniture": "furniture",
        "albedo": "albedo",
        "lamp_offset_m": "lamp_offset_m",
        "lamp_beam_deg": "beam_deg",
        "light_paths": "light_paths",
    },
    "cornell": {"light_paths": "light_paths"},
}
"""Which options each scene takes besides --asr, and the attribute that each one sets."""

ASR, MPI_RATIO = 5.0, 0.3
"""Of a pixel, where they are not given."""


@dataclass(frozen=True, kw_only=True)
class LightOptions:
    """What is said of the light: of a pixel's, all of it; of a scene's, what the scene takes."""

    asr: float | None
    mpi: float | None
    direct_ns: float | None
    second_ns: float
    integration_length: float | None

    def condition(self, fwhm_ns: float, /) -> Condition:
        """Return the light of a pixel; raises SettingsError for one that cannot be."""
        return Condition(
            asr=ASR if self.asr is None else self.asr,
            mpi_ratio=MPI_RATIO if self.mpi is None else self.mpi,
            direct_ns=Condition.direct_ns if self.direct_ns is None else self.direct_ns,
            second_ns=self.second_ns,
            fwhm_ns=fwhm_ns,
        )


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """What is said of a scene, its camera and its capture."""

    frames: int
    frame_format: str
    compress: bool
    distance_m: float | None
    tilt_deg: list[float] | None
    albedo: float | None
    opening_deg: float | None
    width: int
    height: int
    furniture: int | None
    lamp_offset_m: list[float] | None
    lamp_beam_deg: float | None
    light_paths: int | None
    petzval_m: list[float]
    dark_offset_v: float
    fixed_delay_ns: float

    def exposure(
        self, name: str, light: LightOptions, modulation: ModulationOptions, /, *, integration_length: float, seed: int
    ) -> Exposure:
        """Return what is recorded; raises SettingsError for what cannot be."""
        camera = Camera(
            width=self.width,
            height=self.height,
            petzval_m=pair("--petzval", self.petzval_m),
            dark_offset_v=self.dark_offset_v,
            fixed_delay_ns=self.fixed_delay_ns,
        )
        return scene_exposure(
            self.scene(name, light, seed=seed),
            camera,
            modulation=modulation.modulation(),
            pulse=Pulse(fwhm_ns=modulation.fwhm_ns),
            integration_length=integration_length,
            counts=format_named(self.frame_format).counts,
            seed=seed,
        )

    def scene(self, name: str, light: LightOptions, /, *, seed: int) -> Scene:
        """Return the scene from the options that it takes; the others must be absent."""
        given: dict[str, Any] = {
            "mpi": light.mpi,
            "direct_ns": light.direct_ns,
            "distance_m": self.distance_m,
            "tilt_deg": self.tilt_deg,
            "albedo": self.albedo,
            "opening_deg": self.opening_deg,
            "furniture": self.furniture,
            "lamp_offset_m": self.lamp_offset_m,
            "lamp_beam_deg": self.lamp_beam_deg,
            "light_paths": self.light_paths,
        }
        taken = SCENE_SETTINGS[name]
        settings: dict[str, Any] = {} if light.asr is None else {"asr": light.asr}
        for option, value in given.items():
            if value is not None:
                if option not in taken:
                    shown = "--" + option.rsplit("_", maxsplit=1)[0]
                    raise SettingsError(f"{shown}: found with --scene {name}, which it does not change; leave it out")
                settings[taken[option]] = value
        if "seed" in taken:
            settings["seed"] = seed
        if "lamp_offset_m" in settings:
            settings["lamp_offset_m"] = triple("--lamp-offset", settings["lamp_offset_m"])
        if "tilt_deg" in settings:
            settings["tilt_deg"] = pair("--tilt", settings["tilt_deg"])
        if "mpi_ratios" in settings:
            settings["mpi_ratios"] = (settings["mpi_ratios"], settings["mpi_ratios"])
        return SCENES[name](**settings)


@click.command()
@click.option(
    "--scene", type=click.Choice(["pixel", *SCENES]), default="pixel", show_default=True, help="What is looked at."
)
@click.option("-o", "--out", type=click.Path(path_type=Path), help="New folder for pictures and CSV, or the capture.")
@gathered(
    "light",
    LightOptions,
    click.option("--asr", type=float, help="Ambient to laser photons.  [default: 5; scenes: 2]"),
    click.option("--mpi", type=float, help="MPI to laser photons.  [default: 0.3; scenes: their own]"),
    setting_option(
        "--direct",
        Condition,
        "direct_ns",
        default=None,
        show_default=False,
        help="Arrival of the direct path, ns.  [default: 5]",
    ),
    setting_option("--second", Condition, "second_ns", help="Arrival of the MPI, ns."),
    click.option("--integration-length", type=float, help="n_av of Eq. (1), per harmonic.  [default: 1e5]"),
)
@runs_option
@resolver_options
@seed_option
@workers_option
@quiet_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
@modulation_options
@pixel_options
@gathered(
    "scenery",
    SceneOptions,
    setting_option("--frames", RecordSettings, help="Frames of the capture."),
    setting_option("--format", RecordSettings, "frame_format", type=click.Choice(FRAME_FORMATS), help="Of frames."),
    setting_option("--compress", RecordSettings, help="Deflate TIFF, ZIP EXR."),
    click.option("--distance-m", "--distance", type=float, help="Distance of the scene, m."),
    click.option("--tilt-deg", "--tilt", type=NUMBERS, help="Tilt of the wall to the right and down, degrees."),
    click.option("--albedo", type=float, help="Albedo of wall, corner or panel, or of all in a room."),
    click.option("--opening-deg", "--opening", type=float, help="Angle of the corner, degrees."),
    click.option("--furniture", type=int, help="Pieces of furniture in the room.  [default: drawn, 0 to 8]"),
    click.option(
        "--lamp-offset-m", "--lamp-offset", type=NUMBERS, help="Lamp from camera: right,down,forward in m (room)."
    ),
    click.option("--lamp-beam-deg", "--lamp-beam", type=float, help="Half angle of the lamp (room).  [default: drawn]"),
    click.option("--light-paths", type=int, help="Light paths from every fourth pixel (room).  [default: 256]"),
    setting_option("--width", Camera, help="Columns of the camera."),
    setting_option("--height", Camera, help="Rows of the camera."),
    setting_option("--petzval-m --petzval", Camera, show_default=False, help="Field curvature k2,k4 of the lens, m."),
    setting_option(
        "--dark-offset-v --dark-offset", Camera, show_default=False, help="Spread of pixels' own offsets, V."
    ),
    setting_option(
        "--fixed-delay-ns --fixed-delay", Camera, show_default=False, help="Spread of pixels' own delays, ns."
    ),
)
@click.pass_context
def simulate(
    context: click.Context,
    /,
    *,
    scene: str,
    out: Path | None,
    light: LightOptions,
    runs: int,
    resolver: ResolverSettings,
    seed: int,
    workers: Workers,
    quiet: bool,
    as_json: bool,
    modulation: ModulationOptions,
    pixel: PixelOptions,
    scenery: SceneOptions,
) -> None:
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
        averaging = pixel.averaging(light.integration_length)
        trials = Trials(
            condition=light.condition(modulation.fwhm_ns),
            model=pixel.model(modulation.modulation(), averaging),
            resolver=resolver,
            runs=runs,
            photon_by_photon=pixel.photon_by_photon,
            seed=seed,
        )
        _simulate_pixel(trials, out, workers, quiet=quiet, as_json=as_json)
        return
    refuse_options(context, PIXEL_ONLY, f"with --scene {scene}")
    if out is None:
        raise SettingsError(f"--scene {scene}: found no -o, expected -o DIR, the folder of the capture")
    n_av = pixel.averaging(light.integration_length).integration_length
    settings = RecordSettings(
        exposure=scenery.exposure(scene, light, modulation, integration_length=n_av, seed=seed),
        frames=scenery.frames,
        frame_format=scenery.frame_format,
        compress=scenery.compress,
    )
    _record_scene(scene, settings, out, workers, quiet=quiet)


def _simulate_pixel(trials: Trials, out: Path | None, workers: Workers, *, quiet: bool, as_json: bool) -> None:
    if out is not None:
        require_absent(out)
    with progress_bar("simulate", "blocks", quiet=quiet) as bar:
        outcome = simulate_pixel(trials, workers=workers, progress=bar)
    if out is not None:
        write_evolution(trials, outcome, out)
    if as_json:
        tell(json.dumps(json_report(trials, outcome)))
    else:
        tell("\n".join(_table(trials, outcome)))


def _record_scene(name: str, settings: RecordSettings, out: Path, workers: Workers, *, quiet: bool) -> None:
    with progress_bar(f"record {name}", "steps", quiet=quiet) as bar:
        report = record_scene(settings, out, workers=workers, progress=bar)
    near, far = report.depths_m
    if not quiet:
        tell(
            f"{out}: {report.frames} frames of {name}, direct depth {near:.3f} to {far:.3f} m, "
            f"median MPI/direct {report.mpi_ratio:.3f}; truth in truth.exr",
            err=True,
        )


def _table(trials: Trials, outcome: TrialsSummary) -> list[str]:
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


def _row(name: str, path: PathSummary) -> str:
    values = (path.true_ns, path.mean_ns, path.bias_ns, path.std_ns, path.bound_ns)
    if path.true_ns != path.true_ns:
        return f"{name:8}" + "".join(f"{'–':>10}" for _ in values) + f"{'–':>14}"
    return f"{name:8}" + "".join(f"{value:10.3f}" for value in values) + f"{path.within_1ns:14.1%}"
