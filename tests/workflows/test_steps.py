"""Progress reports as many steps as it has announced, the last one included."""

from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.errors import CadtofError
from cadtof_cli.execution.outcome import Outcome, WorkerDied
from cadtof_cli.execution.workers import ALONE
from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.pixel import PixelModel
from cadtof_cli.workflows import progress
from cadtof_cli.workflows.calibrate.captures import CalibrateSettings, averaged_captures
from cadtof_cli.workflows.inspect import capture_facts
from cadtof_cli.workflows.inspect.preview import preview
from cadtof_cli.workflows.inspect.preview_settings import PreviewSettings
from cadtof_cli.workflows.simulate.sweep import SweepSettings, sweep
from cadtof_cli.workflows.simulate.trials import Trials
from tests.support.captures import TOML, record
from tests.support.told import Told


def test_a_sweep_reports_a_step_for_each_cell() -> None:
    told, pixel = Told(), PixelModel(averaging=Averaging(integration_length=1e4))
    base = Trials(condition=Condition(asr=1.0, mpi_ratio=0.1), model=pixel, runs=2)
    sweep(SweepSettings(base=base, asrs=(1.0, 2.0), mpi_ratios=(0.0, 0.1), integration_lengths=(1e4,)), progress=told)
    assert (told.expected, told.steps) == (4, 4)


def test_a_calibration_reports_a_step_for_each_frame_of_a_stack(tmp_path: Path) -> None:
    told, folder = Told(), record(tmp_path / "capture", frames=0, toml=TOML["tif"]).folder
    np.save(
        folder / "stack.npy", np.arange(8190, 8193, dtype="u2").reshape(3, 1, 1, 1, 1) + np.zeros((2, 2, 8, 6), "u2")
    )
    settings = CalibrateSettings(out=tmp_path / "camera")
    averaged_captures([folder], "dark", settings=settings, progress=told)
    assert (told.expected, told.steps) == (3, 3)


def test_pictures_of_many_frames_report_two_steps_for_each(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3)
    for name in ("a.png", "a.gif"):
        told = Told()
        preview([capture.folder], tmp_path / name, settings=PreviewSettings(), progress=told)
        assert (told.expected, told.steps) == (6, 6)


def test_a_task_whose_process_died_twice_is_an_error_and_a_frame_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A summary of the other tasks would be a wrong number without a message."""

    def died(_function: Any, tasks: Iterable[Any], **_: Any) -> Generator[Outcome[Any, Any], None, None]:
        yield from (Outcome(task, WorkerDied()) for task in tasks)

    monkeypatch.setattr(progress, "run_ordered", died)
    with pytest.raises(CadtofError, match="a worker process ended without a result, twice"):
        list(progress.results(str, [1, 2], workers=ALONE, progress=Told()))
    monkeypatch.setattr(capture_facts, "run_ordered", died)
    capture = record(tmp_path / "capture", frames=2)
    (facts,) = capture_facts.facts_of_captures(find_captures([capture.folder]), workers=ALONE, progress=Told())
    assert facts.problems == [f"{file}: the process that read it died, twice" for file in capture.files]
