"""Measure the cost of a cluster: per task at the scheduler, and in frames per second against processes without a cluster."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil
from speed.measure import ROOT, SAMPLE, capture_of

from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import single_frames
from cadtof_cli.execution.cluster import ordered
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.workers import Workers
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.workflows.recording import FrameReader
from cadtof_cli.workflows.resolve.frame_task import FrameTask
from tests.support.cluster import LocalCluster, local_cluster, no_work


@dataclass(frozen=True)
class Cost:
    """The cost of some tasks.

    Attributes:
        tasks: number of tasks.
        seconds: time on the clock.
        scheduler_s, client_s, workers_s: processor time.
        scheduler_bytes, client_bytes: resident memory after the last task.
        moved_bytes: bytes that went over the loopback device.
    """

    tasks: int
    seconds: float
    scheduler_s: float
    client_s: float
    workers_s: float
    scheduler_bytes: int
    client_bytes: int
    moved_bytes: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parts = parser.add_subparsers(dest="part", required=True)
    projection = parts.add_parser(
        "projection", help="cost per task for several numbers of tasks, and the cost of a million tasks"
    )
    projection.add_argument("--tasks", type=int, nargs="+", default=[100, 1000, 10_000])
    throughput = parts.add_parser("throughput", help="two workers of a scheduler on this machine against --jobs 2")
    throughput.add_argument("--frames", type=int, default=500)
    throughput.add_argument(
        "--repeats", type=int, default=3, help="number of turns; the shortest time of each side counts"
    )
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch, local_cluster(Path(scratch) / "cluster", workers=2) as cluster:
        if given.part == "projection":
            _projection(cluster, given.tasks)
        else:
            _throughput(cluster, Path(scratch), given.frames, given.repeats)


# --- cost per task ---------------------------------------------------------------------------------------------------


def _projection(cluster: LocalCluster, counts: list[int]) -> None:
    """Measure tasks that do nothing, so that only the way to a worker and back costs time.

    Every task is a batch of its own, as frames are that take 50 ms or more.
    """
    ordered.MOST_IN_BATCH = 1
    _cost(cluster, 20)  # not counted: the first tasks import modules
    costs = [_cost(cluster, count) for count in counts]
    print(
        f"{'tasks':>8}{'tasks/s':>10}{'scheduler':>14}{'client':>14}{'workers':>14}{'moved':>16}{'scheduler':>12}{'client':>10}"
    )
    for one in costs:
        each = [1000 * seconds / one.tasks for seconds in (one.scheduler_s, one.client_s, one.workers_s)]
        print(
            f"{one.tasks:8}{one.tasks / one.seconds:10.0f}" + "".join(f"{value:8.2f} ms/t." for value in each)
            + f"{one.moved_bytes / one.tasks:10.0f} B/t.{one.scheduler_bytes / 2**20:9.0f} MB{one.client_bytes / 2**20:7.0f} MB"
        )  # fmt: skip
    least, most = costs[0], costs[-1]
    more = most.tasks - least.tasks
    million = 10**6
    scheduler_s = (most.scheduler_s - least.scheduler_s) / more
    memory = (most.scheduler_bytes - least.scheduler_bytes) / more
    moved = (most.moved_bytes - least.moved_bytes) / more
    print(
        f"from {least.tasks} to {most.tasks} tasks, per task more: {1000 * scheduler_s:.2f} ms at the scheduler, "
        f"{memory:.0f} B of its memory, {moved:.0f} B moved"
    )
    print(
        f"1e6 tasks: {scheduler_s * million / 60:.0f} min of the scheduler's processor, {1 / scheduler_s:.0f} tasks/s at most; "
        f"{memory * million / 2**20:.0f} MB more memory there if it went on growing; {moved * million / 2**30:.1f} GB moved"
    )


def _cost(cluster: LocalCluster, count: int) -> Cost:
    (capture,) = find_captures([SAMPLE], overrides={})
    source = next(iter(single_frames(capture)))
    plan = FramePlan(metadata=capture.source.metadata, settings=MapSettings())
    reader = FrameReader(capture.layout, plan.metadata, (240, 320))
    task = FrameTask((source,), reader, plan, Path("out") / "frame_0000.tif", token="01234567")
    before, began = _used(cluster), time.monotonic()
    outcomes = run_ordered(no_work, (task for _ in range(count)), workers=Workers(scheduler=cluster.address))
    assert sum(1 for _ in outcomes) == count
    after = _used(cluster)
    scheduler, client, workers, moved = (now - then for now, then in zip(after, before, strict=True))
    return Cost(
        tasks=count,
        seconds=time.monotonic() - began,
        scheduler_s=scheduler,
        client_s=client,
        workers_s=workers,
        scheduler_bytes=psutil.Process(cluster.scheduler.pid).memory_info().rss,
        client_bytes=psutil.Process().memory_info().rss,
        moved_bytes=int(moved),
    )


def _used(cluster: LocalCluster) -> tuple[float, float, float, float]:
    """Return processor seconds of the scheduler, the client and the workers, and bytes that went over the loopback device."""
    processes = [[cluster.scheduler.pid], [os.getpid()], [worker.pid for worker in cluster.workers]]
    seconds = [sum(sum(psutil.Process(pid).cpu_times()[:2]) for pid in pids) for pids in processes]
    return seconds[0], seconds[1], seconds[2], float(psutil.net_io_counters(pernic=True)["lo"].bytes_sent)


# --- frames a second -------------------------------------------------------------------------------------------------


def _throughput(cluster: LocalCluster, scratch: Path, frames: int, repeats: int) -> None:
    capture = capture_of(scratch / "capture", frames)
    ways = {"--jobs 2": ("-j", "2"), "two workers": ("--scheduler", cluster.address)}
    whole: dict[str, list[float]] = {name: [] for name in ways}
    inside: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, arguments in ways.items():
            out, began = scratch / "out", time.monotonic()
            command = [sys.executable, "-m", "cadtof_cli", "resolve", str(capture), "-o", str(out), "--overwrite", "-q"]
            subprocess.run([*command, *arguments], check=True, cwd=ROOT)
            whole[name].append(time.monotonic() - began)
            inside[name].append(json.loads((out / "run.json").read_text())["totals"]["seconds"])
            print(f"  {name:12} {whole[name][-1]:6.2f} s, {inside[name][-1]:6.2f} s of it resolving", flush=True)
    for what, times in (("whole command", whole), ("resolving", inside)):
        rates = {name: frames / min(taken) for name, taken in times.items()}
        ratio = rates["two workers"] / rates["--jobs 2"]
        said = ", ".join(f"{name}: {rate:.0f} frames/s" for name, rate in rates.items())
        print(f"{what}: {said}; ratio {ratio:.2f} (asked: 0.8)")


if __name__ == "__main__":
    main()
