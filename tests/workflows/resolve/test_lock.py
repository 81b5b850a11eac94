"""Only one run at a time writes into a folder, and the lock ends with its process."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cadtof_cli.errors import OutputError
from cadtof_cli.workflows.resolve.output import LOCK_FILE, locked
from tests.support.captures import record
from tests.support.run_cadtof import ENVIRONMENT, cadtof

_HOLD = """
import os, sys, time
from pathlib import Path
from cadtof_cli.workflows.resolve.output import locked
with locked(Path(sys.argv[1])):
    if os.fork() == 0:
        time.sleep(60)
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_run_says_who_holds_the_folder(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(out)], env=ENVIRONMENT, stdout=subprocess.PIPE, start_new_session=True
    )
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        (out / ".frame_0.tif.0.other.partial").touch()
        for options in (("--overwrite",), ("--resume",), ()):
            done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, *options)
            assert done.status == 2
            assert done.err.startswith(
                f"Error: {out}: process {holder.pid} on {os.uname().nodename} has been writing into it since "
            )
        # the file that the other run is writing is still there
        after = {path.name: path.read_bytes() for path in out.iterdir()}
        assert after == before | {".frame_0.tif.0.other.partial": b"", LOCK_FILE: after[LOCK_FILE]}
        # the folder is free even while a worker of the killed run still lives
        holder.kill()
        holder.wait()
        done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--overwrite")
        assert done.status == 0
        assert {path.name for path in out.iterdir()} == before.keys()
    finally:
        os.killpg(holder.pid, signal.SIGKILL)
        holder.communicate()


def test_the_same_process_is_kept_out_too(tmp_path: Path) -> None:
    with locked(tmp_path):
        assert json.loads((tmp_path / LOCK_FILE).read_text())["pid"] == os.getpid()
        with (
            pytest.raises(OutputError, match=f"this process \\({os.getpid()}\\) is writing into it already"),
            locked(tmp_path),
        ):
            pass
    with locked(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_a_link_in_place_of_the_lock_is_refused(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).symlink_to(tmp_path / "mine")
    with pytest.raises(OutputError, match="cannot be written: Too many levels of symbolic links"), locked(tmp_path):
        pass
    assert not (tmp_path / "mine").exists()


def test_a_lock_whose_owner_has_not_named_itself_yet_holds(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(tmp_path)], env=ENVIRONMENT, stdout=subprocess.PIPE, start_new_session=True
    )
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        for text in ("", "7", "{}", "no JSON"):
            (tmp_path / LOCK_FILE).write_text(text)
            with (
                pytest.raises(OutputError, match=": another process is writing into it; wait until it ends"),
                locked(tmp_path),
            ):
                pass
        assert (tmp_path / LOCK_FILE).exists()
    finally:
        os.killpg(holder.pid, signal.SIGKILL)
        holder.communicate()
