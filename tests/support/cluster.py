"""A real scheduler of dask with real worker processes, on the loopback address of this machine alone."""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

from cadtof_cli.workflows.resolve.frame_task import FrameTask
from cadtof_cli.workflows.resolve.reports import FrameReport
from tests.support.needed import miss, needed_module
from tests.support.run_cadtof import ROOT

START_S = 60
"""Longest time in s that a process may take to start on a busy machine."""

HERE = "127.0.0.1"

NO_SETTINGS = {"HOME": os.devnull}
"""Without the settings of dask that a user has below HOME: a cluster with TLS, for example, is none for these tests."""

_ENDED_WITH_PARENT = """
import ctypes, os, signal, sys
PR_SET_PDEATHSIG = 1
ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
os.execv(sys.argv[1], sys.argv[1:])
"""
"""Starts a program that the system ends together with the tests, however these end."""


def no_work(task: FrameTask) -> FrameReport:
    """Answer at once, as the task of a frame does; it is in a module so that workers can import it."""
    return task.report("ok", None, 0.123456, one_path=12345, two_paths=64455, invalid=0)


def require_dask(*more: str) -> None:
    """Skip the test if dask, or a package for it, is not installed; in CI it must be.

    Dask reads a user's settings when it is first imported, and its packages write theirs.
    """
    with patch.dict(os.environ, NO_SETTINGS):
        for name in ("distributed", *more):
            needed_module(name)


@dataclass
class LocalCluster:
    """A scheduler and its workers.

    Attributes:
        folder: holds their output and the scheduler's address.
        preload: a module that workers import when they start.
    """

    folder: Path
    preload: str | None
    scheduler: "subprocess.Popen[bytes]"
    workers: "list[subprocess.Popen[bytes]]" = field(default_factory=list)

    @property
    def address(self) -> str:
        return str(json.loads((self.folder / "scheduler.json").read_text())["address"])

    def add_workers(self, count: int = 1, *, python_path: Path = ROOT) -> None:
        """Start workers, and wait until they have registered."""
        address, before = self.address, len(self.workers)
        output = [self.folder / f"worker_{number}.txt" for number in range(before, before + count)]
        command = ["worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", HERE]
        if self.preload:
            command += ["--preload", self.preload]
        self.workers += [_started(self.folder, stream, *command, python_path=python_path) for stream in output]
        for worker, stream in zip(self.workers[before:], output, strict=True):
            _wait_for(worker, stream, "Registered to")

    def ended(self) -> None:
        """End all processes that still run."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextmanager
def local_cluster(
    folder: Path, *, workers: int, preload: str | None = None, python_path: Path = ROOT
) -> Iterator[LocalCluster]:
    """Yield a scheduler with workers; all end on leaving. The scheduler looks for modules below `python_path` first."""
    _require_loopback()
    folder.mkdir(parents=True, exist_ok=True)
    output, file = folder / "scheduler.txt", folder / "scheduler.json"
    command = ("scheduler", "--host", HERE, "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    cluster = LocalCluster(folder, preload, _started(folder, output, *command, python_path=python_path))
    try:
        _wait_for(cluster.scheduler, output, "Scheduler at")
        # the scheduler prints its address before the file is complete
        while not (file.exists() and file.read_text().rstrip().endswith("}")):
            time.sleep(0.02)
        cluster.add_workers(workers)
        yield cluster
    finally:
        cluster.ended()


def _require_loopback() -> None:
    """Skip the test where not even this machine can be reached, as in a new network namespace."""
    with socket.create_server((HERE, 0)) as server:
        try:
            socket.create_connection(server.getsockname(), timeout=10).close()
        except OSError as error:
            miss(f"{HERE} cannot be reached: {error}")


def _started(folder: Path, output: Path, *command: str, python_path: Path = ROOT) -> "subprocess.Popen[bytes]":
    environment = {
        **os.environ,
        **NO_SETTINGS,
        "PYTHONPATH": f"{python_path}:{os.environ.get('PYTHONPATH', '')}",
        "DASK_TEMPORARY_DIRECTORY": str(folder),
    }
    environment.pop("PYTHONWARNINGS", None)
    with output.open("wb") as stream:
        return subprocess.Popen(
            [sys.executable, "-c", _ENDED_WITH_PARENT, sys.executable, "-m", "dask", *command],
            env=environment, stdout=stream, stderr=stream, cwd=folder,
        )  # fmt: skip


def _wait_for(process: "subprocess.Popen[bytes]", output: Path, word: str) -> None:
    until = time.monotonic() + START_S
    while word not in output.read_text():
        assert process.poll() is None, output.read_text()
        assert time.monotonic() < until, output.read_text()
        time.sleep(0.02)
