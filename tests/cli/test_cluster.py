"""Runs on a real scheduler with real workers: the same files as without a cluster; a lost process costs no frame."""

import contextlib
import http.server
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.cluster import connection
from tests.support.captures import TOML, write_frame
from tests.support.cluster import NO_SETTINGS, LocalCluster, local_cluster, require_dask
from tests.support.forward import step_frame
from tests.support.run_cadtof import ENVIRONMENT, ROOT, Finished
from tests.support.runs import lines_of, maps_of, run_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="workers that end with the tests need prctl")

FRAMES = 60

_DEADLY = """
import os, sys
from pathlib import Path
from cadtof_cli.workflows.recording import FrameReader
read = FrameReader.read
def read_frame(reader, sources):
    if sources[0].name == "frame_0007":
        with Path(os.environ["DEATHS"]).open("a") as deaths:
            deaths.write("x")
        os._exit(1)
    return read(reader, sources)
FrameReader.read = read_frame
"""
"""Workers import this module when they start: one frame ends its worker, like a frame too large for the memory."""

_UNHURRIED = """
import os, time
from cadtof_cli.workflows.recording import FrameReader
read = FrameReader.read
def read_frame(reader, sources):
    until = time.monotonic() + 0.5
    while sources[0].name > "frame_0009" and not os.path.exists(os.environ["HURRY"]) and time.monotonic() < until:
        time.sleep(0.01)
    return read(reader, sources)
FrameReader.read = read_frame
"""
"""Workers import this module when they start: from the eleventh on, a frame takes .5 s until the file HURRY exists.
So a run still goes on when a test disturbs it."""


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of small frames that differ."""
    folder = tmp_path_factory.mktemp("capture") / "room"
    folder.mkdir()
    (folder / "capture.toml").write_text(TOML["tif"])
    rng = np.random.default_rng(0)
    for index in range(FRAMES):
        write_frame(folder / f"frame_{index:04}.tif", step_frame(rng, height=40, width=60))
    return folder


@pytest.fixture(scope="module")
def local_run(capture: Path) -> dict[str, Any]:
    """What a run without a cluster leaves in its folder."""
    assert run("resolve", "room", "-o", "here", "-j", 1, cwd=capture.parent).status == 0
    return contents(capture.parent / "here")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalCluster]:
    """A scheduler with two workers, for all tests that do not disturb it."""
    require_dask()
    with local_cluster(tmp_path_factory.mktemp("cluster"), workers=2) as started:
        yield started


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "cadtof_cli", *map(str, arguments)]


def run(*arguments: object, cwd: Path) -> Finished:
    done = subprocess.run(
        command(*arguments),
        cwd=cwd,
        env=ENVIRONMENT | NO_SETTINGS,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return Finished(done.returncode, done.stdout, done.stderr)


@contextlib.contextmanager
def running(*arguments: object, cwd: Path) -> Iterator["subprocess.Popen[str]"]:
    """Start a run, and yield it when it has reported three frames; kill it in the end."""
    process = subprocess.Popen(
        command(*arguments, "--json"),
        cwd=cwd,
        env=ENVIRONMENT | NO_SETTINGS,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        for _ in range(3):
            assert process.stdout.readline()
        yield process
    finally:
        process.kill()
        process.communicate()


def stderr_until(process: "subprocess.Popen[str]", words: str) -> str:
    """Return what a run writes to stderr up to these words, or everything if they do not come within a minute."""
    assert process.stderr is not None
    text = ""
    patience = threading.Timer(60.0, process.kill)
    patience.start()
    try:
        while words not in text:
            line = process.stderr.readline()
            if not line:
                break
            text += line
    finally:
        patience.cancel()
    return text


def contents(out: Path) -> dict[str, Any]:
    """Return what a run has left: bytes of maps, lines without times and folders, totals, names of all other files."""
    record, maps = run_of(out), maps_of(out)
    others = {path.name for path in out.iterdir()} - maps.keys()
    totals, finished = record.get("totals"), record["finished"]
    return {"maps": maps, "lines": lines_of(out), "totals": totals, "finished": finished, "others": others}


@contextlib.contextmanager
def cluster_with(module: str, folder: Path, *, workers: int, variable: str) -> Iterator[tuple[LocalCluster, Path]]:
    """Yield a cluster whose workers import `module` when they start, and the file that they find in `variable`."""
    (folder / "with").mkdir()
    (folder / "with" / "preloaded.py").write_text(module)
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv(variable, str(folder / "signal"))
        environment.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{folder / 'with'}")
        with local_cluster(folder / "cluster", workers=workers, preload="preloaded") as cluster:
            yield cluster, folder / "signal"


def test_the_same_files_as_without_a_cluster(
    cluster: LocalCluster, capture: Path, local_run: dict[str, Any], tmp_path: Path
) -> None:
    out = os.path.relpath(tmp_path / "out", capture.parent)
    done = run("resolve", "room", "-o", out, "--scheduler", cluster.address, cwd=capture.parent)
    assert done.status == 0, done.err
    assert f"resolved {FRAMES} of {FRAMES} frames" in done.err
    assert contents(tmp_path / "out") == local_run
    # each worker chooses its own
    assert run_of(tmp_path / "out")["kernel"] is None


def test_a_frame_that_cannot_be_read_fails_alone_with_the_same_message(
    cluster: LocalCluster, capture: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "room"
    folder.mkdir()
    for name in ("capture.toml", "frame_0000.tif", "frame_0001.tif", "frame_0002.tif"):
        (folder / name).write_bytes((capture / name).read_bytes())
    (folder / "frame_0001.tif").write_bytes(b"II*\0 not a frame")
    ended = [
        run("resolve", "room", "-o", f"out_{number}", *where, "--quiet", cwd=tmp_path)
        for number, where in enumerate((("--jobs", 1), ("--scheduler", cluster.address)))
    ]
    assert [one.status for one in ended] == [1, 1]
    assert ended[1].err == ended[0].err
    assert contents(tmp_path / "out_1") == contents(tmp_path / "out_0")


def test_ctrl_c_cancels_and_resume_finishes(capture: Path, local_run: dict[str, Any], tmp_path: Path) -> None:
    require_dask()
    with cluster_with(_UNHURRIED, tmp_path, workers=2, variable="HURRY") as (cluster, hurry):
        arguments = ("resolve", "room", "-o", tmp_path / "out", "--scheduler", cluster.address)
        with running(*arguments, cwd=capture.parent) as process:
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=60)
        assert process.returncode == 130
        assert re.fullmatch(r"interrupted: \d+ of \d+ frames are resolved; .* --resume goes on", err.splitlines()[-1])
        left = contents(tmp_path / "out")
        assert left["finished"] is False
        assert left["others"] == {"run.json", "frames.jsonl"}
        # no worker goes on writing
        hurry.touch()
        time.sleep(1.0)
        assert contents(tmp_path / "out")["maps"] == left["maps"]
        assert run(*arguments, "--resume", cwd=capture.parent).status == 0
    assert contents(tmp_path / "out")["maps"] == local_run["maps"]


def test_a_worker_is_killed_and_one_is_added(capture: Path, local_run: dict[str, Any], tmp_path: Path) -> None:
    require_dask()
    with cluster_with(_UNHURRIED, tmp_path, workers=1, variable="HURRY") as (cluster, hurry):
        arguments = ("resolve", "room", "-o", tmp_path / "out", "--scheduler", cluster.address)
        with running(*arguments, cwd=capture.parent) as process:
            cluster.workers[0].kill()
            waiting = f"waiting for workers at {cluster.address}"
            assert waiting in stderr_until(process, waiting)
            assert process.poll() is None, "there was nobody to finish the run"
            hurry.touch()
            cluster.add_workers()
            _, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
        assert contents(tmp_path / "out") == local_run


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_scheduler_is_lost_and_resume_finishes(
    number: signal.Signals, capture: Path, local_run: dict[str, Any], tmp_path: Path
) -> None:
    require_dask()
    with cluster_with(_UNHURRIED, tmp_path, workers=1, variable="HURRY") as (cluster, _):
        address = cluster.address
        with running("resolve", "room", "-o", tmp_path / "out", "--scheduler", address, cwd=capture.parent) as process:
            cluster.scheduler.send_signal(number)
            _, err = process.communicate(timeout=60)
        assert process.returncode == 1
        assert "Traceback" not in err
        assert err.splitlines()[-1] == (
            f"Error: the scheduler at {address} does not answer any more; finished maps are kept: start it and "
            "its workers again, then give the same command with --resume, without --overwrite"
        )
    left = contents(tmp_path / "out")
    assert left["finished"] is False
    assert len(left["lines"]) < FRAMES
    assert left["maps"].items() <= local_run["maps"].items()
    assert run("resolve", "room", "-o", tmp_path / "out", "-j", 1, "--resume", cwd=capture.parent).status == 0
    assert contents(tmp_path / "out")["maps"] == local_run["maps"]


def test_a_frame_that_kills_workers_twice_fails_alone(capture: Path, local_run: dict[str, Any], tmp_path: Path) -> None:
    require_dask()
    with cluster_with(_DEADLY, tmp_path, workers=3, variable="DEATHS") as (cluster, deaths):
        done = run("resolve", "room", "-o", tmp_path / "out", "--scheduler", cluster.address, cwd=capture.parent)
    assert deaths.read_text() == "xx"
    assert done.status == 1
    found = contents(tmp_path / "out")
    failed = [line for line in found["lines"] if line["status"] != "ok"]
    assert [(Path(line["source"]).name, "died twice" in line["reason"]) for line in failed] == [
        ("frame_0007.tif", True)
    ]
    assert found["maps"] == {name: data for name, data in local_run["maps"].items() if name != "frame_0007.tif"}


def test_another_version_on_a_worker_is_named(capture: Path, tmp_path: Path) -> None:
    require_dask()
    package = tmp_path / "other" / "cadtof_cli"
    shutil.copytree(ROOT / "cadtof_cli", package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "version.py").write_text('__version__ = "0.0.1"\n')
    with local_cluster(tmp_path / "cluster", workers=1) as cluster:
        cluster.add_workers(python_path=package.parent)
        arguments = ("resolve", "room", "-o", tmp_path / "out", "--scheduler", cluster.address)
        done = run(*arguments, cwd=capture.parent)
        assert cluster.workers[1].poll() is None
    assert done.status == 1
    assert re.search(r"Error: worker tcp://127.0.0.1:\d+ has cadtof 0.0.1, expected \S+ as here\n", done.err)
    assert list((tmp_path / "out").iterdir()) == []


@pytest.fixture
def without_cadtof(tmp_path: Path) -> Path:
    """A folder for PYTHONPATH in which importing cadtof fails, as if it were not installed."""
    package = tmp_path / "without" / "cadtof_cli"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise ImportError('not installed here')\n")
    return package.parent


def test_workers_without_cadtof_are_named_and_live(capture: Path, without_cadtof: Path, tmp_path: Path) -> None:
    """A worker that receives a function of a package that it lacks would end, and would be started again and again."""
    require_dask()
    with local_cluster(tmp_path / "cluster", workers=0) as cluster:
        cluster.add_workers(python_path=without_cadtof)
        done = run("resolve", "room", "-o", tmp_path / "out", "--scheduler", cluster.address, cwd=capture.parent)
        assert cluster.workers[0].poll() is None
    assert done.status == 1
    assert re.search(r"Error: worker tcp://\S+ cannot run cadtof: ImportError: not installed here\n", done.err)


def test_the_scheduler_needs_no_cadtof(
    capture: Path, local_run: dict[str, Any], without_cadtof: Path, tmp_path: Path
) -> None:
    require_dask()
    with local_cluster(tmp_path / "cluster", workers=1, python_path=without_cadtof) as cluster:
        done = run("resolve", "room", "-o", tmp_path / "out", "--scheduler", cluster.address, cwd=capture.parent)
    assert done.status == 0, done.err
    assert contents(tmp_path / "out") == local_run


@pytest.mark.parametrize("given", ["tcp://", "localhost:8786", "tcp://x:y", "http://127.0.0.1:8786"])
def test_a_malformed_address_is_refused(given: str, capture: Path, tmp_path: Path) -> None:
    done = run("resolve", "room", "-o", tmp_path / "out", "--scheduler", given, cwd=capture.parent)
    assert done.status == 2
    assert done.err == f"Error: --scheduler: found {given!r}, expected local or tcp://HOST:PORT\n"


def test_a_result_that_does_not_arrive_is_requested_again(
    cluster: LocalCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """This happens if a worker is frozen for longer than it is waited for, or if a laptop sleeps."""
    from distributed import Future

    result, asked = Future.result, set[str]()

    def late(future: Any, timeout: float) -> Any:
        if future.key not in asked:
            asked.add(future.key)
            raise TimeoutError
        return result(future, timeout)

    monkeypatch.setattr(Future, "result", late)
    monkeypatch.setattr(Future, "_cb_executor", None)
    line = connection.Connection(cluster.address)
    try:
        until = time.monotonic() + 30
        found: list[connection.News] = []
        while not any(isinstance(one, connection.WorkerJoined) for one in found):
            found = line.news()
        (worker, *_) = [one.worker for one in found if isinstance(one, connection.WorkerJoined)]
        line.submit(0, worker, os.getpid)
        while not (ended := [one for one in found if isinstance(one, connection.Finished)]):
            assert time.monotonic() < until
            found = line.news()
    finally:
        line.close()
        # later tests fork this process, which must have no threads then
        Future._cb_executor.shutdown()
    assert ended[0].answer in {process.pid for process in cluster.workers}


def test_a_port_where_another_program_listens_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be the dashboard, whose port is the next one. Dask's client would wait for its answer without end."""
    require_dask()
    monkeypatch.setattr(connection, "CONNECT_S", 0.5)
    with http.server.HTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            with pytest.raises(SettingsError, match=r"no dask scheduler answers there \(timed out\)"):
                connection.Connection(f"tcp://127.0.0.1:{server.server_port}")
        finally:
            server.shutdown()


def test_nothing_is_written_if_no_scheduler_answers(capture: Path, tmp_path: Path) -> None:
    require_dask()
    nobody = "tcp://127.0.0.1:9"
    done = run("resolve", "room", "-o", tmp_path / "out", "--scheduler", nobody, cwd=capture.parent)
    assert done.status == 2
    assert f"Error: --scheduler {nobody}: no dask scheduler answers there" in done.err
    assert list((tmp_path / "out").iterdir()) == []
