"""`cadtof simulate`."""

import json
from pathlib import Path

import click

from cadtof_cli.capture.metadata import Pulse
from cadtof_cli.commands.help import SectionedCommand, example
from cadtof_cli.commands.options import declared_options, note_given, refuse_given
from cadtof_cli.commands.scene_options import LightOptions, SceneOptions, light_options, not_of_scene, scene_options
from cadtof_cli.commands.simulation_options import (
    RESOLVING,
    TrialOptions,
    note_unused,
    quiet_option,
    trial_options,
    workers_option,
)
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import PATH
from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.atomic import require_absent
from cadtof_cli.simulation.pixel.evolution import require_traceable
from cadtof_cli.simulation.pixel.pixel import PixelDefects
from cadtof_cli.simulation.scene.exposure import Exposure
from cadtof_cli.simulation.scene.scenes import SCENES
from cadtof_cli.units import counted
from cadtof_cli.workflows.simulate.outcome import PathSummary, TrialsSummary
from cadtof_cli.workflows.simulate.record import RecordSettings, record_scene, scene_exposure
from cadtof_cli.workflows.simulate.simulate import json_report, simulate_trials, write_evolution
from cadtof_cli.workflows.simulate.trials import Trials

_OF_SCENES_TOO = {
    "speed_m_s",
    "frame_rate_hz",
    "seed",
    "periods_ns",
    "waveform",
    "amplitude_v",
    "fwhm_ns",
    "capacitors",
    "temperature_k",
    *declared_options(PixelDefects),
}

PIXEL_ONLY = {"as_json", "second_ns", "further", *trial_options.names()}.difference(_OF_SCENES_TOO)
"""Options that a scene does not take: it is recorded from exact statistics, by Eq. (1), and `cadtof resolve` resolves it."""


@click.command(
    cls=SectionedCommand,
    headings={
        "Options without --scene": {"direct_ns", *PIXEL_ONLY} - {*RESOLVING},
        "Resolving without --scene": RESOLVING,
        "Options with --scene": scene_options.names(),
    },
    epilog=example(
        "cadtof simulate --asr 5 --mpi 0.3 --second 11 --seed 1",
        "cadtof simulate --scene corner --width 80 --height 60 -o corner",
    ),
)
@click.option(
    "--scene",
    type=click.Choice(["pixel", *SCENES]),
    default="pixel",
    show_default=True,
    help="What to simulate: a single pixel, or a scene.",
)
@click.option(
    "-o", "--out", type=PATH, help="New folder: for pictures and CSV of a pixel, or for the capture of a scene."
)
@light_options
@trial_options
@workers_option
@quiet_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
@scene_options
def simulate(
    *,
    scene: str,
    out: Path | None,
    light: LightOptions,
    trial: TrialOptions,
    workers: Workers,
    quiet: bool,
    as_json: bool,
    scenery: SceneOptions,
) -> None:
    """Simulate a CA-dToF pixel, or record a scene.

    Without --scene, one pixel is simulated. Its laser, MPI and ambient photons are in the ratio 1 : MPI : ASR. It is recorded
    --runs times and resolved, and a table compares the times of both paths with the truth and with the Cramér–Rao bound. OUT
    gets the histogram, voltages and phase of one recording.

    With --scene, a capture with its truth is recorded into OUT, for `cadtof resolve`.

    \b
    Exit status:
      0    done
      2    wrong usage or settings, or OUT exists
      130  interrupted
    """
    if scene == "pixel":
        refuse_given(scene_options.names(), "with --scene pixel (the default)")
        note_unused(trial, followed=out is not None)
        if light.mpi == 0:
            note_given({"second_ns"}, "with --mpi 0")
        trials = trial.of(light.condition(trial.fwhm_ns), trial.averaging(light.integration_length))
        _simulate_pixel(trials, out, workers, quiet=quiet, as_json=as_json)
        return
    refuse_given(PIXEL_ONLY | not_of_scene(scene), f"with --scene {scene}")
    note_unused(trial)
    if out is None:
        raise SettingsError(f"--scene {scene}: found no -o, expected -o DIR, the folder of the capture")
    seed = trial.trials["seed"]
    lengths = light.integration_length
    # of a list, only whether it was given beside --capacitors matters here
    several = isinstance(lengths, list) and trial.capacitors is None
    averaging = trial.averaging(None if several else lengths[0] if isinstance(lengths, list) else lengths)
    exposure = scene_exposure(
        scenery.made(scene, light, seed=seed),
        scenery.camera,
        modulation=trial.modulation,
        pulse=Pulse(fwhm_ns=trial.fwhm_ns),
        integration_length=tuple(lengths) if isinstance(lengths, list) else averaging.integration_length,
        seed=seed,
        motion=trial.motion,
        defects=trial.defects(averaging),
    )
    _record_scene(scene, exposure, scenery.recording, out, workers, quiet=quiet)


def _simulate_pixel(trials: Trials, out: Path | None, workers: Workers, *, quiet: bool, as_json: bool) -> None:
    if out is not None:
        require_absent(out)
        require_traceable(trials.model)
    with progress_bar("simulate", "blocks", quiet=quiet) as bar:
        (outcome,) = simulate_trials((trials,), workers=workers, progress=bar)
    if out is not None:
        write_evolution(outcome, out)
    tell(*([json.dumps(json_report(outcome))] if as_json else _table(outcome)))


def _record_scene(
    name: str, exposure: Exposure, settings: RecordSettings, out: Path, workers: Workers, *, quiet: bool
) -> None:
    with progress_bar(f"record {name}", "steps", quiet=quiet) as bar:
        report = record_scene(exposure, out, settings=settings, workers=workers, progress=bar)
    near, far = report.depths_m
    if not quiet:
        tell(
            f"{out}: {counted(settings.frames, 'frame')} of {name}, direct depth {near:.3f} to {far:.3f} m, "
            f"median MPI/direct {report.mpi_ratio:.3f}; truth in truth.exr",
            err=True,
        )


def _table(outcome: TrialsSummary) -> list[str]:
    trials = outcome.trials
    condition, way = trials.condition, "photon by photon" if trials.photon_by_photon else "by statistics"
    difference = outcome.confidence_v / outcome.confidence_model_v - 1.0
    light = " : ".join(f"{ratio:g}" for ratio in condition.ratios)
    lines = [
        f"laser{' : MPI' * (len(condition.ratios) - 1)} : ambient = {light} : {condition.asr:g}, "
        f"n_av {trials.model.averaging.integration_length:g}, pulse {condition.fwhm_ns:g} ns, {trials.runs} runs {way}",
        f"{'path':8}{'true ns':>10}{'mean ns':>10}{'bias ns':>10}{'std ns':>10}{'bound ns':>10}{'within ±1 ns':>14}",
        *(_row(name, path) for name, path in outcome.named_paths.items()),
        f"confidence {1e3 * outcome.confidence_v:.3f} mV, "
        f"analytical model {1e3 * outcome.confidence_model_v:.3f} mV ({difference:+.2%})",
    ]
    if outcome.steps_per_start == outcome.steps_per_start:
        lines.append(
            f"{outcome.steps_per_start:.1f} steps of Levenberg–Marquardt from each of {trials.resolver.starts} starts"
        )
    if outcome.impossible:
        lines.append(f"impossible amplitudes, and no answer, in {outcome.impossible:.1%} of the runs")
    return lines


def _row(name: str, path: PathSummary) -> str:
    values = (path.true_ns, path.mean_ns, path.bias_ns, path.std_ns, path.bound_ns)
    if path.true_ns != path.true_ns:
        return f"{name:8}" + "".join(f"{'–':>10}" for _ in values) + f"{'–':>14}"
    return f"{name:8}" + "".join(f"{value:10.3f}" for value in values) + f"{path.within_1ns:14.1%}"
