"""The compiled two-path kernel beside its numpy reference, in one process, in turns: ms per frame, and bits that differ."""

import argparse
import os
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import open_frames
from cadtof_cli.execution.workers import keep_freed_memory
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.pipeline import resolve_frame
from cadtof_cli.resolver.two_path.kernel import NUMPY, available_kernels

SAMPLES = Path(__file__).resolve().parent.parent / "sample_data"

ASKED = {("corner", "avx2"): 5.0, ("corner", "avx512"): 6.0, ("wall", "avx2"): 6.0, ("wall", "avx512"): 8.0}
"""How many times faster than numpy: two paths in most pixels, and one path everywhere."""


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=30, help="turns that are taken; the best of each kernel counts")
    arguments = parser.parse_args()
    keep_freed_memory()
    print(f"{'':18}{'kernel':>8}{'ms':>9}{'x numpy':>9}{'asked':>7}{'words that differ':>19}")
    for capture in sorted(path for path in SAMPLES.iterdir() if path.is_dir()):
        stored, plan = recorded(capture)
        works = {kernel: partial(resolve_frame, stored, plan=plan, kernel=kernel) for kernel in available_kernels()}
        times = in_turns(works, arguments.repeats)
        for kernel in works:
            asked = ASKED.get((capture.name, kernel))
            print(
                f"{capture.name:18}{kernel:>8}{times[kernel] * 1e3:9.2f}{times[NUMPY] / times[kernel]:9.1f}"
                f"{'' if asked is None else f'>= {asked:g}':>7}{differing(stored, plan, kernel):19}"
            )


def recorded(folder: Path) -> tuple[Stored, FramePlan]:
    """Return the first frame of a capture, and what to do with it."""
    capture = find_captures([folder], overrides={})[0]
    with open_frames(capture.frames[0], capture.layout) as frames:
        return frames.read(0), FramePlan(metadata=capture.source.metadata)


def in_turns(works: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the least CPU time of each, in s: what else the machine does strikes all alike."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            began = time.thread_time()
            work()
            times[name].append(time.thread_time() - began)
    return {name: min(found) for name, found in times.items()}


def differing(stored: Stored, plan: FramePlan, kernel: str) -> int:
    """Return how many 32-bit words of a frame's maps differ from numpy's."""
    ours, numpys = (resolve_frame(stored, plan=plan, kernel=one).maps for one in (kernel, NUMPY))
    words = (ours.values.view(np.uint32) != numpys.values.view(np.uint32)).sum()
    return int(words + (ours.status != numpys.status).sum())


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
