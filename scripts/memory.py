"""Measure how much memory runs take: the peak of the proportional set size (PSS), which counts shared memory once.

    scripts/memory [--frames 10000] [--side 4096] [--models discrete,diffuse]

First, a run of 10,000 small frames by two jobs is compared with a run of 100, all processes together. Then one frame of
4096 × 4096 pixels is resolved with each model of MPI. The status is 1 if a figure exceeds its limit: a ratio of 1.15,
or 1 GB.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import tifffile
from speed.measure import peak_memory

from tests.support.captures import TOML, counts_of, record, write_pages
from tests.support.forward import step_frame
from tests.support.run_cadtof import ENVIRONMENT

FEW = 100

MOST_RATIO, MOST_BYTES = 1.15, 10**9


def peak_of_run(capture: Path, out: Path, *options: object) -> int:
    """Resolve a capture; return the peak memory of all its processes together, in bytes."""
    command = [sys.executable, "-m", "cadtof_cli", "resolve", capture, "-o", out, "-q", *options]
    with subprocess.Popen([*map(str, command)], env=ENVIRONMENT) as run:
        peak = peak_memory(run, "Pss")
    if run.returncode:
        raise SystemExit(f"{capture}: ended with {run.returncode}")
    return peak


def small_frames(folder: Path, count: int) -> Path:
    """Record `count` equal frames of 8 × 10 pixels."""
    record(folder, frames=0)
    frame = step_frame(np.random.default_rng(1))[:, :, 8:16, 11:21]
    write_pages(folder / "first.tif", counts_of(frame))
    content = (folder / "first.tif").read_bytes()
    (folder / "first.tif").unlink()
    for index in range(count):
        (folder / f"frame_{index:05}.tif").write_bytes(content)
    return folder


def large_frame(folder: Path, side: int) -> Path:
    """Record a frame of `side` × `side` pixels: a small frame with a step, enlarged, with noise."""
    folder.mkdir()
    (folder / "capture.toml").write_text(
        TOML["tif"].replace("28.0", f"{0.875 * side}").replace("[15.0, 10.0]", f"[{side / 2}, {side / 2}]")
    )
    small = counts_of(step_frame(np.random.default_rng(2)))
    rows, columns = (np.minimum(np.arange(side) * small.shape[axis] // side, small.shape[axis] - 1) for axis in (1, 2))
    noise = np.random.default_rng(3)
    planes = (plane[rows][:, columns] + noise.integers(-3, 4, (side, side)) for plane in small.astype(np.int64))
    with tifffile.TiffWriter(folder / "frame.tif") as file:
        for plane in planes:
            file.write(plane.astype(np.uint16), photometric="minisblack", metadata=None, contiguous=True)
    return folder


def run() -> int:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10_000, metavar="N")
    parser.add_argument(
        "--side", type=int, default=4096, metavar="PIXELS", help="side of the large frame; 0 leaves it out"
    )
    parser.add_argument("--models", default="discrete,diffuse", metavar="MODEL,…", help="values of --mpi-model")
    options = parser.parse_args()
    sound = True
    with tempfile.TemporaryDirectory(prefix="memory-") as place:
        here = Path(place)
        peaks = {
            count: peak_of_run(small_frames(here / f"{count}", count), here / f"out_{count}", "-j", 2)
            for count in dict.fromkeys((FEW, options.frames))
        }
        ratio = peaks[options.frames] / peaks[FEW]
        told = ", ".join(f"{count:,} frames {peak / 1e6:.1f} MB" for count, peak in peaks.items())
        print(f"{told}: {ratio:.3f} times as much (asked: {MOST_RATIO} or less)", flush=True)
        sound = sound and ratio <= MOST_RATIO
        if options.side:
            large = large_frame(here / "large", options.side)
            for model in options.models.split(","):
                peak = peak_of_run(large, here / f"out_{model}", "-j", 1, "--mpi-model", model)
                print(
                    f"a frame of {options.side} × {options.side}, {model}: {peak / 1e9:.2f} GB (asked: 1 GB or less)",
                    flush=True,
                )
                sound = sound and peak <= MOST_BYTES
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(run())
