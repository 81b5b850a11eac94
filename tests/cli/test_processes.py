"""Real runs that are stopped, killed, or lose a worker: no partial file and no process is left, and no frame is lost."""

import fcntl
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.execution.cores import available_cores
from tests.support.captures import TOML, write_frame
from tests.support.forward import step_frame
from tests.support.processes import nobody_left
from tests.support.run_cadtof import ENVIRONMENT, program

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are found by /proc")

FRAMES = 120
PIPE_BYTES = 4096
"""Such a pipe holds few of the lines of so many frames. So a run cannot end while nobody empties the pipe."""

_PROGRAM = (sys.executable, "-m", "cadtof_cli")
"""Warnings are no errors here: if Ctrl-C interrupts a library while it opens a file, the file is not closed at once."""


_THREADS = """
import os, sys, time
from pathlib import Path
from cadtof_cli.cli import main
try:
    main()
except SystemExit as ended:
    assert not ended.code
import numpy

def threads():
    time.sleep(0.1)
    return len(list(Path("/proc/self/task").iterdir()))

# the system may list a thread for a moment after it was joined
print(min(threads() for _ in range(10)))
"""


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which one small frame has many names."""
    folder = tmp_path_factory.mktemp("capture")
    (folder / "capture.toml").write_text(TOML["tif"])
    first = folder / "frame_0000.tif"
    write_frame(first, step_frame(np.random.default_rng(0), height=8, width=10))
    for index in range(1, FRAMES):
        os.link(first, folder / f"frame_{index:04}.tif")
    return folder


@pytest.fixture(scope="module")
def map_bytes(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of the map of that frame, without its name."""
    out = tmp_path_factory.mktemp("expected") / "out"
    assert program("resolve", capture / "frame_0000.tif", "-o", out, "-j", 1).status == 0
    return _bytes_without_name(out / "frame_0000.tif")


class Run:
    """A run that goes on: it has reported a frame, and cannot report its last frame until somebody reads its lines."""

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        assert process.stdout is not None
        self.process = process
        fcntl.fcntl(process.stdout, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        # Python does not buffer this pipe, so the lines after the first stay in it
        self._first = process.stdout.readline()

    @property
    def workers(self) -> list[int]:
        pid = self.process.pid
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]

    def wait(self) -> tuple[int, str, list[dict[str, Any]]]:
        """Wait for the end; return the exit status, the text on stderr, and the lines of the frames."""
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, err.decode(), [json.loads(line) for line in (self._first + out).splitlines()]


@contextmanager
def _running(*arguments: object, command: tuple[str, ...] = _PROGRAM) -> Iterator[Run]:
    process = subprocess.Popen(
        [*command, *map(str, arguments), "--json", "--quiet"],
        env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0, start_new_session=True,
    )  # fmt: skip
    try:
        yield Run(process)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def _bytes_without_name(path: Path) -> bytes:
    """Return the bytes of a map without the name of its frame, which its header holds. All names have one length."""
    return path.read_bytes().replace(path.stem.encode(), b"")


def _whole_maps(out: Path, map_bytes: bytes) -> int:
    """Make sure that OUT holds only whole maps and records, and a map for every ok line; return the number of maps."""
    maps = [path for path in out.iterdir() if path.name not in {"run.json", "frames.jsonl"}]
    assert all(path.suffix == ".tif" and _bytes_without_name(path) == map_bytes for path in maps)
    lines = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
    assert all(Path(line["output"]) in maps for line in lines if line["status"] == "ok")
    json.loads((out / "run.json").read_text())
    return len(maps)


def _to_all(run: Run, number: signal.Signals) -> None:
    os.killpg(run.process.pid, number)


def _to_parent(run: Run, number: signal.Signals) -> None:
    run.process.send_signal(number)


def _wait_for_end(run: Run) -> tuple[int, str]:
    """Wait for the end; return exit status and stderr. The last lines are dropped, because a kill may cut them off."""
    _, err = run.process.communicate(timeout=60)
    return run.process.returncode, err.decode().strip()


INTERRUPTED = rf"interrupted: (\d+) of {FRAMES} frames are resolved; the same command with --resume goes on"


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("send", [_to_all, _to_parent])
@pytest.mark.parametrize(
    ("number", "status", "message"),
    [(signal.SIGINT, 130, INTERRUPTED), (signal.SIGTERM, 143, ""), (signal.SIGHUP, 129, "")],
)
def test_a_run_that_is_stopped(
    number: signal.Signals, status: int, message: str, send: Callable[[Run, signal.Signals], None], jobs: int,
    capture: Path, map_bytes: bytes, tmp_path: Path,
) -> None:  # fmt: skip
    out = tmp_path / "out"
    with _running("resolve", capture, "-o", out, "-j", jobs) as run:
        workers = run.workers
        assert len(workers) == (jobs if jobs > 1 else 0)
        send(run, number)
        found, err = _wait_for_end(run)
    matched = re.fullmatch(message, err)
    assert (found, matched is not None) == (status, True), err
    assert nobody_left(workers, 0)
    maps = _whole_maps(out, map_bytes)
    assert 1 <= maps < FRAMES
    assert matched is None or all(int(count) <= maps for count in matched.groups())
    assert json.loads((out / "run.json").read_text())["finished"] is False


def test_a_run_that_is_killed_leaves_no_worker_and_can_be_resumed(
    capture: Path, map_bytes: bytes, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    for start in ("fork", "spawn"):
        resume = ("--resume",) if out.exists() else ()
        with _running("resolve", capture, "-o", out, "-j", 2, "--start-method", start, *resume) as run:
            workers = run.workers
            assert len(workers) >= 2
            run.process.kill()
            # stderr may hold text: with spawned processes, Python's own resource tracker writes about the kill
            assert _wait_for_end(run)[0] == -signal.SIGKILL
            assert nobody_left(workers, 10)
    (out / ".frame_0119.tif.1234abcd.partial").write_bytes(map_bytes[:100])
    done = program("resolve", capture, "-o", out, "-j", 2, "--resume")
    assert done.status == 0
    assert _whole_maps(out, map_bytes) == FRAMES
    run_record = json.loads((out / "run.json").read_text())
    assert (run_record["finished"], run_record["totals"]["failed"]) == (True, 0)
    assert run_record["totals"]["ok"] + run_record["totals"]["skipped"] == FRAMES
    named = {json.loads(line)["source"] for line in (out / "frames.jsonl").read_text().splitlines()}
    assert len(named) == FRAMES


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_run_that_loses_a_worker_loses_no_frame(
    number: signal.Signals, capture: Path, map_bytes: bytes, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with _running("resolve", capture, "-o", out, "-j", 2) as run:
        os.kill(run.workers[0], number)
        status, err, reports = run.wait()
    assert (status, err) == (0, "")
    assert [report["source"] for report in reports] == [str(capture / f"frame_{i:04}.tif") for i in range(FRAMES)]
    assert {report["status"] for report in reports} == {"ok"}
    assert _whole_maps(out, map_bytes) == FRAMES


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_stopped_worker_keeps_nobody_waiting(number: signal.Signals, capture: Path, tmp_path: Path) -> None:
    with _running("resolve", capture, "-o", tmp_path / "out", "-j", 2) as run:
        workers = run.workers
        for worker in workers:
            os.kill(worker, signal.SIGSTOP)
        run.process.send_signal(number)
        assert _wait_for_end(run)[0] == 128 + number
        assert nobody_left(workers, 0)


def test_a_stopped_worker_ends_with_its_parent(capture: Path, tmp_path: Path) -> None:
    with _running("resolve", capture, "-o", tmp_path / "out", "-j", 2) as run:
        workers = run.workers
        for worker in workers:
            os.kill(worker, signal.SIGSTOP)
        run.process.kill()
        assert nobody_left(workers, 10)


def test_a_worker_that_hangs_costs_no_frame(capture: Path, map_bytes: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with _running("resolve", capture, "-o", out, "-j", 2, "--frame-timeout", 2) as run:
        os.kill(run.workers[0], signal.SIGSTOP)
        status, err, reports = run.wait()
    assert (status, err) == (0, "")
    assert {report["status"] for report in reports} == {"ok"}
    assert _whole_maps(out, map_bytes) == FRAMES


def test_ctrl_c_while_modules_are_imported(tmp_path: Path) -> None:
    """Python itself would print a traceback of twenty lines."""
    (tmp_path / "click.py").write_text("import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(9)\n")
    command = [sys.executable, "-m", "cadtof_cli", "--version"]
    environment = {**ENVIRONMENT, "PYTHONPATH": f"{tmp_path}:{ENVIRONMENT['PYTHONPATH']}"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


def test_nohup_is_respected(capture: Path, map_bytes: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with _running("-c", _IGNORES_HANGUP, *_PROGRAM, "resolve", capture, "-o", out, "-j", 2, command=_PYTHON) as run:
        run.process.send_signal(signal.SIGHUP)
        assert run.wait()[0] == 0
    assert _whole_maps(out, map_bytes) == FRAMES


_PYTHON = (sys.executable,)

_IGNORES_HANGUP = """
import os, signal, sys
signal.signal(signal.SIGHUP, signal.SIG_IGN)
os.execv(sys.argv[1], sys.argv[1:])
"""

_HANGING = """
import time
from cadtof_cli.cli import main
from cadtof_cli.workflows.resolve import frame_task
write = frame_task.stage_maps
def hanging(path, *arguments, **options):
    if path.name == "frame_0007.tif":
        time.sleep(1000)
    return write(path, *arguments, **options)
frame_task.stage_maps = hanging
main()
"""


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_frame_that_hangs_fails_alone(jobs: int, capture: Path, map_bytes: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    inputs = [capture / f"frame_{index:04}.tif" for index in range(10)]
    limit = ("--frame-timeout", 1.5)
    with _running("resolve", *inputs, "-o", out, "-j", jobs, *limit, command=(sys.executable, "-c", _HANGING)) as run:
        status, err, reports = run.wait()
    assert status == 1
    assert [report["status"] for report in reports] == ["failed" if index == 7 else "ok" for index in range(10)]
    assert reports[7]["reason"].startswith(f"{inputs[7]}: not done within the 1.5 s of --frame-timeout, twice")
    assert reports[7]["reason"] in err
    assert _whole_maps(out, map_bytes) == 9


@pytest.mark.parametrize("jobs", [1000, 1_000_000_000])
def test_the_number_of_processes_is_limited(jobs: int, capture: Path, tmp_path: Path) -> None:
    done = program("resolve", capture / "frame_0000.tif", "-o", tmp_path / "out", "-j", jobs)
    assert done.status == 0
    assert f"--jobs {jobs}: at most {4 * available_cores()} processes are started, 4 per core" in done.err
    with _running("resolve", capture, "-o", tmp_path / "all", "-j", jobs) as run:
        assert len(run.workers) <= 4 * available_cores()
        assert run.wait()[0] == 0


_DEADLY = """
import os
import re
from cadtof_cli.cli import main
from cadtof_cli.workflows.resolve import frame_task
write = frame_task.stage_maps
def deadly(path, *arguments, **options):
    if path.name == "frame_0007.tif":
        path.with_name(f".{path.name}.{options['token']}.partial").write_bytes(b"half")
        os._exit(1)
    return write(path, *arguments, **options)
frame_task.stage_maps = deadly
main()
"""


def test_a_frame_that_kills_every_worker_fails_alone(capture: Path, map_bytes: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    inputs = [capture / f"frame_{index:04}.tif" for index in range(20)]
    with _running("resolve", *inputs, "-o", out, "-j", 2, command=(sys.executable, "-c", _DEADLY)) as run:
        status, err, reports = run.wait()
    assert status == 1
    assert err.startswith(f"failed: {inputs[7]}: the worker process died twice on this frame")
    assert [report["status"] for report in reports] == ["failed" if index == 7 else "ok" for index in range(20)]
    assert reports[7]["source"] == str(inputs[7])
    assert _whole_maps(out, map_bytes) == 19


@pytest.mark.parametrize(
    ("variables", "threads"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, min(2, len(os.sched_getaffinity(0))))]
)
def test_linear_algebra_starts_no_threads_and_a_run_leaves_none(
    variables: dict[str, str], threads: int, capture: Path, tmp_path: Path
) -> None:
    """Linear algebra has no threads unless the user asks for them. The threads that write maps end with the run."""
    if variables and "openblas" not in str(np.show_config(mode="dicts")).lower():
        pytest.skip("numpy's linear algebra is another")
    environment = {name: value for name, value in ENVIRONMENT.items() if "NUM_THREADS" not in name} | variables
    words = ["resolve", str(capture), "-o", str(tmp_path / "out"), "-q", "-j", "1", "--frames", ":2"]
    done = subprocess.run(
        [sys.executable, "-c", _THREADS, *words], env=environment, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == threads
