"""The record of a run: `run.json`, and `frames.jsonl` with a line per frame. Both are written during the run.

However a run ends, the record of all finished frames is on the disk, and another run can continue from there.
"""

import json
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, field, replace
from pathlib import Path

from cadtof_cli.capture.frames import FrameSource
from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import write_json, writing
from cadtof_cli.records import dataclass
from cadtof_cli.units import first_of
from cadtof_cli.workflows.resolve.earlier import rename_lines
from cadtof_cli.workflows.resolve.lines import FRAMES_FILE, LineFile, open_lines, place_in, remove_map, required_report
from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals, report_of
from cadtof_cli.workflows.resolve.run_document import RunDocument
from cadtof_cli.workflows.resolve.run_json import RUN_FILE, RunRecord


@dataclass
class RunRecorder:
    """Writes `run.json` and `frames.jsonl`.

    A line is appended to `frames.jsonl` as soon as its frame is finished. A run that continues an earlier one appends too. When
    such a run ends, the lines are put into the order of the frames, one line per frame, as if there had been no interruption.
    Before these come the lines of earlier maps for which this run had no frame, because their recorded frames were removed.
    An earlier map goes if its recorded frames are in other maps now: means of frames, if frames were added or removed.

    If frames arrive during the run, it may name frames twice, or not name those of the earlier run. Then the lines of both
    runs stay, but of several lines about a frame only the last.

    Attributes:
        out: folder of the run.
        document: content of `run.json`.
        lines: `frames.jsonl`.
        resumed: whether the run continues an earlier one.
        arriving: whether frames arrive during the run.
        say: called with messages for the user.
    """

    out: Path
    document: RunDocument
    lines: LineFile
    resumed: bool
    arriving: bool
    say: Callable[[str], None]
    _totals: RunTotals = field(default_factory=RunTotals)
    _before: dict[str, int] = field(default_factory=dict)
    _earlier_places: "array[int]" = field(default_factory=lambda: array("q"))
    _places: "array[int]" = field(default_factory=lambda: array("q"))
    _not_met: set[str] = field(default_factory=set)
    _failed: set[str] = field(default_factory=set)
    _recorded: set[str] = field(default_factory=set)
    _removed: list[str] = field(default_factory=list)

    def meet(self, sources: Sequence[FrameSource], output: Path, /) -> FrameReport | None:
        """Return the report of an earlier run on the map in `output`, which frames will have; None: there is none.

        The frames are remembered: other maps of the earlier run may show them.
        """
        folder = place_in(self.out, output).rpartition("/")[0]
        self._recorded.update(f"{folder}/{Path(str(source)).name}" for source in sources)
        place = self._known_place(str(output))
        return None if place is None else self._report_at(place)

    def add(self, report: FrameReport, /) -> None:
        """Append a frame's line. If the maps were kept, the line may be there already; then nothing is written.

        Raises:
            OutputError: the line cannot be written; PlaceError: no other line could be written either.
        """
        line = report.kept or report
        self._totals.add(line)
        text = json.dumps(line.as_json()).encode() + b"\n"
        with writing(self.lines.path):
            place = self._known_place(line.output) if report.kept else None
            if place is None or self.lines.line_at(place) != text:
                place = self.lines.append(text)
        if self.resumed or self.arriving:
            self._places.append(place)
            self._not_met.discard(place_in(self.out, Path(line.output or "")))
            if line.status == "failed":
                self._failed.add(line.source)

    def _known_place(self, output: str | None) -> int | None:
        """Return the place of the earlier run's line about the maps in `output`; None: there is no such line."""
        return self._before.get(place_in(self.out, Path(output or "")))

    def _report_at(self, place: int) -> FrameReport | None:
        return report_of(self.lines.line_at(place))

    def finish(self, seconds: float, /) -> None:
        """Complete both files. The totals count all frames, whichever run resolved them."""
        self.lines.sync()
        places, totals = self._last_lines() if self.arriving else self._lines_in_order()
        if self._removed:
            names = first_of(self._removed, 3)
            self.say(f"{self.out}: removed {names}, because other maps show their recorded frames now")
        if self.resumed or len(places) < len(self._places):
            self.lines.keep(places)
        counts = asdict(replace(totals, seconds=seconds))
        del counts["already_there"]  # always 0: kept maps count by the line of the run that made them
        write_json(self.out / RUN_FILE, {**self.document, "finished": True, "totals": counts})

    def _last_lines(self) -> tuple["array[int]", RunTotals]:
        """Return the places of the last lines about each frame, and their totals. A frame is known by its file and by its map.

        A line whose map has been removed since an earlier run does not count.
        """
        last, key_of, totals = dict[str, int](), dict[str, str](), RunTotals()
        for place in (*self._earlier_places, *self._places):
            report = self._report_at(place)
            assert report is not None
            if report.output and not self._stays(place_in(self.out, Path(report.output)), report):
                continue
            names = [name for name in (report.output, report.source) if name]
            key, *others = [*dict.fromkeys(key_of[name] for name in names if name in key_of), report.source]
            for other in others:
                if other != key:
                    last.pop(other, None)
            key_of.update(dict.fromkeys(names, key))
            last[key] = place
        for report in filter(None, map(self._report_at, last.values())):
            totals.add(report)
        return array("q", last.values()), totals

    def _lines_in_order(self) -> tuple["array[int]", RunTotals]:
        """Return the places of lines, and their totals: those of maps without a frame in this run, then those of this run."""
        kept, totals = array("q"), replace(self._totals)
        for name in filter(self._not_met.__contains__, self._before):
            report = self._report_at(self._before[name])
            if report and report.source not in self._failed and self._stays(name, report):
                totals.add(report)
                kept.append(self._before[name])
        return kept + self._places, totals

    def _stays(self, name: str, report: FrameReport) -> bool:
        """Return whether a line about the map called `name` stays. The map is removed if other maps show its frames now."""
        if name in self._not_met and (self.out / name).is_file():
            frames = {Path(report.source).name, *(file.name for file in report.files or ())}
            folder = name.rpartition("/")[0]
            if not self._recorded.isdisjoint(f"{folder}/{frame}" for frame in frames):
                remove_map(self.out, self.out / name, report)
                self._removed.append(name)
                return False
        return (self.out / name).is_file()

    def find_lines(self) -> None:
        """Find the lines of the earlier run. They have been renamed: they call the folder of the run as this run does.

        Raises:
            OutputError: a line is not a report on a frame.
        """
        for place, line in self.lines.complete_lines():
            report = required_report(line, self.lines.path)
            self._earlier_places.append(place)
            if report.output is not None:
                self._before[place_in(self.out, Path(report.output))] = place
        self._not_met = set(self._before)


@contextmanager
def recorded_run(
    out: Path, document: RunDocument, /, *, earlier: RunRecord | None, arriving: bool, say: Callable[[str], None]
) -> Iterator[RunRecorder]:
    """Write a run's `run.json`, and yield a recorder that holds its `frames.jsonl` open for the reports on its frames.

    `earlier` is the record of the run that is continued; None: there is none.

    Raises:
        OutputError: one of the two cannot be written; or the `frames.jsonl` to be resumed holds other lines than reports.
    """
    path, run = out / FRAMES_FILE, out / RUN_FILE
    if earlier is None:
        # the settings come first: without them, the lines would be taken for lines of the next run
        write_json(run, document)
    else:
        rename_lines(out, earlier)
    with open_lines(path, anew=earlier is None, say=say) as lines:
        recorder = RunRecorder(out, document, lines, earlier is not None, arriving, say)
        if earlier is not None:
            recorder.find_lines()
            write_json(run, document)
        try:
            yield recorder
        except BaseException:
            with suppress(OutputError):
                # inputs that arrived during the run are recorded too
                write_json(run, document)
            raise
