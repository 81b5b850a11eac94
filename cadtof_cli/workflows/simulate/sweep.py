"""Simulate a grid of conditions, and lay the results out as a table and as pictures."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cadtof_cli.errors import require
from cadtof_cli.execution.workers import ALONE, Workers
from cadtof_cli.files.atomic import new_folder
from cadtof_cli.files.documents import csv_text
from cadtof_cli.workflows.progress import NO_PROGRESS, Progress
from cadtof_cli.workflows.simulate.outcome import TrialsSummary
from cadtof_cli.workflows.simulate.simulate import simulate_trials
from cadtof_cli.workflows.simulate.trials import Trials

MOST_CELLS = 100_000


@dataclass(frozen=True, kw_only=True)
class SweepSettings:
    """A grid of conditions: values along its axes, and trials with everything that is the same in all cells."""

    base: Trials
    asrs: tuple[float, ...]
    mpi_ratios: tuple[float, ...]
    integration_lengths: tuple[float, ...]

    def __post_init__(self) -> None:
        cells = len(self.asrs) * len(self.mpi_ratios) * len(self.integration_lengths)
        require(1 <= cells <= MOST_CELLS, "grid", f"{cells} conditions", f"1 to {MOST_CELLS}")
        list(self.cells())  # every condition checks itself before any work begins

    def cells(self) -> Iterator[Trials]:
        """Yield the trials of every cell. The MPI ratio is the slowest axis, the integration length the fastest."""
        axes = itertools.product(self.mpi_ratios, self.asrs, self.integration_lengths)
        for stream, (ratio, asr, length) in enumerate(axes):
            condition = replace(self.base.condition, asr=asr, mpi_ratio=ratio)
            model = replace(self.base.model, averaging=replace(self.base.model.averaging, integration_length=length))
            yield replace(self.base, condition=condition, model=model, stream=stream)


def sweep(
    settings: SweepSettings, /, *, workers: Workers = ALONE, progress: Progress = NO_PROGRESS
) -> list[TrialsSummary]:
    """Simulate every cell. The processes share the blocks of runs of all cells."""
    return simulate_trials(list(settings.cells()), workers=workers, progress=progress)


def rows(cells: Sequence[TrialsSummary], /) -> Iterator[dict[str, float]]:
    """Yield the rows of the table, one per condition, as values by column. A value that does not exist is NaN."""
    for cell in cells:
        condition = cell.trials.condition
        values: dict[str, float] = {
            "asr": condition.asr,
            "mpi_ratio": condition.mpi_ratio,
            "integration_length": cell.trials.model.averaging.integration_length,
            "runs": cell.trials.runs,
        }
        for name, path in cell.named_paths.items():
            values |= {f"{name}_{column}": value for column, value in vars(path).items()}
        yield values | {name: value for name, value in vars(cell).items() if name not in {"trials", "paths"}}


def table_text(cells: Sequence[TrialsSummary], /) -> str:
    """Return the table as CSV; each number has seven digits."""
    table = list(rows(cells))
    return csv_text(table[0], (row.values() for row in table), digits=7)


def draw_sweep(cells: Sequence[TrialsSummary], folder: Path, /) -> None:
    """Draw heat maps like the paper's Figs. 3, 8 and 9 into a new folder."""
    from cadtof_cli.figures.sweep_maps import draw_confidence, draw_path_maps

    table = list(rows(cells))
    with new_folder(folder) as partial:
        for name, what, figure in (("bias", "mean error", "Fig. 8"), ("std", "standard deviation", "Fig. 9")):
            title = f"{what} of the resolved time ({figure} of the paper)"
            draw_path_maps(table, f"{name}_ns", partial / f"{name}.png", title=title)
        draw_confidence(table, partial / "first_phasor.png")
