"""Simulate a pixel at one condition or several: many runs, their statistics, and pictures of one recording."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cadtof_cli.execution.workers import ALONE, Workers
from cadtof_cli.files.atomic import new_folder
from cadtof_cli.files.documents import plain, write_rows
from cadtof_cli.simulation.pixel.evolution import evolution
from cadtof_cli.workflows.progress import NO_PROGRESS, Progress, results
from cadtof_cli.workflows.simulate.outcome import TrialsSummary, summary
from cadtof_cli.workflows.simulate.trials import EVOLUTION_KEY, Recordings, Trials, recordings


def simulate_trials(
    every: Sequence[Trials], /, *, workers: Workers = ALONE, progress: Progress = NO_PROGRESS
) -> list[TrialsSummary]:
    """Return a summary of each of the trials. All blocks of runs are done in parallel; each is a step of the progress."""
    work = [(trials, block) for trials in every for block in trials.blocks]
    progress.advance(0, total=len(work))
    made = results(_run, work, workers=workers, progress=progress)
    return [summary(trials, Recordings.joined([next(made) for _ in trials.blocks])) for trials in every]


def _run(task: tuple[Trials, range]) -> Recordings:
    return recordings(*task)


def json_report(outcome: TrialsSummary, /) -> dict[str, Any]:
    """Return the object that `cadtof simulate --json` prints. A value that does not exist is null."""
    names = ("confidence_v", "confidence_model_v", "impossible", "steps_per_start")
    report: dict[str, Any] = plain(
        {
            "settings": settings(outcome.trials),
            **{name: asdict(path) for name, path in outcome.named_paths.items()},
            **{name: getattr(outcome, name) for name in names},
            "runs": outcome.trials.runs,
        }
    )
    return report


def settings(trials: Trials, /) -> dict[str, Any]:
    """Return all settings of the trials in one flat table."""
    model, resolver = trials.model, asdict(trials.resolver)
    capacitors, stages = model.averaging.capacitors, model.averaging.stages
    of_capacitors = capacitors and {"capacitors_ff": capacitors.values_ff, "f1_hz": stages.f1_hz, "f2_hz": stages.f2_hz}
    of_modulation = ("periods_ns", "waveform", "amplitude_v")
    of_model = ("dead_time_ns", "jitter_ns", "sample_noise_v", "gain_mismatch", "offsets_v")
    not_of_a_pixel = {"mpi_model", "seed", "min_confidence"}
    return {
        **asdict(trials.condition),
        "integration_length": model.averaging.integration_length,
        **{name: getattr(model.modulation, name) for name in of_modulation},
        **{name: getattr(trials, name) for name in ("runs", "seed", "photon_by_photon")},
        "photons_per_cycle": model.photons_per_cycle,
        "cycles": model.photons // model.photons_per_cycle,
        "stages": stages.drive,
        **(of_capacitors or {}),
        **{name: getattr(model, name) for name in of_model},
        **asdict(model.motion),
        **{"return" if name == "returns" else name: resolver[name] for name in resolver if name not in not_of_a_pixel},
        "pulse_correction": trials.pulse_correction,
        "wrapped": trials.wrapped,
    }


def write_evolution(outcome: TrialsSummary, out: Path, /) -> None:
    """Write histogram, voltages and phase of one recording to a new folder, as CSV and PNG each, and the report.

    Raise OutputError if `out` holds something or cannot be written, SettingsError if the stages are switched.
    """
    from cadtof_cli.figures.pixel_evolution import draw_evolution

    trials = outcome.trials
    mix, generator = trials.condition.mix(trials.period_ns), trials.generator(EVOLUTION_KEY)
    recording = evolution(trials.model, mix, generator)
    first, second = recording.voltages_v
    photons, phase_deg = recording.photons, recording.phase_deg
    times_ns = phase_deg / 360.0 * recording.period_ns
    with new_folder(out) as folder:
        for name, columns in {
            "histogram": {"time_ns": recording.bin_ns, "photons": recording.counts},
            "voltages": {"photons": photons, "sc1_v": first, "sc2_v": second},
            "phase": {"photons": photons, "phase_deg": phase_deg, "time_ns": times_ns},
        }.items():
            write_rows(folder / f"{name}.csv", tuple(columns), zip(*columns.values(), strict=True))
        (folder / "summary.json").write_text(json.dumps(json_report(outcome), indent=2) + "\n")
        draw_evolution(recording, trials.condition, folder)
