"""Runs on network shares that fail for a while: what NFS and SMB did in a virtual machine is imitated here."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import pytest

from cadtof_cli.errors import OutputError
from cadtof_cli.workflows.resolve import frame_task, output
from cadtof_cli.workflows.resolve.output import LOCK_FILE, locked
from tests.support.captures import record
from tests.support.run_cadtof import Finished, cadtof
from tests.support.runs import maps_of, require_same_run

_LOCK_THE_TEXT = """
import fcntl, sys
with open(sys.argv[1], "r+b") as file:
    fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 4096, 0)
"""


def _resolve(*arguments: object) -> Finished:
    return cadtof("resolve", *arguments, "-j", 1)


def _away(*_arguments: object) -> NoReturn:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def test_the_name_in_a_lock_file_is_not_locked(tmp_path: Path) -> None:
    """On SMB, locked bytes cannot be read, and a second run is to say who holds the folder."""
    pytest.importorskip("fcntl")
    with locked(tmp_path):
        done = subprocess.run([sys.executable, "-c", _LOCK_THE_TEXT, str(tmp_path / LOCK_FILE)], check=False)
    assert done.returncode == 0


def test_a_lock_file_whose_content_was_lost_is_locked_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NFS 3 may hold the lock of a killed run for ever, and closing its file then tells that the owner's name was lost."""
    close = os.close

    def closing(descriptor: int) -> NoReturn:
        close(descriptor)
        _away()

    monkeypatch.setattr(output, "try_lock", lambda _: False)
    monkeypatch.setattr(os, "close", closing)
    with pytest.raises(OutputError, match="another process is writing into it"), locked(tmp_path):
        pass


def test_an_earlier_failure_of_a_share_is_not_that_of_the_resumed_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linux tells that a write failed when the file is synced next, also if another process wrote it before."""
    capture, out = record(tmp_path / "A", frames=3), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    untold, fsync = {(out / "frames.jsonl").stat().st_ino}, os.fsync

    def syncing(descriptor: int) -> None:
        if (file := os.fstat(descriptor).st_ino) in untold:
            untold.remove(file)
            _away()
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", syncing)
    done = _resolve(capture.folder, "-o", out, "--resume")
    assert (done.status, untold) == (0, set())


@pytest.mark.parametrize("moved", [False, True])
def test_lines_that_a_share_lost_are_made_again(moved: bool, tmp_path: Path) -> None:
    """NFS leaves zero bytes in a file where what had been written before the end was lost."""
    capture, out, fresh = record(tmp_path / "A", frames=5), tmp_path / "out", tmp_path / "fresh"
    assert _resolve(capture.folder, "-o", out).status == 0
    assert _resolve(capture.folder, "-o", fresh).status == 0
    lines = (out / "frames.jsonl").read_bytes().splitlines(keepends=True)
    lost = len(lines[0]) + 40
    (out / "frames.jsonl").write_bytes(bytes(lost) + b"".join(lines)[lost:])
    if moved:
        out = out.rename(tmp_path / "moved")
    done = _resolve(capture.folder, "-o", out, "--resume")
    assert (done.status, done.err.count("has no line in frames.jsonl")) == (0, 2)
    require_same_run(out, fresh)


@pytest.mark.parametrize("fails", ["file_digest", "read_through", "is_file"])
def test_maps_stay_while_neither_they_nor_their_frame_can_be_read(
    fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture, out, frame = record(tmp_path / "A", frames=3), tmp_path / "out", tmp_path / "A" / "frame_1.tif"
    assert _resolve(capture.folder, "-o", out).status == 0
    before, elsewhere = maps_of(out), tmp_path / "elsewhere"
    frame.rename(elsewhere)
    frame.symlink_to(frame.name)
    with monkeypatch.context() as patched:
        if fails == "is_file":
            is_file = Path.is_file
            patched.setattr(Path, "is_file", lambda path: _away() if path == out / "frame_1.tif" else is_file(path))
        else:
            for name in {fails, "read_through"}:
                patched.setattr(frame_task, name, _away)
        done = _resolve(capture.folder, "-o", out, "--resume")
    assert done.status == 1
    assert f"failed: {frame}: cannot be read: Too many levels of symbolic links" in done.err
    assert maps_of(out) == before
    elsewhere.replace(frame)
    assert _resolve(capture.folder, "-o", out, "--resume").status == 0
    assert maps_of(out) == before


def test_a_name_that_a_share_refuses_fails_alone_also_when_the_run_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    r"""Linux gives EINVAL for whatever is asked about a name with `\` on SMB."""
    capture, out, refused = record(tmp_path / "A", frames=3), tmp_path / "out", tmp_path / "out" / "frame_1.tif"
    assert _resolve(capture.folder, "-o", out).status == 0
    refused.unlink()
    (out / "frames.jsonl").unlink()
    opened, stat = os.open, os.stat

    def asked(ask: Callable[..., Any], path: Any, *arguments: Any, **options: Any) -> Any:
        if str(path).startswith((str(refused), str(out / ".frame_1"))):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), str(path))
        return ask(path, *arguments, **options)

    monkeypatch.setattr(os, "open", partial(asked, opened))
    monkeypatch.setattr(os, "stat", partial(asked, stat))
    done = _resolve(capture.folder, "-o", out, "--resume")
    assert done.status == 1
    assert f"failed: {refused}: cannot be written: Invalid argument" in done.err
    assert "resolved 2 of 3 frames" in done.err
