"""Changes to the folder of a run while the run goes on."""

import fcntl
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.files.atomic import PartialFile
from tests.support.captures import record, write_frame
from tests.support.forward import step_frame
from tests.support.run_cadtof import ENVIRONMENT, PROGRAM, cadtof
from tests.support.runs import require_same_run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the size of a pipe is set")

FRAMES, PIPE_BYTES = 60, 4096
"""A pipe of this size holds few lines, so the run waits after some frames until somebody reads them."""


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Small frames that differ."""
    folder = tmp_path_factory.mktemp("meanwhile") / "cap"
    record(folder, frames=0)
    for index in range(FRAMES):
        write_frame(folder / f"frame_{index:02}.tif", step_frame(np.random.default_rng(index), height=8, width=10))
    return folder


@pytest.fixture(scope="module")
def undisturbed(capture: Path) -> Path:
    """The folder of a run that nothing disturbed."""
    out = capture.parent / "undisturbed"
    assert cadtof("resolve", capture, "-o", out, "-j", 1).status == 0
    return out


@contextmanager
def _waiting_run(capture: Path, out: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """Start a run, and yield it when it has reported a frame. It waits before it reports its last frame."""
    command = [*PROGRAM, "resolve", str(capture), "-o", str(out), "-j", "2", "--json", "--quiet"]
    process = subprocess.Popen(command, env=ENVIRONMENT, bufsize=0, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert process.stdout is not None
        fcntl.fcntl(process.stdout, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        process.stdout.readline()
        yield process
    finally:
        process.kill()
        process.communicate()


def test_lines_that_are_removed_are_written_anew(capture: Path, undisturbed: Path, tmp_path: Path) -> None:
    out = capture.parent / tmp_path.name
    with _waiting_run(capture, out) as run:
        (out / "frames.jsonl").unlink()
        _, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    require_same_run(out, undisturbed)


def test_lines_that_are_replaced_are_written_anew(capture: Path, undisturbed: Path, tmp_path: Path) -> None:
    out = capture.parent / tmp_path.name
    (tmp_path / "other").write_text("{}\n")
    with _waiting_run(capture, out) as run:
        (tmp_path / "other").replace(out / "frames.jsonl")
        _, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    require_same_run(out, undisturbed)


@pytest.mark.parametrize("kind", ["a file", "nothing", "another folder"])
def test_a_folder_that_is_replaced_ends_the_run_which_can_go_on(
    kind: str, capture: Path, undisturbed: Path, tmp_path: Path
) -> None:
    # OUT lies beside the undisturbed folder, because run.json holds the paths of the frames relative to OUT
    out, kept = capture.parent / tmp_path.name, tmp_path / "kept"
    with _waiting_run(capture, out) as run:
        out.rename(kept)
        if kind == "a file":
            out.write_text("mine")
        elif kind == "another folder":
            out.mkdir()
        _, err = run.communicate(timeout=60)
    text = err.decode()
    assert run.returncode in ({0, 1, 2} if kind == "another folder" else {1, 2})
    assert "unexpected" not in text
    assert "Traceback" not in text
    if kind != "another folder":
        assert f"{out}" in text
    if kind == "a file":
        assert out.read_text() == "mine"
        out.unlink()
    shutil.rmtree(out, ignore_errors=True)
    kept.rename(out)
    assert cadtof("resolve", capture, "-o", out, "-j", 1, "--resume").status == 0
    require_same_run(out, undisturbed)
    assert json.loads((out / "run.json").read_text())["finished"]


@pytest.mark.parametrize("name", ["run.json", "frames.jsonl"])
def test_ctrl_c_while_a_record_is_begun_leaves_no_partial_file(
    name: str, capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C comes between the creation of a temporary file and the moment in which its writer takes care of it."""
    out, commit = tmp_path / "out", PartialFile.commit

    def interrupted(partial: PartialFile, let_go: Callable[[], None] = lambda: None, /) -> int:
        if partial.path.name == name:
            monkeypatch.undo()
            raise KeyboardInterrupt
        return commit(partial, let_go)

    resume: tuple[str, ...] = ()
    if name == "frames.jsonl":
        assert cadtof("resolve", capture, "-o", out, "-j", 1).status == 0
        resume = ("--resume",)
    monkeypatch.setattr(PartialFile, "commit", interrupted)
    assert cadtof("resolve", capture, "-o", out, "-j", 1, *resume).status == 130
    assert not list(out.glob(".*"))
