"""A run in progress closes what it began and loses no line, whatever stops it."""

import itertools
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cadtof_cli.execution.workers import ALONE
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.workflows.resolve import arrivals, frame_task
from cadtof_cli.workflows.resolve.ongoing_run import OngoingRun
from cadtof_cli.workflows.resolve.output import MapNames
from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals
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


def _resolved(inputs: Sequence[Path], out: Path, *batches: tuple[Path, ...], resume: bool = False) -> RunTotals:
    progress: Any = SimpleNamespace(say=lambda _: None, advance=lambda *_, **__: None)
    settings = ResolveSettings(out=out, workers=ALONE, resume=resume)
    arriving = batches or None
    return resolve_captures(inputs, settings=settings, arriving=arriving, progress=progress, on_frame=lambda _: None)


def test_a_folder_with_wrong_settings_that_arrives_takes_no_other_folder_with_it(tmp_path: Path) -> None:
    known, wrong, good = (record(tmp_path / name, frames=2) for name in ("known", "wrong", "good"))
    (wrong.folder / "capture.toml").write_text("[pulse]\nfwhm_ns = 99.0\n")
    totals = _resolved(
        known.files[:1], tmp_path / "out", (wrong.files[0], good.files[0]), (*wrong.files, good.files[1])
    )
    assert (totals.ok, totals.failed) == (3, 2)
    failed = [line for line in lines_of(tmp_path / "out") if line["status"] == "failed"]
    assert [line["source"] for line in failed] == [str(wrong.files[0]), str(wrong.folder)]
    assert all("pulse.fwhm_ns: found 99.0, expected" in line["reason"] for line in failed)


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (ZeroDivisionError("by zero"), "unexpected ZeroDivisionError: by zero; please report it with the frame"),
        (MemoryError(), "not enough memory for a frame of this size: try fewer --jobs, or more memory"),
    ],
)
def test_an_error_that_nobody_expected_costs_only_its_frame(
    error: Exception, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture, times = record(tmp_path / "capture", frames=3), itertools.count()

    def failing(*arguments: Any, **more: Any) -> Any:
        if next(times) == 1:
            raise error
        return resolve_frame(*arguments, **more)

    monkeypatch.setattr(frame_task, "resolve_frame", failing)
    totals = _resolved([capture.folder], tmp_path / "out")
    assert (totals.ok, totals.failed) == (2, 1)
    (line,) = (line for line in lines_of(tmp_path / "out") if line["status"] == "failed")
    assert (line["source"], line["output"]) == (str(capture.files[1]), None)
    assert line["reason"] == f"{capture.files[1]}: {told}"
    assert not (tmp_path / "out" / "frame_1.tif").exists()


def test_a_watcher_that_always_resumes_begins_in_a_new_folder_too(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2)
    for skipped in (0, 2):
        began = time.monotonic()
        totals = _resolved(capture.files[:1], tmp_path / "out", capture.files[1:], resume=True)
        assert (totals.ok, totals.already_there) == (2 - skipped, skipped)
        assert 0.0 < totals.seconds < time.monotonic() - began + 0.001


def test_maps_of_a_frame_whose_file_holds_no_frame_any_more_are_removed(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    _resolved([capture.folder], out)
    capture.files[1].write_bytes((out / "frame_0.tif").read_bytes())
    totals = _resolved([capture.folder], out, resume=True)
    assert (totals.already_there, totals.skipped, totals.failed) == (1, 2, 0)
    assert [(line["status"], line["output"]) for line in lines_of(out)] == [("ok", "frame_0.tif"), ("skipped", None)]
    assert not (out / "frame_1.tif").exists()
