"""The texts on the page of a run: its record and the lines of its frames, in words."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cadtof_cli.arrays import Float32
from cadtof_cli.maps.evaluation import DepthErrors
from cadtof_cli.report.colours import thumbnail
from cadtof_cli.report.sections import FrameLine, PageText
from cadtof_cli.workflows.frame_report import FrameReport, RunTotals
from cadtof_cli.workflows.run_folder import FRAMES_FILE, RUN_FILE, Run

_PIXELS = {
    "one_path": "one path",
    "two_paths": "two paths",
    "more_paths": "more paths",
    "diffuse": "diffuse MPI",
    "invalid": "no answer",
}
"""What pixels are counted by in a frame's line, in words."""

_ERRORS = ("median_cm", "p90_cm", "rmse_cm", "bias_cm")
_SHARES = ("valid", "within_1_sigma", "within_2_sigma")


@dataclass(frozen=True)
class MapOfFrame:
    """A frame's maps on the page: their number in the viewer, a small map of depths, and the limits of its colours."""

    number: int
    depth_m: Float32
    limits_m: tuple[float, float]


def page_text(
    run: Run,
    /,
    *,
    maps: Mapping[Path, MapOfFrame],
    problems: Mapping[Path, str],
    errors: Mapping[str, DepthErrors],
) -> PageText:
    """Return the texts on the page of a run.

    Args:
        run: whose page it is.
        maps: those that the page shows.
        problems: why the others cannot be read.
        errors: against truth, by what they are of.
    """
    reports = _reports_of(run)
    lines = tuple(_lines(run, reports, maps, problems))
    totals = RunTotals()
    for report in reports:
        totals.add(report)
    record = run.record or {}
    return PageText(
        title=run.maps.resolve().name or str(run.maps),
        subtitle=_subtitle(record, run),
        facts=tuple(_facts(record, totals, lines)),
        pixels={words: getattr(totals, name) for name, words in _PIXELS.items()},
        notes=tuple(_notes(run, reports, problems)),
        errors=[_error_line(title, one) for title, one in errors.items()],
        frames=lines,
        settings=dict(_settings(record)),
    )


def _reports_of(run: Run) -> Sequence[FrameReport]:
    """Return the lines of the run's frames; of one map alone its own."""
    reports = run.reports()
    return [report for report in reports if run.map_of(report) in run.files] if run.maps.is_file() else reports


def _lines(
    run: Run, reports: Sequence[FrameReport], maps: Mapping[Path, MapOfFrame], problems: Mapping[Path, str]
) -> Iterator[FrameLine]:
    """Yield a line for each frame of the record in its order, then those of maps that the record does not name."""
    left = dict.fromkeys(run.files)
    for report in reports:
        file = run.map_of(report)
        left.pop(file, None) if file is not None else None
        yield _line(run, report, file, maps, problems)
    for file in left:
        yield _line(run, None, file, maps, problems)


def _line(
    run: Run,
    report: FrameReport | None,
    file: Path | None,
    maps: Mapping[Path, MapOfFrame],
    problems: Mapping[Path, str],
) -> FrameLine:
    if file is None:
        assert report is not None
        return _recorded(FrameLine(report.source), report)
    line = _shown(FrameLine(run.name(file)), maps[file]) if file in maps else FrameLine(run.name(file))
    if report is not None:
        line = _recorded(line, report)
    if file in problems:
        return replace(line, status="failed", reason=problems[file])
    return line if file in maps else replace(line, status="failed", reason="its maps are gone")


def _shown(line: FrameLine, one: MapOfFrame) -> FrameLine:
    """Return a frame's line with its place in the viewer and its thumbnail."""
    height, width = one.depth_m.shape
    picture = thumbnail(one.depth_m, one.limits_m)
    return replace(line, number=one.number, thumbnail=picture, size=(width, height))


def _recorded(line: FrameLine, report: FrameReport) -> FrameLine:
    """Return a frame's line with what the run recorded of it."""
    counts = {words: getattr(report, name) for name, words in _PIXELS.items()}
    known = {words: count for words, count in counts.items() if count is not None}
    return replace(line, status=report.status, reason=report.reason, seconds=report.seconds, pixels=known)


def _subtitle(record: Mapping[str, Any], run: Run) -> str:
    if not record:
        return f"maps in {run.maps}"
    captures = [str(capture.get("root")) for capture in record.get("captures", [])]
    named = captures[0] if len(captures) == 1 else f"{len(captures)} captures"
    return f"{named}, resolved by cadtof {record.get('cadtof')}, {record.get('started')}"


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


def _notes(run: Run, reports: Sequence[FrameReport], problems: Mapping[Path, str]) -> Iterator[str]:
    if run.record is None:
        yield f"There is no {RUN_FILE} beside the maps: settings, totals and failures of the run are not known."
    elif not run.record.get("finished"):
        yield "The run has not finished: what it had done until then is here."
    if run.record is not None and not reports:
        yield f"There is no {FRAMES_FILE} beside the maps, or nothing in it: what became of the frames is not known."
    for capture in (run.record or {}).get("captures", []):
        if capture.get("lossy_compression"):
            how = f"with lossy compression ({capture['lossy_compression']})"
            yield f"{capture.get('root')} was recorded {how}, which changes voltages and so depths."
    if problems:
        yield f"{len(problems)} of the maps cannot be read; the reasons stand under Failures."


def _error_line(title: str, errors: DepthErrors) -> tuple[str, ...]:
    figures = (getattr(errors, name) for name in _ERRORS)
    shares = (getattr(errors, name) for name in _SHARES)
    return (
        title,
        *("–" if figure is None else f"{figure:.2f}" for figure in figures),
        *("–" if share is None else f"{100.0 * share:.1f} %" for share in shares),
    )


def _settings(record: Mapping[str, Any]) -> Iterator[tuple[str, Sequence[tuple[str, str, str]]]]:
    """Yield tables by their captions: the run's arguments, each capture's metadata, the calibration."""
    if not record:
        return
    about = {name: record[name] for name in ("cadtof", "kernel", "started", "finished") if name in record}
    arguments = {name: value for name, value in _table(record, "arguments").items() if not name.endswith("_inputs")}
    yield "Run", [(name, _plain(value), "") for name, value in (about | arguments).items()]
    for number, capture in enumerate(record.get("captures", []), start=1):
        origins = _table(capture, "origins")
        known = {"root": capture.get("root"), "files": capture.get("files")} | _flat(_table(capture, "metadata"))
        rows = [(name, _plain(value), str(origins.get(name, ""))) for name, value in known.items()]
        yield f"Capture {number}: {capture.get('root')}", rows
    calibration = _table(record, "calibration")
    if calibration:
        yield "Calibration", [(name, _plain(value), "") for name, value in _flat(calibration).items()]


def _table(record: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a table of the record; an empty one where it holds something else, for it may come from anywhere."""
    found = record.get(name)
    return found if isinstance(found, Mapping) else {}


def _flat(tables: Mapping[str, Any], /, *, above: str = "") -> dict[str, Any]:
    """Return tables within tables as one, by dotted names."""
    found: dict[str, Any] = {}
    for name, value in tables.items():
        found |= (
            _flat(value, above=f"{above}{name}.") if isinstance(value, Mapping) and value else {above + name: value}
        )
    return found


def _plain(value: Any) -> str:
    """Return a value of the record as people read it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(_plain, value))
    return value if isinstance(value, str) else json.dumps(value)
