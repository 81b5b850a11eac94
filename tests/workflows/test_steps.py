"""Progress reports as many steps as it has announced, the last one included."""

from pathlib import Path

import numpy as np

from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.pixel import PixelModel
from cadtof_cli.workflows.calibrate.captures import CalibrateSettings, averaged_captures
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
