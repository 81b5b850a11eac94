"""`cadtof info`."""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from cadtof_cli.commands.help import SectionedCommand, example
from cadtof_cli.commands.map_options import CAPTURE_HEADING, capture_options, settings_option
from cadtof_cli.commands.options import RecordOptions, input_paths, jobs_option, note_given, null_option, refuse_given
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import INPUT, PATH
from cadtof_cli.execution.workers import Workers
from cadtof_cli.units import size_text

_NAMED_PER_REASON = 5
"""How many frames with the same problem are named; one wrong setting can cause the same problem in all frames."""


@click.command(cls=SectionedCommand, headings=CAPTURE_HEADING, epilog=example("cadtof info sample_data/corner"))
@click.argument("inputs", nargs=-1, type=INPUT, required=True, metavar="INPUT...")
@RecordOptions("workers", Workers, jobs_option("Processes that read frames"))
@null_option()
@click.option("-r", "--recursive", is_flag=True, help="Also search all folders below each INPUT.")
@settings_option()
@click.option(
    "--write-settings",
    is_flag=True,
    help="Write a commented capture.toml with the known settings and what the frames show, to be completed by hand.",
)
@click.option(
    "-o",
    "--out",
    type=PATH,
    metavar="FILE",
    help="File for --write-settings.  [default: capture.toml in the capture's folder]",
)
@click.option("--overwrite", is_flag=True, help="Replace the file of --write-settings if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per input, one per line.")
@capture_options()
def info(
    inputs: tuple[str, ...],
    workers: Workers,
    null: bool,
    recursive: bool,
    settings_file: Path | None,
    write_settings: bool,
    out: Path | None,
    overwrite: bool,
    as_json: bool,
    overrides: Mapping[str, Any],
) -> int:
    """Show what captures, maps and calibrations contain: frames, settings and their origin, value ranges, noise.

    INPUT is a capture folder, a frame file, a map file, the folder of a run or of a calibration, or - for paths on stdin.
    Every frame is read.

    \b
    Exit status:
      0  no problem found
      1  an input has a problem, reported on stderr
      2  wrong usage, or nothing to show
    """
    from cadtof_cli.workflows.inspect.capture_facts import CaptureFacts
    from cadtof_cli.workflows.inspect.info import CalibrationFacts, MapFacts, look_into

    shown: dict[type, tuple[str, Callable[[Any], Iterator[str]]]] = {
        CaptureFacts: ("capture", _capture_lines),
        MapFacts: ("maps", _map_lines),
        CalibrationFacts: ("calibration", _calibration_lines),
    }

    if not write_settings:
        refuse_given({"out", "overwrite"}, "without --write-settings")
    with progress_bar("reading", "frames") as bar:
        found = look_into(
            input_paths(inputs, null=null),
            overrides=overrides,
            workers=workers,
            progress=bar,
            settings_file=settings_file,
            recursive=recursive,
        )
    for facts in found:
        kind, lines = shown[type(facts)]
        tell(*([json.dumps({"kind": kind, **asdict(facts)})] if as_json else lines(facts)))
    captures = [facts for facts in found if isinstance(facts, CaptureFacts)]
    if not captures:
        note_given({*capture_options().names(), "settings_file"}, "without a capture as INPUT")
    if write_settings:
        _write_settings([facts for facts in captures if facts.metadata], out, overwrite=overwrite)
    problems = [problem for facts in found for problem in facts.problems]
    for line in _problem_lines(problems):
        tell(f"wrong: {line}", err=True)
    return 1 if problems else 0


def _problem_lines(problems: Sequence[str]) -> Iterator[str]:
    """Yield the problems. If many frames have the same reason, yield the first few, and how many more there are."""
    # the part that follows the name of the file
    every = [problem.partition(": ")[2] or problem for problem in problems]
    reasons, told = Counter(every), Counter[str]()
    for problem, reason in zip(problems, every, strict=True):
        told[reason] += 1
        if told[reason] <= _NAMED_PER_REASON:
            yield problem
        elif told[reason] == reasons[reason]:
            yield f"{told[reason] - _NAMED_PER_REASON} more for the same reason; --json names all"


def _write_settings(found: Sequence[Any], out: Path | None, *, overwrite: bool) -> None:
    from cadtof_cli.workflows.inspect.write_settings import write_settings

    if not found or (len(found) > 1 and out is not None):
        expected = "one for the file of -o" if found else "one or more"
        raise click.UsageError(f"--write-settings: found {len(found)} captures, expected {expected}")
    for facts in found:
        path = write_settings(facts, out=out, overwrite=overwrite)
        tell(f"wrote {path}: complete it by hand", err=True)


def _capture_lines(facts: Any) -> Iterator[str]:
    yield facts.root
    kinds = ", ".join(f"{count} {kind}" for kind, count in (*facts.containers.items(), *facts.types.items()))
    yield _row("frames", f"{facts.frames} ({kinds or 'none can be read'})")
    if facts.lossy_compression:
        yield _row("lossy compression", f"{facts.lossy_compression}: it changes voltages, and so depths")
    if facts.shape:
        harmonics, channels, height, width = facts.shape
        yield _row("shape", f"{harmonics} harmonics × {channels} channels × {height} × {width} (H C Y X)")
    for key, entry in facts.metadata.items():
        if entry["value"] is not None:
            yield _row(key, f"{_value(entry['value']):24} from {entry['from']}")
        elif key == "pixel.integration_length":
            yield _row(key, "unknown: the noise is estimated from each frame")
    if facts.metadata:
        yield _row("unambiguous range", f"{facts.unambiguous_range_m:.3f} m")
    if facts.noise_mv is not None:
        known = facts.metadata["pixel.integration_length"]["value"] is not None
        by = "the integration length" if known else "the integration length seen"
        yield _row("noise", f"{facts.noise_mv:.3f} mV per channel in ambient light, from {by}")
    if facts.integration_length_seen is not None:
        most = f" … {facts.integration_lengths_seen[1]:.4g}" if facts.noise_changes else ""
        seen = f"{facts.integration_length_seen:.4g}{most} or more"
        yield _row("integration length seen", f"{seen}, from the scatter of neighbouring pixels in a frame")
    for name, (low, high) in facts.planes.items():
        yield _row(f"{name} stored", f"{low:g} … {high:g}")
    if facts.shape:
        limits = facts.metadata["voltage.saturated_counts"]["value"]
        share = f"{facts.saturated:.3%} of pixels" if limits else "unknown: voltage.saturated_counts is not given"
        yield _row("saturated", share)
        yield _row("not finite", f"{facts.not_finite:.3%} of pixels")
    for reason in facts.not_frames:
        yield _row("not a frame", reason)


def _map_lines(facts: Any) -> Iterator[str]:
    from cadtof_cli.resolver.status import StatusBit, bit_words

    yield facts.path
    figures_of = "; the figures are those of the first" if facts.files > 1 and facts.layers else ""
    yield _row("maps", f"{facts.files}{f' of {size_text(facts.pixels)} pixels' if facts.pixels else ''}{figures_of}")
    for name, layer in facts.layers.items():
        if layer.median is None:
            yield _row(name, "no answers")
        else:
            unit = f" {layer.unit}" if layer.unit else ""
            figures = f"{layer.lowest:.4g} … {layer.highest:.4g}{unit}, median {layer.median:.4g}"
            yield _row(name, f"{figures}, {layer.valid:.1%} of pixels")
    for name, share in facts.status.items():
        if share:
            yield _row(f"status: {bit_words(StatusBit[name.upper()])}", f"{share:.2%} of pixels")
    for name, text in facts.about.items():
        yield _row(name, text)
    if facts.run is not None:
        yield _row("run", _run_text(facts.run))


def _run_text(run: Mapping[str, Any]) -> str:
    """Return version, beginning and totals of a run as words."""
    totals = run.get("totals")
    done = "not finished"
    if isinstance(totals, dict):
        counts = {name: totals.get(name, 0) for name in ("ok", "frames", "failed", "skipped")}
        done = f"{counts['ok']} of {counts['frames']} frames in {totals.get('seconds', 0):.4g} s"
        done += "".join(f", {counts[name]} {name}" for name in ("failed", "skipped") if counts[name])
    return f"cadtof {run.get('cadtof')}, {run.get('started')}: {done}"


def _calibration_lines(facts: Any) -> Iterator[str]:
    yield facts.path
    rows = [("calibration", f"digest {facts.digest}" if facts.digest else "cannot be read")]
    for kind, part in facts.parts.items():
        for name, value in part.items():
            for inner, entry in value.items() if isinstance(value, dict) else (("", value),):
                first, *more = _texts(entry)
                rows += [(".".join(filter(None, (kind, name, inner))), first), *(("", text) for text in more)]
    width = max(len(name) for name, _ in rows) + 2
    yield from (_row(name, text, width) for name, text in rows)


def _texts(value: Any) -> list[str]:
    """Return the lines that show a value: a line for each text of a list of texts, otherwise one line."""
    texts = isinstance(value, list) and value and all(isinstance(entry, str) for entry in value)
    return list(value) if texts else [_value(value)]


def _row(name: str, text: str, width: int = 28) -> str:
    return f"  {name:{width}}{text}"


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_value(entry)}" for name, entry in value.items()) or "none"
    if isinstance(value, list | tuple):
        if value and isinstance(value[0], tuple):
            return ", ".join(f"{name} = {_value(entry)}" for name, entry in value)
        return ", ".join(map(_value, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
