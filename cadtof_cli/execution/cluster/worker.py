"""What runs on a worker of a cluster: one batch of tasks at a time, from the folder in which the run was started."""

import hashlib
import os
import platform
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Generic

from cadtof_cli.execution.outcome import Later, Raised, Result, Task, Work, finishing
from cadtof_cli.version import __version__

LONGEST_BATCH_S = 1.0
"""After this time a worker begins no further task of a batch. Tasks can become slow, for example when a disk stalls, and a run
that is stopped waits until its workers are idle."""

_ONE_AT_A_TIME = threading.Lock()
"""Lets one batch run at a time: the current folder belongs to the whole process, so tasks of two runs must not run together."""


@dataclass(frozen=True)
class BatchResult(Generic[Result]):
    """The results of the first tasks of a batch, in order, and the time that they took together; no other task was begun."""

    results: tuple[Result | Raised, ...]
    seconds: float


@dataclass(frozen=True)
class Surroundings:
    """The properties that a process must share with a run's client to do its tasks.

    Attributes:
        python: version of Python; only the first two numbers count.
        cadtof: version of cadtof.
        code: digest of the source of cadtof; it differs if somebody has changed a version in place.
        probe: digest of a file in the run's folder; None if the process does not find this file.
    """

    python: str
    cadtof: str
    code: str
    probe: str | None

    def differences(self, expected: "Surroundings", /) -> list[str]:
        """Return the differences from the client's surroundings, in words; an empty list if the process can do the tasks."""
        found: list[str] = []
        if self.python.split(".")[:2] != expected.python.split(".")[:2]:
            found.append(f"has Python {self.python}, expected {expected.python} as here")
        if self.cadtof != expected.cadtof:
            found.append(f"has cadtof {self.cadtof}, expected {expected.cadtof} as here")
        elif self.code != expected.code:
            found.append(
                f"has cadtof {self.cadtof}, but of other source code than here ({self.code}, not {expected.code})"
            )
        if self.probe != expected.probe:
            found.append("does not see the folders of this run; expected a file system that all workers share")
        return found


def surroundings(folder: Path, probe: Path | None, /) -> Surroundings:
    """Return the surroundings of this process; `probe` is a file, relative to `folder`, or None."""
    try:
        seen = hashlib.sha256((folder / probe).read_bytes()).hexdigest() if probe else None
    except OSError:
        seen = None
    return Surroundings(platform.python_version(), __version__, _code(), seen)


def run_batch(function: Work[Task, Result], tasks: Sequence[Task], folder: Path, /) -> BatchResult[Result]:
    """Run function(task) for one task after the other, with `folder` as the current folder; exceptions become results.

    The first task is always done. Every further task is begun only if the batch has not taken longer than `LONGEST_BATCH_S`.
    """
    with _ONE_AT_A_TIME, _in_folder(folder):
        began = time.monotonic()
        with finishing() as finisher:
            begun: list[Later[Result]] = []
            for task in tasks:
                if begun and time.monotonic() - began > LONGEST_BATCH_S:
                    break
                begun.append(finisher.attempt(function, task))
        return BatchResult(tuple(one.answer() for one in begun), time.monotonic() - began)


@contextmanager
def _in_folder(folder: Path) -> Iterator[None]:
    """Make a folder the current folder of this process, then go back; the folder from before may be gone."""
    before = None
    with suppress(OSError):
        before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        if before is not None:
            with suppress(OSError):
                os.chdir(before)


def wait_until_idle() -> None:
    """Wait until this process runs no batch."""
    with _ONE_AT_A_TIME:
        pass


@cache
def _code() -> str:
    """Return a short digest of the package's source."""
    package = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(f"{path.relative_to(package)}\0".encode() + path.read_bytes())
    return digest.hexdigest()[:12]
