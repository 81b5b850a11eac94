"""A run in progress closes what it began, whatever stops it."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cadtof_cli.workflows.resolve.ongoing_run import OngoingRun
from cadtof_cli.workflows.resolve.output import MapNames
from cadtof_cli.workflows.resolve.reports import FrameReport
from cadtof_cli.workflows.resolve.settings import ResolveSettings


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
