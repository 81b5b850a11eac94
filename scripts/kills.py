"""Kill runs at random moments, resume them, and compare the results with a run that was not disturbed.

    scripts/kills [--kills 200] [--seed 0] [--kinds resolve,resume,stacks,overwrite,cluster]

Five kinds of run take turns, each of 60 frames: `resolve`, a `--resume` that is killed too, stacks, `--overwrite` of a
run with other settings, and `resolve` on a cluster. Three victims take turns: the parent, a worker, and both; on a
cluster, the third is the scheduler. After the last `--resume`, on this machine, every map, `run.json` and
`frames.jsonl` must equal those of the undisturbed run, apart from times, and the folder must hold nothing else. Without
dask (extra cluster), the kind `cluster` is left out.
"""

import argparse
import contextlib
import importlib.util
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from cadtof_cli.cli import main
from tests.support.captures import TOML, counts_of, record, write_frame, write_pages
from tests.support.cluster import LocalCluster, local_cluster
from tests.support.forward import step_frame
from tests.support.runs import require_same_run

FRAMES = 60
VICTIMS = ("parent", "worker", "both")
KINDS = ("resolve", "resume", "stacks", "overwrite", "cluster")


def capture_of_frames(folder: Path) -> Path:
    """Record 60 different small frames, one per file."""
    record(folder, frames=0)
    for index in range(FRAMES):
        write_frame(folder / f"frame_{index:03}.tif", step_frame(np.random.default_rng(index)))
    return folder


def capture_of_stacks(folder: Path) -> Path:
    """Record 60 different small frames, in five stacks."""
    count = 12
    record(folder, frames=0, toml=f"{TOML['tif']}[layout]\nframes = {count}\n")
    for stack in range(FRAMES // count):
        frames = [counts_of(step_frame(np.random.default_rng(stack * count + index))) for index in range(count)]
        write_pages(folder / f"stack_{stack}.tif", np.concatenate(frames))
    return folder


def started(*arguments: object) -> int:
    """Start `cadtof resolve` in a fork of this process, so that kills hit the work and not the imports; return its
    process id."""
    pid = os.fork()
    if pid:
        return pid
    os.setsid()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nowhere, number)
    sys.argv = ["cadtof", "resolve", *map(str, arguments)]
    if "--scheduler" not in arguments:
        sys.argv += ["-j", "2"]
    status = 1
    try:
        main()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 0
    finally:
        os._exit(status)


def status_of(pid: int) -> int:
    """Wait for a process; return its exit status, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def workers_of(pid: int) -> list[int]:
    """Return the child processes of a process."""
    with contextlib.suppress(OSError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


def kill_after(seconds: float, pid: int, victim: str, rng: random.Random) -> int:
    """Kill a run's parent, a worker or two, or both after a time; return the exit status of the run."""
    time.sleep(seconds)
    if victim != "parent":
        for worker in workers_of(pid)[: rng.randint(1, 2)]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(worker, signal.SIGKILL)
    if victim != "worker":
        os.kill(pid, signal.SIGKILL)
    return status_of(pid)


def undisturbed(capture: Path) -> Path:
    """Return the folder of the undisturbed run of a capture."""
    return capture.with_name(f"undisturbed_{capture.name}")


def one_kill(kind: str, victim: str, captures: dict[str, Path], out: Path, took: float, rng: random.Random) -> None:
    """Kill one run, resume it, and compare; raises AssertionError if something differs."""
    capture = captures["stacks" if kind == "stacks" else "frames"]
    overwriting: tuple[str, ...] = ()
    if kind == "overwrite":
        assert status_of(started(capture, "-o", out, "--order", 1)) == 0
        overwriting = ("--overwrite",)
    status = kill_after(rng.uniform(0.0, took), started(capture, "-o", out, *overwriting), victim, rng)
    assert status in ({0} if victim == "worker" else {0, -signal.SIGKILL}), f"ended with {status}"
    if kind == "resume":
        kill_after(rng.uniform(0.0, took), started(capture, "-o", out, "--resume"), victim, rng)
    status = status_of(started(capture, "-o", out, "--resume"))
    if kind == "overwrite" and status == 2:
        # the kill came before the new run replaced the record of the old run, which has other settings: it is not resumed
        status = status_of(started(capture, "-o", out, "--overwrite"))
    assert status == 0, f"--resume ended with {status}"
    require_same_run(out, undisturbed(capture))


class Clusters:
    """A dask scheduler with two workers; those that have been killed are replaced."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._number, self._held = folder, 0, contextlib.ExitStack()
        self._cluster: LocalCluster | None = None

    def sound(self) -> LocalCluster:
        """Return a cluster with a living scheduler and two living workers."""
        if self._cluster is None or self._cluster.scheduler.poll() is not None:
            self.close()
            self._number += 1
            self._cluster = self._held.enter_context(local_cluster(self._folder / str(self._number), workers=2))
        living = [worker for worker in self._cluster.workers if worker.poll() is None]
        self._cluster.add_workers(2 - len(living))
        return self._cluster

    def close(self) -> None:
        """End the processes."""
        self._held.close()
        self._cluster = None


def one_kill_on_a_cluster(
    victim: str, capture: Path, out: Path, clusters: Clusters, took: float, rng: random.Random
) -> None:
    """Kill a run on a cluster, one of its workers, or its scheduler; resume the run on this machine, and compare."""
    cluster = clusters.sound()
    pid = started(capture, "-o", out, "--scheduler", cluster.address)
    time.sleep(rng.uniform(0.0, took))
    if victim == "parent":
        os.kill(pid, signal.SIGKILL)
    else:
        living = [worker for worker in cluster.workers if worker.poll() is None]
        (cluster.scheduler if victim == "both" else rng.choice(living)).kill()
    status = status_of(pid)
    # if the scheduler is gone before the run connects to it, the option --scheduler is wrong: status 2
    allowed = {"parent": {0, -signal.SIGKILL}, "worker": {0}, "both": {0, 1, 2}}[victim]
    assert status in allowed, f"ended with {status}"
    status = status_of(started(capture, "-o", out, "--resume"))
    assert status == 0, f"--resume ended with {status}"
    require_same_run(out, undisturbed(capture))


def kinds_there() -> tuple[str, ...]:
    """Return the kinds of run that can be tried here."""
    has_dask = importlib.util.find_spec("distributed") is not None
    return KINDS if has_dask else KINDS[:-1]


def campaign(kills: int, seed: int, say: Callable[[str], None], *, kinds: Sequence[str]) -> list[str]:
    """Kill `kills` runs; return the faults."""
    rng, faults = random.Random(seed), list[str]()
    with tempfile.TemporaryDirectory(prefix="kills-") as place, contextlib.ExitStack() as held:
        here = Path(place)
        clusters = Clusters(here / "cluster")
        held.callback(clusters.close)
        captures = {"frames": capture_of_frames(here / "frames"), "stacks": capture_of_stacks(here / "stacks")}
        took = 0.0
        for capture in captures.values():
            began = time.monotonic()
            assert status_of(started(capture, "-o", undisturbed(capture))) == 0
            took = max(took, time.monotonic() - began)
        for number in range(kills):
            kind, victim = kinds[number % len(kinds)], VICTIMS[number // len(kinds) % len(VICTIMS)]
            out = here / "out"
            try:
                if kind == "cluster":
                    # connecting to the scheduler takes time, too
                    one_kill_on_a_cluster(victim, captures["frames"], out, clusters, 3 * took, rng)
                else:
                    one_kill(kind, victim, captures, out, took, rng)
            except AssertionError as error:
                faults.append(f"kill {number} ({kind}, {victim}): {str(error)[:500]}")
                say(faults[-1])
            shutil.rmtree(out, ignore_errors=True)
            if (number + 1) % 20 == 0:
                say(f"{number + 1 - len(faults)} of {number + 1} kills equal an undisturbed run")
    return faults


def run() -> int:
    """Run the campaign that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--kinds", default=",".join(kinds_there()), metavar="KIND,…")
    options = parser.parse_args()
    kinds = options.kinds.split(",")
    faults = campaign(options.kills, options.seed, lambda line: print(line, flush=True), kinds=kinds)
    print(
        f"{options.kills - len(faults)} of {options.kills} kills: all maps and records equal those of an undisturbed run"
    )
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(run())
