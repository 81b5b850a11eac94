"""A run in progress closes what it began and loses no line, whatever stops it."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cadtof_cli.workflows.resolve import arrivals
from cadtof_cli.workflows.resolve.ongoing_run import OngoingRun
from cadtof_cli.workflows.resolve.output import MapNames
from cadtof_cli.workflows.resolve.reports import FrameReport
from cadtof_cli.workflows.resolve.resolve import resolve_captures
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from tests.support.captures import record
from tests.support.runs import lines_of


class _Batch:
    """Outcomes of frames, which hold something that must be closed, such as the connection to a cluster."""

    closed = False

    def close(self) -> None:
        self.closed = True


def test_a_batch_is_closed_if_the_report_on_an_input_that_failed_stops_the_run(tmp_path: Path) -> None:
    def gone(_: FrameReport) -> None:
        raise BrokenPipeError

    progress: Any = SimpleNamespace(say=lambda _: None, advance=lambda *_, **__: None)
    run = OngoingRun(ResolveSettings(out=tmp_path), progress, gone, MapNames(tmp_path))
    recorder: Any = SimpleNamespace(add=lambda _: None)
    run.record = recorder
    batch: Any = _Batch()
    with pytest.raises(BrokenPipeError):
        run.report_all([([FrameReport("a.tif", None, "failed", "it is gone", 0.0)], batch)])
    assert batch.closed


def test_an_input_that_failed_is_recorded_before_the_rest_of_its_batch_is_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To plan a batch, a frame of each new folder is read, which takes its time; here the user stops the run meanwhile."""
    known, new, gone = record(tmp_path / "known"), record(tmp_path / "new"), tmp_path / "new" / "gone.tif"

    def stopped(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(arrivals, "plan_captures", stopped)
    progress: Any = SimpleNamespace(say=lambda _: None, advance=lambda *_, **__: None)
    with pytest.raises(KeyboardInterrupt):
        resolve_captures(
            known.files[:1],
            settings=ResolveSettings(out=tmp_path / "out"),
            arriving=[(gone, new.files[0])],
            progress=progress,
            on_frame=lambda _: None,
        )
    sources = [(Path(line["source"]), line["status"]) for line in lines_of(tmp_path / "out")]
    assert sources == [(known.files[0], "ok"), (gone, "failed")]
