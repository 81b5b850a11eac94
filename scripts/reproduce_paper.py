"""Make the paper's figures and tables with our simulator and resolver, and a page that shows ours beside the paper's."""

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from paper.effort import Effort, quick
from paper.page import page
from paper.pixel_experiments import draw_figure_3, figure_2, figure_3, read_table
from paper.resolver_experiments import TABLE_1, draw_figure_7, draw_figures_8_and_9, figure_6, figures_8_and_9, table_1
from paper.scene_experiments import figure_4, figure_5

ROOT = Path(__file__).resolve().parent.parent

Result = TypeVar("Result")


def main() -> None:
    """Run all experiments, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few runs, for CI; noisier numbers")
    parser.add_argument(
        "--redraw", action="store_true", help="draw Figs. 3, 7, 8 and 9 again from the CSV files that are there"
    )
    parser.add_argument("--out", type=Path, help="folder [default: docs/paper; --quick: out/paper]")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="number of processes")
    arguments = parser.parse_args()
    out = arguments.out or ROOT / ("out/paper" if arguments.quick else "docs/paper")
    out.mkdir(parents=True, exist_ok=True)
    if arguments.redraw:
        redraw(out)
        return
    effort = quick(out, arguments.jobs) if arguments.quick else Effort(out, arguments.jobs)
    made = page(
        effort,
        figure_2=_timed("Fig. 2", figure_2, effort),
        figure_3=_timed("Fig. 3", figure_3, effort),
        figure_4=_timed("Fig. 4", figure_4, effort),
        figure_5=_timed("Fig. 5", figure_5, effort),
        table_1=_timed("Table 1", table_1, effort),
        maps=_timed("Figs. 8 and 9", figures_8_and_9, effort),
    )
    _timed("Fig. 6", figure_6, effort)
    (out / "README.md").write_text(made, encoding="utf-8")
    print(f"page: {out / 'README.md'}")


def redraw(out: Path) -> None:
    """Draw those figures again whose numbers are all in CSV files beside them."""
    draw_figure_3(read_table(out / "fig3.csv"), out)
    draw_figure_7({name: np.loadtxt(out / f"fig7{name}.csv", delimiter=",", skiprows=1).T for name in TABLE_1}, out)
    draw_figures_8_and_9(read_table(out / "fig8_9.csv"), read_table(out / "fig8_9_as_the_paper.csv"), out)


def _timed(name: str, experiment: Callable[[Effort], Result], effort: Effort) -> Result:
    begun = time.perf_counter()
    result = experiment(effort)
    print(f"{name}: {time.perf_counter() - begun:.1f} s", flush=True)
    return result


if __name__ == "__main__":
    main()
