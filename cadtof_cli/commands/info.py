"""`cadtof info`."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from cadtof_cli.commands.options import (
    SectionedCommand,
    capture_options,
    gathered,
    input_paths,
    setting_option,
    settings_option,
)
from cadtof_cli.commands.progress import progress_bar
from cadtof_cli.execution.workers import Workers


@click.command(cls=SectionedCommand)
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@gathered(
    "workers",
    Workers,
    setting_option(
        "-j --jobs",
        Workers,
        type=click.IntRange(1),
        metavar="N",
        help="Processes that read frames.  [default: all cores]",
    ),
)
@settings_option()
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object for each input, a line each.")
@capture_options()
def info(
    inputs: tuple[str, ...],
    workers: Workers,
    settings_file: Path | None,
    as_json: bool,
    overrides: Mapping[str, Any],
) -> int:
    """Show what captures and maps hold: frames, metadata and where each value came from, ranges, noise.

    INPUT is a capture folder, a frame, a map file, the folder of a run, or - for paths on stdin. Every frame is read.

    \b
    Exit status: 0 all is well; 1 something is wrong with a capture or map, and is said on stderr;
    2 wrong usage, or nothing to look into.
    """
    from cadtof_cli.workflows.inspect.info import CaptureFacts, look_into

    with progress_bar("reading", "frames", quiet=False) as bar:
        found = look_into(
            input_paths(inputs), overrides=overrides, settings_file=settings_file, workers=workers, progress=bar
        )
    for facts in found:
        if as_json:
            kind = "capture" if isinstance(facts, CaptureFacts) else "maps"
            click.echo(json.dumps({"kind": kind, **asdict(facts)}))
        else:
            click.echo("\n".join(_capture_lines(facts) if isinstance(facts, CaptureFacts) else _map_lines(facts)))
    problems = [problem for facts in found for problem in facts.problems]
    for problem in problems:
        click.echo(f"wrong: {problem}", err=True)
    return 1 if problems else 0


def _capture_lines(facts: Any) -> Iterator[str]:
    yield facts.root
    kinds = ", ".join(f"{count} {kind}" for kind, count in (*facts.containers.items(), *facts.types.items()))
    yield _row("frames", f"{facts.frames} ({kinds or 'none can be read'})")
    if facts.shape:
        harmonics, channels, height, width = facts.shape
        yield _row("shape", f"{harmonics} harmonics × {channels} channels × {height} × {width} (H C Y X)")
    for key, entry in facts.metadata.items():
        if entry["value"] is not None:
            yield _row(key, f"{_value(entry['value']):24} from {entry['from']}")
        elif key == "pixel.integration_length":
            yield _row(key, "unknown: the noise is estimated from each frame")
    yield _row("unambiguous range", f"{facts.unambiguous_range_m:.3f} m")
    if facts.noise_mv is not None:
        yield _row("noise", f"{facts.noise_mv:.3f} mV a channel, at most, by the integration length")
    if facts.integration_length_seen is not None:
        yield _row("seen in a frame", f"noise and texture as of integration length {facts.integration_length_seen:.4g}")
    for name, (low, high) in facts.planes.items():
        yield _row(f"{name} stored", f"{low:g} … {high:g}")
    yield _row("saturated", f"{facts.saturated:.3%} of pixels")
    yield _row("not finite", f"{facts.not_finite:.3%} of pixels")
    for reason in facts.not_frames:
        yield _row("not a frame", reason)


def _map_lines(facts: Any) -> Iterator[str]:
    yield facts.path
    yield _row("maps", f"{facts.files}" + (f" of {facts.pixels[1]} × {facts.pixels[0]} pixels" if facts.pixels else ""))
    for name, layer in facts.layers.items():
        if layer.median is None:
            yield _row(name, "no answers")
        else:
            figures = f"{layer.lowest:.4g} … {layer.highest:.4g} {layer.unit}, median {layer.median:.4g}"
            yield _row(name, f"{figures}, {layer.valid:.1%} of pixels")
    for name, share in facts.status.items():
        if share:
            yield _row(f"status: {name.replace('_', ' ')}", f"{share:.2%} of pixels")
    if facts.run is not None:
        yield _row("run", f"cadtof {facts.run.get('cadtof')}, {facts.run.get('started')}, {facts.run.get('totals')}")


def _row(name: str, text: str) -> str:
    return f"  {name:28}{text}"


def _value(value: Any) -> str:
    return ", ".join(f"{item:g}" for item in value) if isinstance(value, tuple) else str(value)
