"""The texts on the page of a run: its record and the lines of its frames, in words."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cadtof_cli.maps.evaluation import DepthErrors
from cadtof_cli.report.colours import thumbnail
from cadtof_cli.report.page import ShownFrame
from cadtof_cli.report.sections import FrameLine, PageText
from cadtof_cli.workflows.resolve.lines import FRAMES_FILE
from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals
from cadtof_cli.workflows.resolve.run_json import RUN_FILE
from cadtof_cli.workflows.run_folder import Run

_PIXELS = {
    "one_path": "one path",
    "two_paths": "two paths",
    "more_paths": "more paths",
    "diffuse": "diffuse MPI",
    "invalid": "no answer",
}
"""The counts of pixels in a frame's line, in words."""


def page_text(
    run: Run,
    /,
    *,
    viewed: Mapping[Path, ShownFrame],
    depth_limits_m: tuple[float, float],
    problems: Mapping[Path, str],
    errors: Mapping[str, DepthErrors],
) -> PageText:
    """Return the texts on the page of a run.

    `viewed` holds the frames of the viewer in their order, by the files of their maps, and `problems` why others cannot be read.
    `errors` are those against truth, by what has them: the direct path, the first phasor.
    """
    reports = list(run.reports())
    if run.maps.is_file():
        reports = [report for report in reports if run.map_of(report) in run.files]
    shown = {
        file: FrameLine(
            one.name,
            number=number,
            thumbnail=thumbnail(one.small_m, depth_limits_m),
            size=(one.small_m.shape[1], one.small_m.shape[0]),
        )
        for number, (file, one) in enumerate(viewed.items())
    }
    lines = tuple(_lines(run, reports, shown, problems))
    totals = RunTotals()
    for report in reports:
        totals.add(report)
    record: Mapping[str, Any] = run.record or {}
    return PageText(
        title=run.maps.resolve().name or str(run.maps),
        subtitle=_subtitle(run),
        facts=tuple(_facts(record, totals, lines)),
        pixels={words: getattr(totals, name) for name, words in _PIXELS.items()},
        notes=tuple(_notes(run, reports, problems, shown=len(shown))),
        errors=errors,
        frames=lines,
        settings=dict(_settings(record)),
    )


def _lines(
    run: Run, reports: Sequence[FrameReport], shown: Mapping[Path, FrameLine], problems: Mapping[Path, str]
) -> Iterator[FrameLine]:
    """Yield a line for each frame of the record in its order, then a line for each map that the record does not name."""
    recorded = [(report, run.map_of(report)) for report in reports]
    named, there = {file for _, file in recorded}, set(run.files) - problems.keys()
    for report, file in (*recorded, *((None, file) for file in run.files if file not in named)):
        line = FrameLine("" if report is None else report.source)
        if file is not None:
            line = shown.get(file, FrameLine(run.name(file)))
        if report is not None:
            counts = {words: getattr(report, name) for name, words in _PIXELS.items()}
            known = {words: count for words, count in counts.items() if count is not None}
            line = replace(line, status=report.status, reason=report.reason, seconds=report.seconds, pixels=known)
        if file is not None and file not in there:
            line = replace(line, status="failed", reason=problems.get(file, "its maps are gone"))
        yield line


def _subtitle(run: Run) -> str:
    if run.record is None:
        return f"maps in {run.maps}"
    named = str(run.captures[0]["root"]) if len(run.captures) == 1 else f"{len(run.captures)} captures"
    return f"{named}, resolved by cadtof {run.record.get('cadtof')}, {run.record.get('started')}"


def _facts(record: Mapping[str, Any], totals: RunTotals, lines: Sequence[FrameLine]) -> Iterator[tuple[str, str]]:
    yield "frames", str(len(lines))
    if totals.frames:
        yield "resolved", str(totals.ok)
        yield "failed", str(sum(line.status == "failed" for line in lines))
        yield "skipped", str(totals.skipped)
        if totals.diffuse_frames:
            yield "with diffuse MPI", str(totals.diffuse_frames)
    seconds = _table(record, "totals").get("seconds")
    if isinstance(seconds, int | float):
        yield "time", f"{seconds:.1f} s"


def _notes(run: Run, reports: Sequence[FrameReport], problems: Mapping[Path, str], *, shown: int) -> Iterator[str]:
    if run.record is None:
        yield f"There is no {RUN_FILE} beside the maps: settings, totals and failures of the run are not known."
    elif not run.record.is_finished:
        yield "The run has not finished: this page shows what it had done until then."
    if run.record is not None and not reports:
        yield f"There is no {FRAMES_FILE} beside the maps, or it is empty: which frames were resolved, and how, is not known."
    for capture in run.captures:
        if capture.get("lossy_compression"):
            how = f"with lossy compression ({capture['lossy_compression']})"
            yield f"{capture['root']} was recorded {how}, which changes voltages and so depths."
    if shown < (there := len(run.files) - len(problems)):
        yield (
            f"The page shows {shown} of {there} frames with maps, evenly spread over the run, because it would become larger "
            f"than --max-size-mb. Totals are of all frames; {FRAMES_FILE} lists them."
        )
    if problems:
        yield f"{len(problems)} of the maps cannot be read; the reasons are listed under Failures."


def _settings(record: Mapping[str, Any]) -> Iterator[tuple[str, Sequence[tuple[str, str, str]]]]:
    """Yield tables by their captions: the run's arguments, each capture's metadata, the calibration."""
    if not record:
        return
    about = {name: record[name] for name in ("cadtof", "kernel", "started", "finished") if record.get(name) is not None}
    arguments = {name: value for name, value in _table(record, "arguments").items() if not name.endswith("_inputs")}
    yield "Run", [(name, _plain(value), "") for name, value in (about | arguments).items()]
    for number, capture in enumerate(record.get("captures", []), start=1):
        origins = _table(capture, "origins")
        known = {"root": capture.get("root"), "files": capture.get("files")} | _flat(_table(capture, "metadata"))
        # a key without a value tells nothing
        rows = [(name, _plain(value), str(origins.get(name, ""))) for name, value in known.items() if value is not None]
        yield f"Capture {number}: {capture.get('root')}", rows
    calibration = _table(record, "calibration")
    if calibration:
        yield "Calibration", [(name, _plain(value), "") for name, value in _flat(calibration).items()]


def _table(record: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a table of the record. If there is something else in its place, return an empty one: it may come from anywhere."""
    found = record.get(name)
    return found if isinstance(found, Mapping) else {}


def _flat(tables: Mapping[str, Any], /, *, above: str = "") -> dict[str, Any]:
    """Return tables within tables as one table with dotted names."""
    found: dict[str, Any] = {}
    for name, value in tables.items():
        found |= (
            _flat(value, above=f"{above}{name}.") if isinstance(value, Mapping) and value else {above + name: value}
        )
    return found


def _plain(value: Any) -> str:
    """Return a value of the record as people read it."""
    if value is None or value == {}:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(_plain, value))
    return value if isinstance(value, str) else json.dumps(value)
