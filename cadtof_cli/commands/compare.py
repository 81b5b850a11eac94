"""`cadtof compare`."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cadtof_cli.commands.help import Command, example
from cadtof_cli.commands.options import note_given
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import PATH
from cadtof_cli.units import counted, first_of

if TYPE_CHECKING:
    from cadtof_cli.workflows.inspect.compare import Comparison, FrameDifference


@click.command(
    cls=Command,
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof resolve sample_data/corner -o separate --mpi-model discrete",
        "cadtof compare maps separate -o differences.png",
        "cadtof compare maps sample_data/corner/truth.exr",
    ),
)
@click.argument("first", type=PATH, metavar="A")
@click.argument("second", type=PATH, metavar="B")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
@click.option("-o", "--out", type=PATH, help="Draw the frame that differs most: .png, .pdf, .svg or .jpg.")
@click.option("--overwrite", is_flag=True, help="Replace the picture if it exists.")
def compare(*, first: Path, second: Path, as_json: bool, out: Path | None, overwrite: bool) -> None:
    """Show what differs between two runs, or between a run and truth, layer by layer and bit by bit.

    A and B are folders that `cadtof resolve` wrote, or map files. Frames are matched by name; a single file, such as truth, is
    compared with every frame. The numbers are statistics of |A − B| over all frames and all pixels that have a value in both.
    A status bit is gained where B has it and A does not, and lost where A has it and B does not.
    """
    from cadtof_cli.workflows.inspect.compare import MapPairs, compare_maps, draw_worst

    if out is not None:
        from cadtof_cli.figures.kinds import require_picture

        require_picture(out, overwrite=overwrite)
    else:
        note_given({"overwrite"}, "without -o")
    with progress_bar("comparing", "frames") as bar:
        pairs = MapPairs(first, second)
        found = compare_maps(pairs, progress=bar)
    if out is not None:
        draw_worst(pairs, found, out)
    tell(*([json.dumps(asdict(found))] if as_json else _lines(found)))
    if out is not None:
        tell(out, err=as_json)


def _lines(found: "Comparison") -> Iterator[str]:
    """Yield the lines of the table."""
    from cadtof_cli.maps.layers import layer_unit

    yield f"{'|A − B|':26}{'median':>12}{'90 %':>12}{'largest':>12}   ({counted(found.frames, 'frame')})"
    for name, layer in found.layers.items():
        unit, figures = layer_unit(name), (layer.median_abs, layer.p90_abs, layer.max_abs)
        title = f"{name}, {unit}" if unit else name
        row = f"{title:26}{''.join(f'{_number(figure):>12}' for figure in figures)}"
        one_sided = found.answers.get(name)
        yield f"{row}   {one_sided.only_a} pixels only in A, {one_sided.only_b} only in B" if one_sided else row
    if found.status_changed is not None:
        yield f"{'status differs':26}{found.status_changed:>12} pixels"
    for bit, change in found.status_bits.items():
        yield f"  {bit:24}{change.gained:>12} gained{change.lost:>12} lost"
    for which, only in (("A", found.only_a), ("B", found.only_b)):
        for what, names in only.items():
            if names:
                yield f"only {which} has the {what} {first_of(names, 4)}"
    different = [frame for frame in found.worst if frame.max_abs or frame.status_changed]
    if found.frames > 1 and found.worst_by and different:
        unit = layer_unit(found.worst_by)
        yield f"frames that differ most, by 90 % of {found.worst_by}:"
        yield from (_worst(frame, unit) for frame in different)


def _worst(frame: "FrameDifference", unit: str) -> str:
    bits = "" if frame.status_changed is None else f", status of {frame.status_changed} pixels"
    return f"  {frame.frame}: {_number(frame.p90_abs)} {unit}, at most {_number(frame.max_abs)} {unit}{bits}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
