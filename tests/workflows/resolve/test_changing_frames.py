"""Frames that another program writes while they are read: no map is made of half an old and half a new frame."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import read_stored
from tests.support.captures import record, write_frame
from tests.support.forward import step_frame
from tests.support.run_cadtof import Finished, cadtof
from tests.support.runs import maps_of


def _resolve(capture: Path, out: Path, *options: object) -> Finished:
    return cadtof("resolve", capture, "-o", out, "-j", 1, *options)


def _after_each_read(monkeypatch: pytest.MonkeyPatch, change: Callable[[int], None]) -> None:
    """Call `change` with the number of reads after each read of a frame, before the files are checked for changes."""
    times = [0]

    def reading(*arguments: Any, **more: Any) -> Stored:
        stored = read_stored(*arguments, **more)
        times[0] += 1
        change(times[0])
        return stored

    monkeypatch.setattr("cadtof_cli.workflows.recording.read_stored", reading)


def _write_another(file: Path, seed: int) -> None:
    """Write another frame over a file, and set another time, because the clock of the file system may be coarse."""
    write_frame(file, step_frame(np.random.default_rng(seed)))
    os.utime(file, ns=(seed * 10**9, seed * 10**9))


def test_a_frame_that_changed_while_it_was_read_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = record(tmp_path / "capture")
    (file,) = capture.files
    with monkeypatch.context() as patched:
        _after_each_read(patched, lambda times: _write_another(file, 7) if times == 1 else None)
        assert _resolve(capture.folder, tmp_path / "out").status == 0
    assert _resolve(capture.folder, tmp_path / "afterwards").status == 0
    assert maps_of(tmp_path / "out") == maps_of(tmp_path / "afterwards")
    (line,) = (tmp_path / "out" / "frames.jsonl").read_text().splitlines()
    assert json.loads(line)["files"][0]["mtime_ns"] == 7 * 10**9


@pytest.mark.parametrize("options", [(), ("--average", 2)])
def test_a_frame_that_keeps_changing_fails(
    options: tuple[object, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = record(tmp_path / "capture", frames=2)
    _after_each_read(monkeypatch, lambda times: _write_another(capture.files[0], times))
    done = _resolve(capture.folder, tmp_path / "out", *options)
    assert done.status == 1
    assert (
        f"failed: {capture.files[0]}: changed while it was read, 3 times; expected a file that is complete" in done.err
    )


def test_a_file_that_grows_behind_its_frame_is_resolved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = record(tmp_path / "capture")
    assert _resolve(capture.folder, tmp_path / "before").status == 0

    def grow(times: int) -> None:
        with capture.files[0].open("ab") as file:
            file.write(bytes(times))

    _after_each_read(monkeypatch, grow)
    assert _resolve(capture.folder, tmp_path / "out").status == 0
    assert maps_of(tmp_path / "out") == maps_of(tmp_path / "before")
