"""`cadtof sweep`."""

from pathlib import Path

import click

from cadtof_cli.commands.help import SectionedCommand, example
from cadtof_cli.commands.options import note_given, setting_option
from cadtof_cli.commands.simulation_options import (
    RESOLVING,
    TrialOptions,
    further_option,
    note_unused,
    quiet_option,
    trial_options,
    workers_option,
)
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import PATH, grid_from_text
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.atomic import require_absent, write_text
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.workflows.simulate import sweep as workflow

GRID = "GRID"


@click.command(
    cls=SectionedCommand,
    headings={
        "Pixel options": {*trial_options.names()} - {"runs", "seed", *RESOLVING},
        "Resolving options": RESOLVING,
    },
    epilog=example("cadtof sweep --asr 1:5:3 --mpi 0,0.3 --integration-length 1e4 -o sweep.csv"),
)
@click.option(
    "--asr",
    metavar=GRID,
    default="1:6:6",
    show_default=True,
    help="Ambient-to-signal ratios: ambient photons over laser photons.",
)
@click.option(
    "--mpi", metavar=GRID, default="0,0.1,0.3", show_default=True, help="Ratios of MPI photons to laser photons."
)
@click.option(
    "--integration-length",
    metavar=GRID,
    help="Integration lengths n_av of Eq. (1), per harmonic.  [default: log:1e3:1e5:5]",
)
@click.option("-o", "--out", type=PATH, help="New CSV file.  [default: stdout]")
@click.option("--plot", type=PATH, help="New folder for pictures like Figs. 3, 8 and 9 of the paper.")
@setting_option(Condition, "direct_ns", "Arrival time of the direct path.", option="--direct")
@setting_option(Condition, "second_ns", "Arrival time of the MPI.", option="--second")
@further_option
@trial_options
@workers_option
@quiet_option
def sweep(
    *,
    asr: str,
    mpi: str,
    integration_length: str | None,
    out: Path | None,
    plot: Path | None,
    direct_ns: float,
    second_ns: float,
    further: tuple[tuple[float, float], ...],
    trial: TrialOptions,
    workers: Workers,
    quiet: bool,
) -> None:
    """Simulate a pixel over a grid of ASR, MPI ratio and integration length.

    A GRID is a list (1,2,5), n values with equal steps (start:stop:n), or n values with equal ratios (log:start:stop:n). The
    CSV has one row per condition: the true time, mean, bias, standard deviation and Cramér–Rao bound of both paths in ns,
    and the first phasor with its analytical model.

    \b
    Exit status:
      0    done
      2    wrong usage or settings, or OUT exists
      130  interrupted
    """
    note_unused(trial)
    lengths = grid_from_text(integration_length or "log:1e3:1e5:5", name="--integration-length")
    asrs, ratios = grid_from_text(asr, name="--asr"), grid_from_text(mpi, name="--mpi")
    if not any(ratios):
        note_given({"second_ns"}, "with --mpi 0")
    averaging = trial.averaging(None if integration_length is None and trial.capacitors else lengths[0])
    if averaging.capacitors is not None:
        lengths = (averaging.integration_length,)
    condition = Condition(
        asr=asrs[0],
        mpi_ratio=ratios[0],
        direct_ns=direct_ns,
        second_ns=second_ns,
        fwhm_ns=trial.fwhm_ns,
        further=further,
    )
    settings = workflow.SweepSettings(
        base=trial.of(condition, averaging), asrs=asrs, mpi_ratios=ratios, integration_lengths=lengths
    )
    for path in (out, plot):
        if path is not None:
            require_absent(path)
    with progress_bar("sweep", "blocks", quiet=quiet) as bar:
        cells = workflow.sweep(settings, workers=workers, progress=bar)
    table = workflow.table_text(cells)
    if out is not None:
        require_absent(out)
        write_text(out, table)
    else:
        tell(*table.rstrip("\n").split("\n"))
    if plot is not None:
        workflow.draw_sweep(cells, plot)
