"""`cadtof inspect`."""

import json
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import click

from cadtof_cli.commands.help import SectionedCommand, example
from cadtof_cli.commands.map_options import CAPTURE_HEADING, MAP_HEADING, capture_options, map_options, settings_option
from cadtof_cli.commands.options import RecordOptions, declared_options, note_given
from cadtof_cli.commands.terminal import Bar, tell
from cadtof_cli.commands.values import PATH, PIXEL_PLACE
from cadtof_cli.workflows.resolve.settings import ResolveSettings

_WIDTH = 22

_ROOM = {
    "albedo": "  of the surfaces",
    "beside": " ×  the light of surfaces beside the view, as guessed from its border",
    "later": " ×  the light of later bounces, as computed",
    "unseen": " ×  the direct light: the light of surfaces that are unknown",
    "decay_ns": " ns  in which the light of unknown surfaces falls to 1/e",
    "start_ns": " ns  after the direct light, when the light of unknown surfaces begins",
}
"""Unit and meaning of each number that describes a room with diffuse MPI; they are printed after the number."""


@click.command(
    cls=SectionedCommand,
    headings={**MAP_HEADING, **CAPTURE_HEADING},
    epilog=example("cadtof inspect sample_data/corner/frame_0000.tif --pixel 60,60 -o phasors.png"),
)
@click.argument("frame", type=PATH, metavar="FRAME")
@click.option("--pixel", required=True, type=PIXEL_PLACE, help="Column and row of the pixel; 0,0 is the top left.")
@click.option(
    "--frame",
    "place",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="N",
    help="Which frame, if FRAME is a stack or a folder; 0 is the first.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
@click.option("-o", "--out", type=PATH, help="Also draw the phasors of the pixel: .png, .svg, .pdf or .jpg.")
@click.option("--overwrite", is_flag=True, help="Replace the picture if it exists.")
@RecordOptions(
    "settings",
    partial(ResolveSettings, out=Path()),
    settings_option(),
    map_options("roi"),
    declared_options(ResolveSettings)["calibration"],
    capture_options(),
)
@click.option("-q", "--quiet", is_flag=True, help="Print only errors on stderr: no warnings or notes.")
def inspect(
    *,
    frame: Path,
    pixel: tuple[int, int],
    place: int,
    as_json: bool,
    out: Path | None,
    overwrite: bool,
    settings: ResolveSettings,
    quiet: bool,
) -> None:
    """Show everything about one pixel: voltages, phasors, one and two paths, order test, diffuse MPI, status, neighbours.

    FRAME is a frame, a stack of frames, or a capture folder. It is resolved as `cadtof resolve` does with the same options:
    the chosen answer has the same bits as the map.
    """
    from cadtof_cli.workflows.inspect.pixel import inspect_pixel

    if out is not None:
        from cadtof_cli.figures.kinds import require_picture

        require_picture(out, overwrite=overwrite)
    else:
        note_given({"overwrite"}, "without -o")
    found = inspect_pixel(frame, pixel, place=place, settings=settings, progress=Bar(quiet=quiet))
    if out is not None:
        from cadtof_cli.figures.phasor_diagram import draw_phasors

        title = f"{found.document['frame']}, pixel {pixel[0]},{pixel[1]}: {', '.join(found.document['status'])}"
        draw_phasors(found.evidence, out, title=title)
    tell(*([json.dumps(found.document)] if as_json else _lines(found.document, found.evidence.noise.harmonics)))


def _lines(document: Mapping[str, Any], harmonics: tuple[int, ...]) -> Iterator[str]:
    """Yield the lines of the table."""
    from cadtof_cli.files.maps import STATUS
    from cadtof_cli.maps.layers import layer_unit

    yield f"{document['frame']}, pixel {document['pixel'][0]},{document['pixel'][1]}: {', '.join(document['status'])}"
    noise = document["noise"]
    for row, harmonic in enumerate(harmonics):
        volts = "  ".join(
            f"SC{channel} {_number(value, 3, per_unit=1000)} mV"
            for channel, value in enumerate(document["voltages_v"][row], start=1)
        )
        re, im = document["phasors"][row]
        spread = " and ".join(_number(one, 3, per_unit=1000) for one in noise["sigma_v"][row])
        yield _row(f"harmonic {harmonic}", f"{volts}   phasor {_number(re, 5)}, {_number(im, 5)}   σ {spread} mV")
    origin = "estimated from the frame" if noise["estimated"] else "as given"
    yield _row("noise", f"integration length {noise['integration_length']:.4g}, {origin}")
    if document["one_path"]:
        one = document["one_path"]
        yield _row("one path", f"{_path(one)}   χ² {_number(one['chi_squared'], 2)}")
    for name, path in (document["two_paths"] or {}).items():
        yield _row(f"two paths: {'direct' if name == 'direct' else 'MPI'}", _path(path))
    yield from _test_lines(document["order_test"])
    yield from _diffuse_lines(document["diffuse"])
    for name, value in document["chosen"].items():
        meaning = f"({', '.join(document['status'])})" if name == STATUS else layer_unit(name)
        yield _row(name, "–" if value is None else f"{value:.6g} {meaning}".rstrip())
    yield "direct depth of the neighbours, m"
    for values in document["neighbours_m"]:
        yield "".join(f"{_number(value, 4):>10}" for value in values)


def _test_lines(test: Mapping[str, Any] | None) -> Iterator[str]:
    if test is not None:
        moved, needed = ("–" if test[key] is None else f"{100 * test[key]:.2f} cm" for key in ("moved_m", "needed_m"))
        limit = f"χ² {_number(test['chi_squared'], 2)}, limit {test['threshold']:.2f}"
        yield _row("order test", f"{limit}; a second path moves the direct one by {moved}, needed: {needed}")
        yield _row("", test["verdict"])


def _diffuse_lines(diffuse: Mapping[str, Any] | None) -> Iterator[str]:
    if diffuse is None:
        return
    share = f"{diffuse['patches']} patches with light, {diffuse['separate_share']:.1%} of them with separate paths"
    if diffuse["net_patches"]:
        share += f", {diffuse['net_patches']} with a net or pane before a wall"
    yield _row("MPI of the frame", f"{diffuse['model']} ({diffuse['reason']}); {share}")
    for name, (median, scatter) in (diffuse["room"] or {}).items():
        yield _row(f"  {name.removesuffix('_ns')}", f"{_number(median, 3)} ± {_number(scatter, 3)}{_ROOM[name]}")
    if diffuse["tail"]:
        ratio, too_far_m, chi_squared = (
            diffuse["tail"][key] for key in ("amplitude_ratio", "pulled_back_m", "chi_squared")
        )
        pulled = f"first phasor {_number(too_far_m, 2, per_unit=100)} cm too far, χ² {_number(chi_squared, 2)}"
        yield _row("tail at the pixel", f"amplitude × {_number(ratio, 3)}, {pulled}")
    elif diffuse["in_separate_patch"]:
        yield _row("", "the pixel has separate paths")


def _path(path: Mapping[str, float | None]) -> str:
    depth, sigma, amplitude = path["depth_m"], path["sigma_m"], path["amplitude_v"]
    if depth is None:
        return "none"
    centimetres, millivolts = _number(sigma, 2, per_unit=100), _number(amplitude, 3, per_unit=1000)
    return f"{_number(depth, 4)} m ± {centimetres} cm, {millivolts} mV"


def _number(value: float | None, digits: int, *, per_unit: int = 1) -> str:
    """Return a number in a unit of which `per_unit` make one, such as 100 cm; None: there is no value."""
    return "–" if value is None else f"{per_unit * value:.{digits}f}"


def _row(name: str, text: str) -> str:
    return f"  {name:{_WIDTH}}{text}"
