"""Measure CPU time of whole process trees that take turns; rows of what was asked and what came out."""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

ROOT = Path(__file__).resolve().parents[2]

SAMPLE = ROOT / "sample_data" / "corner"

ENVIRONMENT = {
    name: value for name, value in os.environ.items() if name not in {"PYTHONDONTWRITEBYTECODE", "PYTHONPATH"}
} | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of measured commands. Python keeps its bytecode, as it does for a user, and no library starts threads
of its own."""

PAUSE_S = 0.01
"""Time from one look at the memory of a process to the next."""


@dataclass(frozen=True)
class Row:
    """What was measured, what was asked (None: nothing) and what came out, as text and as numbers."""

    what: str
    asked: str | None
    measured: str
    values: tuple[float, ...] = ()

    def as_markdown(self) -> str:
        """Return the row of a table."""
        return f"| {self.what} | {self.asked or ''} | {self.measured} |"


@dataclass(frozen=True)
class Cost:
    """What a command cost: CPU time of its process tree, user and system, and the time on the clock, in s."""

    cpu_s: float
    wall_s: float


@dataclass(frozen=True)
class Command:
    """A command, and the folder that it writes into.

    The folder is new each time. The files that it held before are truncated and kept beside it instead of deleted:
    whenever a file is created, ext4 looks through what was deleted in the last minutes, which takes half a millisecond
    after 1,000 files.
    """

    words: Sequence[str]
    out: Path
    environment: Mapping[str, str] | None = None

    def cost(self) -> Cost:
        """Run the command once, and return what it cost."""
        if self.out.exists():
            for path in self.out.rglob("*"):
                if path.is_file():
                    os.truncate(path, 0)
            self.out.rename(tempfile.mkdtemp(prefix="before-", dir=self.out.parent))
        self.out.mkdir()
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        # not in the current folder: Python looks for modules there first, and would find this commit instead of another
        environment = {**ENVIRONMENT, **(self.environment or {})}
        subprocess.run(self.words, env=environment, cwd=self.out, stdout=subprocess.DEVNULL, check=True)
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        return Cost(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, wall)


def resolve(capture: Path, out: Path, *options: str, environment: Mapping[str, str] | None = None) -> Command:
    """Return `cadtof resolve` of a capture, by the Python that runs this."""
    words = [sys.executable, "-m", "cadtof_cli", "resolve", str(capture), "-o", str(out), "-q", "--overwrite", *options]
    return Command(words, out, environment)


def in_turns(commands: Mapping[str, Command], repeats: int) -> dict[str, Cost]:
    """Return the least CPU and clock time of each command.

    They take turns, so that other work on the machine hits all of them.
    """
    costs: dict[str, list[Cost]] = {name: [] for name in commands}
    for _ in range(repeats):
        for name, command in commands.items():
            costs[name].append(command.cost())
    return {
        name: Cost(min(cost.cpu_s for cost in found), min(cost.wall_s for cost in found))
        for name, found in costs.items()
    }


def least_seconds(works: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the least CPU time of this thread for each work; the works take turns."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            began = time.thread_time()
            work()
            times[name].append(time.thread_time() - began)
    return {name: min(found) for name, found in times.items()}


def peak_memory(run: subprocess.Popen[bytes], kind: Literal["Rss", "Pss"]) -> int:
    """Wait for the end of a process; return the peak memory of it and all its descendants, in bytes.

    Args:
        run: the process.
        kind: `Rss` counts a shared page for each process. `Pss` shares it out, so that it counts once; but `Pss` also
            changes when other processes on the machine map the same pages, although nothing is allocated.
    """
    peak = 0
    while run.poll() is None:
        peak = max(peak, _tree_memory(run.pid, kind))
        time.sleep(PAUSE_S)
    return peak


def _tree_memory(pid: int, kind: str) -> int:
    total, waiting = 0, [pid]
    while waiting:
        pid = waiting.pop()
        try:
            lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
            total += 1024 * sum(int(line.split()[1]) for line in lines if line.startswith(f"{kind}:"))
            for task in Path(f"/proc/{pid}/task").iterdir():
                waiting += [int(child) for child in (task / "children").read_text().split()]
        except OSError:
            continue
    return total


def capture_of(folder: Path, frames: int, *, sample: Path = SAMPLE) -> Path:
    """Make a capture of `frames` copies of a sample's first frame."""
    folder.mkdir()
    shutil.copy(sample / "capture.toml", folder)
    first = min(sample.glob("frame_*.tif"))
    for index in range(frames):
        shutil.copy(first, folder / f"frame_{index:05}.tif")
    return folder
