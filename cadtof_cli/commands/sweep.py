"""`cadtof sweep`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cadtof_cli.commands.progress import progress_bar
from cadtof_cli.commands.simulation_options import (
    MODULATION_OPTIONS,
    PIXEL_OPTIONS,
    PROCESS_OPTIONS,
    RUN_OPTIONS,
    averaging_from_options,
    job_count,
    model_from_options,
    resolver_from_options,
    with_options,
)
from cadtof_cli.errors import SettingsError

if TYPE_CHECKING:
    from cadtof_cli.workflows.simulate.sweep import SweepSettings

GRID = "GRID"


@click.command(short_help="A grid of simulated conditions: CSV and heat maps.")
@click.option("--asr", metavar=GRID, default="1:6:6", show_default=True, help="Ambient to laser photons.")
@click.option("--mpi", metavar=GRID, default="0,0.1,0.3", show_default=True, help="MPI to laser photons.")
@click.option("--integration-length", metavar=GRID, help="n_av of Eq. (1).  [default: log:1e3:1e5:5]")
@click.option("-o", "--out", type=click.Path(path_type=Path), help="New CSV file.  [default: stdout]")
@click.option("--plot", type=click.Path(path_type=Path), help="New folder for heat maps like Figs. 3, 8 and 9.")
@click.option("--direct", "direct_ns", type=float, default=5.0, show_default=True, help="Arrival of the direct path.")
@click.option("--second", "second_ns", type=float, default=16.0, show_default=True, help="Arrival of the MPI, ns.")
@with_options(*RUN_OPTIONS, *PROCESS_OPTIONS, *MODULATION_OPTIONS, *PIXEL_OPTIONS)
def sweep(out: Path | None, plot: Path | None, **options: Any) -> None:
    """Simulate a pixel over a grid of ASR, MPI ratio and integration length.

    A GRID is a list (1,2,5), even steps (start:stop:n) or even ratios (log:start:stop:n). The CSV has a row a
    condition, with both paths' true, mean, bias, std and Cramér–Rao bound in ns, and the first phasor beside its
    analytical model.

    \b
    Exit status: 0 done; 2 wrong usage or settings, or OUT exists; 130 interrupted.
    """
    from cadtof_cli.files.new_folder import require_absent
    from cadtof_cli.workflows.simulate.sweep import draw_sweep, sweep_steps, write_table, write_table_file
    from cadtof_cli.workflows.simulate.sweep import sweep as run_sweep

    settings = _settings(options)
    for path in (out, plot):
        if path is not None:
            require_absent(path)
    with progress_bar("sweep", "blocks", quiet=options["quiet"]) as bar:
        bar.total(sweep_steps(settings))
        cells = run_sweep(settings, jobs=job_count(options["jobs"]), advance=bar.advance)
    if out is not None:
        write_table_file(cells, out)
    else:
        write_table(cells, sys.stdout)
    if plot is not None:
        draw_sweep(cells, plot)


def _settings(options: dict[str, Any]) -> "SweepSettings":
    from cadtof_cli.simulation.grid import grid_from_text
    from cadtof_cli.simulation.trials import Condition, Trials
    from cadtof_cli.workflows.simulate.sweep import SweepSettings

    text = options["integration_length"]
    if text is not None and options["capacitors"] is not None:
        raise SettingsError("--integration-length: found with --capacitors, expected one of the two")
    lengths = grid_from_text(text or "log:1e3:1e5:5", name="--integration-length")
    averaging = averaging_from_options(options, None if options["capacitors"] is not None else lengths[0])
    asrs, ratios = (grid_from_text(options[name], name=f"--{name}") for name in ("asr", "mpi"))
    base = Trials(
        condition=Condition(
            asr=asrs[0],
            mpi_ratio=ratios[0],
            direct_ns=options["direct_ns"],
            second_ns=options["second_ns"],
            fwhm_ns=options["fwhm_ns"],
        ),
        model=model_from_options(options, averaging),
        resolver=resolver_from_options(options),
        runs=options["runs"],
        photon_by_photon=options["photons"],
        seed=options["seed"],
    )
    settings = SweepSettings(
        base=base,
        asrs=asrs,
        mpi_ratios=ratios,
        integration_lengths=(averaging.integration_length,) if averaging.capacitors else lengths,
    )
    for _ in settings.cells():  # every condition checks itself before any work begins
        pass
    return settings
