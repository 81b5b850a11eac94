"""Measure whole runs: `cadtof resolve` beside reading and writing as many bytes, its start-up and its memory."""

import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from speed.measure import ENVIRONMENT, ROOT, Command, Cost, Row, capture_of, in_turns, peak_memory, resolve

COPY = """
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
import numpy as np, tifffile

def copy(task):
    source, target = task
    frame = tifffile.imread(source)
    pages = PAGES[0] if PAGES else PAGES.append(np.zeros((8, *frame.shape[-2:]), np.float32)) or PAGES[0]
    tifffile.imwrite(target, pages, photometric="minisblack", metadata=None)

PAGES = []
folder, out, jobs = sys.argv[1:]
tasks = [(path, f"{out}/{path.name}") for path in sorted(Path(folder).glob("*.tif"))]
if jobs == "1":
    for task in tasks:
        copy(task)
else:
    with ProcessPoolExecutor(int(jobs)) as pool:
        list(pool.map(copy, tasks))
"""
"""A program that reads frames, and writes as many bytes as `resolve` does. It uses tifffile alone, and does not wait
for the disk."""

WRITE = """
import os, sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from cadtof_cli.files.atomic import PartialFile
from cadtof_cli.files.maps import DepthMaps

def write(path):
    file = PartialFile(path)
    file.parts = (content,)
    file.commit()

out, files, size = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
if "unsynced" in sys.argv:
    os.fsync = lambda descriptor: None
content = DepthMaps.empty(("layer",), (1, size // 4)).image[:size]
content[:] = os.urandom(size)
with ThreadPoolExecutor(8) as pool:
    list(pool.map(write, [out / f"{index:05}.tif" for index in range(files)]))
"""
"""A program that writes as many bytes as two jobs of `resolve`, in the same way and as many files at once. It reads
and computes nothing."""

AT_ONCE = """
import subprocess, sys

half, *commands = sys.argv[1:]
runs = [subprocess.Popen(commands[place : place + int(half)]) for place in (0, int(half))]
sys.exit(max(run.wait() for run in runs))
"""
"""A program that starts two commands of the same number of words, and waits for both."""

MAP_BYTES = 8 * 4 * 240 * 320 + 2 * 2**12
"""Bytes of a QVGA frame's maps."""

ASKED = {200: 0.5, 1000: 0.58}
"""Goal by the number of frames, with AVX-512: throughput over that of only reading and writing."""

DIFFUSE_FRAMES = 400
"""Number of frames with the default MPI model. MPI is predicted for each of them, so they take longer than writing
their maps, and ten times as long as the start."""


def end_to_end(place: Path, repeats: int, frames: int) -> Iterator[Row]:
    """Measure `cadtof resolve` of some hundreds of frames against only reading and writing, by CPU time of the
    process tree."""
    capture, out, script = capture_of(place / f"in{frames}", frames), place / "out", place / "copy_frames.py"
    script.write_text(COPY)
    discrete = ("--mpi-model", "discrete")
    commands = {}
    for jobs in ("1", "2"):
        commands[f"copy {jobs}"] = Command([sys.executable, str(script), str(capture), str(out), jobs], out)
        commands[f"discrete {jobs}"] = resolve(capture, out, *discrete, "-j", jobs)
    if frames <= min(ASKED):
        commands["diffuse 1"] = resolve(capture, out, "-j", "1")
    if frames > min(ASKED):
        halves = [capture_of(place / f"half{name}", frames // 2) for name in "ab"]
        runs = [resolve(half, out / half.name, *discrete, "-j", "1").words for half in halves]
        commands["apart"] = Command([sys.executable, "-c", AT_ONCE, str(len(runs[0])), *runs[0], *runs[1]], out)
        write = ["-c", WRITE, str(out), str(frames), str(MAP_BYTES)]
        for name in ("synced", "unsynced"):
            commands[name] = Command([sys.executable, *write, name], out, {"PYTHONPATH": str(ROOT)})
        for jobs in ("1", "2"):
            commands[f"default {jobs}"] = resolve(capture, out, "--frames", f":{DIFFUSE_FRAMES}", "-j", jobs)
    costs = in_turns(commands, repeats)
    shutil.rmtree(capture)

    def ratio(jobs: str, model: str) -> float:
        return costs[f"copy {jobs}"].cpu_s / costs[f"{model} {jobs}"].cpu_s

    ratios = (ratio("1", "discrete"), ratio("2", "discrete"))
    yield Row(
        f"`resolve --mpi-model discrete` of {frames} TIFF frames over only reading them and writing as many bytes, one job / two",
        f"≥ {ASKED[frames]:g}",
        " / ".join(f"{one:.2f}" for one in ratios),
        ratios,
    )
    if "diffuse 1" in costs:
        yield Row("… where the MPI is diffuse", "≥ 0.2", f"{ratio('1', 'diffuse'):.2f}", (ratio("1", "diffuse"),))
    if frames > min(ASKED):
        yield from _two_jobs(costs)
    rate = frames / costs["discrete 2"].wall_s
    yield Row("frames a second with two jobs, start-up and all", None, f"{rate:.0f}", (rate,))


def _two_jobs(costs: Mapping[str, Cost]) -> Iterator[Row]:
    """Yield rows on the gain of a second job and on its limits.

    A run does not end before its maps are written, and has no more cores than there are.
    """
    one, two = costs["default 1"], costs["default 2"]
    ratio = one.wall_s / two.wall_s
    what = f"two jobs over one, by the clock, of {DIFFUSE_FRAMES} frames with the MPI model that is the default"
    yield Row(what, "≥ 1.7", f"{ratio:.2f}", (ratio,))
    one, two = costs["discrete 1"], costs["discrete 2"]
    rows = {
        ("… with `--mpi-model discrete`", "≥ 1.7"): ("discrete 2",),
        ("… two runs of one job each, of half the frames, that know nothing of each other, over one", None): ("apart",),
        ("… what the disk allows: only writing as many maps in the same way / unsynced, over one", None): (
            "synced",
            "unsynced",
        ),
    }
    for (what, asked), names in rows.items():
        ratios = tuple(one.wall_s / costs[name].wall_s for name in names)
        yield Row(what, asked, " / ".join(f"{ratio:.2f}" for ratio in ratios), ratios)
    busy = tuple(cost.cpu_s / cost.wall_s for cost in (one, two))
    yield Row("… cores that are at work, one job / two", None, " / ".join(f"{one:.2f}" for one in busy), busy)


def start_up(place: Path, repeats: int) -> Iterator[Row]:
    """Measure a run of one frame, and `--help`, against importing the libraries that they need."""
    capture, out = capture_of(place / "one", 1), place / "out"
    program = Path(sys.executable).with_name("cadtof")
    words = [str(program), "resolve", str(capture), "-o", str(out), "-q", "--overwrite"]
    commands = {
        "frame": Command([*words, "--mpi-model", "discrete"], out),
        "default": Command(words, out),
        "libraries": Command([sys.executable, "-c", "import numpy, tifffile"], out),
        "help": Command([str(program), "--help"], out),
        "click": Command([sys.executable, "-c", "import click"], out),
    }
    costs = in_turns(commands, 5 * repeats)
    for what, asked, ours, other in (
        (
            "`resolve --mpi-model discrete` of one frame over `python -c 'import numpy, tifffile'`",
            1.7,
            "frame",
            "libraries",
        ),
        ("… with the MPI model that is the default", 1.7, "default", "libraries"),
        ("`cadtof --help` over `python -c 'import click'`", 3.0, "help", "click"),
    ):
        ratio = costs[ours].cpu_s / costs[other].cpu_s
        yield Row(what, f"≤ {asked:g}" if asked else None, f"{ratio:.2f}", (ratio,))


def memory(place: Path, frames: int) -> Iterator[Row]:
    """Measure the peak memory of the whole process tree: many frames over few."""
    peaks = []
    for count, runs in ((50, 3), (frames, 1)):
        capture, out = capture_of(place / f"in{count}", count), place / "out"
        command = resolve(capture, out, "--mpi-model", "discrete", "-j", "2")
        peaks.append(max(peak(command) for _ in range(runs)))
        shutil.rmtree(capture)
    few, many = peaks
    yield Row(
        f"peak memory of the process tree, {frames} frames over 50",
        "≤ 1.10",
        f"{many / few:.2f} ({many / 1e6:.0f} and {few / 1e6:.0f} MB)",
        (many / few, many, few),
    )


def peak(command: Command) -> int:
    """Run a command; return the peak memory of it and all its descendants, in bytes."""
    shutil.rmtree(command.out, ignore_errors=True)
    command.out.mkdir()
    environment = {**ENVIRONMENT, **(command.environment or {})}
    with subprocess.Popen(command.words, env=environment, cwd=command.out) as process:
        return peak_memory(process, "Rss")
