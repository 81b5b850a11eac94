"""Speed and memory of cadtof, as ratios of things measured side by side in one run: absolute times mean little."""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq

from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths

ROOT = Path(__file__).resolve().parent.parent
FRAME = ROOT / "sample_data" / "corner"

# Read frames and write as many bytes as `resolve` does ("maps"), or as were read ("same"), with tifffile and nothing else.
COPY = """
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
import numpy as np, tifffile

def copy(task):
    source, target, what = task
    frame = tifffile.imread(source)
    if what == "same":
        tifffile.imwrite(target, frame)
    else:
        pages = PAGES[0] if PAGES else PAGES.append(np.zeros((8, *frame.shape[-2:]), np.float32)) or PAGES[0]
        tifffile.imwrite(target, pages, photometric="minisblack", metadata=None)

PAGES = []
folder, out, jobs, what = sys.argv[1:]
tasks = [(p, f"{out}/{p.name}", what) for p in sorted(Path(folder).glob("*.tif"))]
if jobs == "1":
    for task in tasks:
        copy(task)
else:
    with ProcessPoolExecutor(int(jobs)) as pool:
        list(pool.map(copy, tasks))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; default: all")
    parser.add_argument("--frames", type=int, default=200, help="frames of the end-to-end part")
    parser.add_argument("--long", type=int, default=2000, help="frames of the memory part")
    parser.add_argument("--repeats", type=int, default=3, help="turns that are taken; the best of each side counts")
    arguments = parser.parse_args()
    for name in arguments.parts or PARTS:
        print(f"== {name}", flush=True)
        PARTS[name](arguments)


def best(run: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return min(times)


def row(what: str, asked: str, measured: str) -> None:
    print(f"  {what:78}{asked:>16}{measured:>16}", flush=True)


# --- the paper's way -------------------------------------------------------------------------------------------------


def paper_way(p1: complex, p2: complex, rng: np.random.Generator) -> tuple[complex, complex]:
    """Eq. (9) by Levenberg–Marquardt from ten random starts, the best kept: the two paths as complex amplitudes."""
    q2 = p2 * abs(p1) / p1**2

    def misfit(z: NDArray[np.float64]) -> tuple[float, float]:
        a, b = complex(z[0], z[1]), complex(1 - z[0], -z[1])
        left = (a * a / abs(a) if a else 0) + (b * b / abs(b) if b else 0) - q2
        return left.real, left.imag

    solutions = []
    for start in rng.uniform(-1, 1, (10, 2)):
        z, *_ = leastsq(misfit, start)
        solutions.append((float(np.hypot(*misfit(z))), complex(*z)))
    z = min(solutions, key=lambda pair: pair[0])[1]
    return p1 * z, p1 * (1 - z)


def solvers(arguments: argparse.Namespace) -> None:
    """The closed form against the paper's solver, on the same pixels, one core each."""
    rng = np.random.default_rng(9)
    size = 300
    a = np.full(size, 1 / 6.3)
    b = np.where(np.arange(size) < size // 2, 0.3 / 6.3, 0.0)
    x, y = rng.uniform(0, np.pi, size), rng.uniform(1.2, 2 * np.pi - 1.2, size)
    noise = rng.normal(scale=1 / (2 * np.sqrt(1e5)), size=(2, size, 2)) @ np.array([1, 1j])
    p1, p2 = (a * np.exp(1j * h * x) + b * np.exp(1j * h * (x + y)) + noise[h - 1] for h in (1, 2))
    began = time.perf_counter()
    found = [paper_way(*pair, rng) for pair in zip(p1, p2, strict=True)]
    paper = (time.perf_counter() - began) / size

    pixels = 76_800
    many = [np.resize(p, pixels) for p in (p1, p2)]
    block = 8192

    def closed() -> None:
        with np.errstate(all="ignore"):
            for start in range(0, pixels, block):
                two_paths(fundamental_frame(*(p[start : start + block] for p in many)))

    ours = best(closed, 20) / pixels
    with np.errstate(all="ignore"):
        paths = two_paths(fundamental_frame(p1, p2))
    ours_found = zip(
        paths.a * (paths.cos_x + 1j * paths.sin_x), paths.b * (paths.cos_y + 1j * paths.sin_y), strict=True
    )

    def wrong(answers: list[tuple[complex, complex]], pixels: slice) -> int:
        residuals = [
            max(abs(a + b - q1), abs(a * a / abs(a) + b * b / abs(b) - q2)) if a and b else abs(a + b - q1)
            for (a, b), q1, q2 in zip(answers[pixels], p1[pixels], p2[pixels], strict=True)
        ]
        return sum(residual > 1e-6 for residual in residuals)

    answers = list(ours_found)
    row(
        "closed form: times faster a pixel than 10 × scipy.optimize.leastsq on Eq. (9)",
        ">= 3000",
        f"{paper / ours:.0f}",
    )
    for what, part in (("with MPI", slice(0, size // 2)), ("without", slice(size // 2, size))):
        row(
            f"pixels wrong {what} (residual > 1e-6, of {size // 2}): paper's way / closed form",
            "report",
            f"{wrong(found, part)} / {wrong(answers, part)}",
        )


# --- end to end ------------------------------------------------------------------------------------------------------


def capture_of(folder: Path, frames: int) -> Path:
    folder.mkdir()
    shutil.copy(FRAME / "capture.toml", folder)
    for index in range(frames):
        shutil.copy(FRAME / "frame_0000.tif", folder / f"frame_{index:05}.tif")
    return folder


def end_to_end(arguments: argparse.Namespace) -> None:
    """`cadtof resolve` against only reading and writing, processes and all, with the same number of jobs."""
    with tempfile.TemporaryDirectory() as place:
        capture = capture_of(Path(place) / "in", arguments.frames)
        out = Path(place) / "out"
        script = Path(place) / "copy.py"
        script.write_text(COPY)

        def run(command: list[str]) -> float:
            shutil.rmtree(out, ignore_errors=True)
            out.mkdir()
            return best(lambda: subprocess.run(command, check=True), 1)

        times: dict[str, list[float]] = {}
        for _ in range(arguments.repeats):
            for jobs in ("1", "2"):
                resolve = [
                    sys.executable,
                    "-m",
                    "cadtof_cli",
                    "resolve",
                    str(capture),
                    "-o",
                    str(out),
                    "-q",
                    "-j",
                    jobs,
                ]
                times.setdefault(f"resolve {jobs}", []).append(run(resolve))
                for what in ("maps", "same"):
                    copy = [sys.executable, str(script), str(capture), str(out), jobs, what]
                    times.setdefault(f"{what} {jobs}", []).append(run(copy))
        fastest = {name: min(values) for name, values in times.items()}
        for jobs in ("1", "2"):
            ratio = fastest[f"maps {jobs}"] / fastest[f"resolve {jobs}"]
            row(
                f"resolve {arguments.frames} TIFF frames / read and write as many bytes, {jobs} job(s)",
                ">= 0.35",
                f"{ratio:.2f}",
            )
            ratio = fastest[f"same {jobs}"] / fastest[f"resolve {jobs}"]
            row(
                f"   … / read and write back only what was read (a quarter of the bytes), {jobs} job(s)",
                "report",
                f"{ratio:.2f}",
            )
        row("two jobs / one job, throughput", ">= 1.6", f"{fastest['resolve 1'] / fastest['resolve 2']:.2f}")
        row("frames/s with two jobs, start-up and all", "report", f"{arguments.frames / fastest['resolve 2']:.0f}")


# --- memory and start-up ---------------------------------------------------------------------------------------------


def tree_memory(pid: int) -> int:
    """Return the resident memory of a process and all that it started, in bytes; pages that they share count for each.

    Shares of pages (PSS) would not do: they change with who else on the machine maps them, while nothing is allocated.
    """
    total, waiting = 0, [pid]
    while waiting:
        pid = waiting.pop()
        try:
            lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
            total += 1024 * sum(int(line.split()[1]) for line in lines if line.startswith("Rss:"))
            for task in Path(f"/proc/{pid}/task").iterdir():
                waiting += [int(child) for child in (task / "children").read_text().split()]
        except OSError:
            continue
    return total


def memory(arguments: argparse.Namespace) -> None:
    """Peak memory of the whole process tree, few frames against many."""
    peaks = {}
    with tempfile.TemporaryDirectory() as place:
        for frames in (50, arguments.long):
            capture = capture_of(Path(place) / f"in{frames}", frames)
            out = Path(place) / "out"
            command = [sys.executable, "-m", "cadtof_cli", "resolve", str(capture), "-o", str(out), "-q", "-j", "2"]
            seen = []
            for _ in range(3 if frames == 50 else 1):
                shutil.rmtree(out, ignore_errors=True)
                with subprocess.Popen(command) as process:
                    while process.poll() is None:
                        seen.append(tree_memory(process.pid))
                        time.sleep(0.01)
            peaks[frames] = max(seen)
            shutil.rmtree(capture)
    few, many = peaks[50], peaks[arguments.long]
    row(f"peak memory of the process tree, {arguments.long} frames / 50 frames", "<= 1.10", f"{many / few:.3f}")
    row("   that is, MB", "report", f"{many / 1e6:.0f} / {few / 1e6:.0f}")


def start_up(arguments: argparse.Namespace) -> None:
    """`cadtof --help` against importing click alone."""

    def median(command: list[str]) -> float:
        return statistics.median(
            best(lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL), 1) for _ in range(15)
        )

    ours = median([str(Path(sys.executable).with_name("cadtof")), "--help"])
    click = median([sys.executable, "-c", "import click"])
    row("cadtof --help / python -c 'import click'", "<= 3", f"{ours / click:.2f}")


def sibling(*command: str) -> Callable[[argparse.Namespace], None]:
    """Return a part that runs another script of this folder."""

    def run(_: argparse.Namespace) -> None:
        subprocess.run([sys.executable, str(ROOT / "scripts" / command[0]), *command[1:]], check=True)

    return run


PARTS: dict[str, Callable[[argparse.Namespace], None]] = {
    "kernel": sibling("benchmark_kernel.py"),
    "solvers": solvers,
    "end-to-end": end_to_end,
    "memory": memory,
    "start-up": start_up,
    "pixel": sibling("benchmark_pixel.py"),
    "other-solvers": sibling("benchmark_solvers.py", "speed", "lm"),
    "calibration": sibling("calibration_walkthrough.py", "--cost"),
}

if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
