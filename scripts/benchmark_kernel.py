"""Measure compiled kernels beside numpy, in turns in one process: ms per frame, and 32-bit words of the maps that differ."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from speed.measure import Row, least_seconds

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import read_stored
from cadtof_cli.pipeline.frame import prepare_frame, resolve_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.kernels import NUMPY, available_kernels
from cadtof_cli.resolver.settings import MpiModel, ResolverSettings
from tests.support.kernels import by_kernel

SAMPLES = Path(__file__).resolve().parent.parent / "sample_data"

ASKED = {("corner", "avx2"): 5.0, ("corner", "avx512"): 6.0, ("wall", "avx2"): 6.0, ("wall", "avx512"): 8.0}
"""How many times faster than numpy a kernel should be, by sample and kernel. `corner` has two paths in most pixels,
`wall` one path everywhere."""

ROOMS = ("corner", "room")
"""Samples with diffuse MPI."""

MOST_MS = 25.0
"""Milliseconds that a frame with diffuse MPI may take in numpy."""


def kernel_rows(repeats: int) -> Iterator[Row]:
    """Measure every kernel that runs here, and numpy, on the first frame of every sample."""
    for capture in sorted(path for path in SAMPLES.iterdir() if path.is_dir()):
        yield from _frame_rows(capture.name, *recorded(capture), repeats)


def diffuse_rows(repeats: int) -> Iterator[Row]:
    """Measure frames with diffuse MPI by every kernel and numpy: the whole frame, and its pixel-by-pixel part alone."""
    for name in ROOMS:
        stored, plan = recorded(SAMPLES / name, mpi_model="auto")
        stages, kernels = stages_of(stored, plan), available_kernels()
        prepared = prepare_frame(stored, stages)
        works: dict[str, Callable[[], object]] = {
            f"pixels {kernel}": partial(by_kernel, kernel, resolve_pixels, prepared, stages) for kernel in kernels
        }
        works |= {f"frame {kernel}": partial(by_kernel, kernel, resolve_frame, stored, plan=plan) for kernel in kernels}
        times = least_seconds(works, repeats)
        for kernel in (one for one in kernels if one != NUMPY):
            ours, numpys = times[f"pixels {kernel}"], times[f"pixels {NUMPY}"]
            other = differing(stored, plan, kernel)
            yield Row(
                f"compiled kernel over numpy, pixels through the tail of diffuse MPI, {name}, {kernel}",
                None,
                f"{numpys / ours:.1f} ({ours * 1e3:.2f} and {numpys * 1e3:.2f} ms), {other} words differ",
                (numpys / ours, ours, numpys, other),
            )
        yield Row(
            f"a frame with diffuse MPI, {name}, voltages to maps, ms: {NUMPY} / {kernels[0]}",
            f"≤ {MOST_MS:g} / -",
            " / ".join(f"{times[f'frame {kernel}'] * 1e3:.1f}" for kernel in (NUMPY, kernels[0])),
            tuple(times[f"frame {kernel}"] for kernel in (NUMPY, kernels[0])),
        )


def triangle_rows(place: Path, repeats: int) -> Iterator[Row]:
    """Measure a frame of triangle waves by every kernel and numpy: resolved with two paths in most pixels, and with
    diffuse MPI."""
    folder = place / "triangle"
    program = Path(sys.executable).with_name("cadtof")
    command = [str(program), "simulate", "--scene", "corner", "--waveform", "triangle", "-o", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    yield from _frame_rows("triangle waves, corner", *recorded(folder), repeats)
    diffuse = recorded(folder, mpi_model="auto")
    yield from _frame_rows("triangle waves with diffuse MPI, corner", *diffuse, repeats)


def _frame_rows(what: str, stored: Stored, plan: FramePlan, repeats: int) -> Iterator[Row]:
    """Measure one frame by every kernel and numpy; `what` is its name in the row and in `ASKED`."""
    works = {kernel: partial(by_kernel, kernel, resolve_frame, stored, plan=plan) for kernel in available_kernels()}
    times = least_seconds(works, repeats)
    for kernel in (name for name in works if name != NUMPY):
        asked, faster = ASKED.get((what, kernel)), times[NUMPY] / times[kernel]
        other = differing(stored, plan, kernel)
        yield Row(
            f"compiled kernel over numpy, {what}, {kernel}",
            None if asked is None else f"≥ {asked:g}",
            f"{faster:.1f} ({times[kernel] * 1e3:.2f} and {times[NUMPY] * 1e3:.2f} ms), {other} words differ",
            (faster, times[kernel], times[NUMPY], other),
        )


def recorded(folder: Path, mpi_model: MpiModel = "discrete") -> tuple[Stored, FramePlan]:
    """Return the first frame of a capture, and the plan by which it is resolved."""
    capture = find_captures([folder], overrides={})[0]
    plan = FramePlan(
        metadata=capture.source.metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model=mpi_model))
    )
    return read_stored(capture.frames[0], capture.layout), plan


def differing(stored: Stored, plan: FramePlan, kernel: str) -> int:
    """Return how many 32-bit words of a frame's maps differ from numpy's."""
    ours, numpys = (by_kernel(one, resolve_frame, stored, plan=plan).maps for one in (kernel, NUMPY))
    words = (ours.values.view(np.uint32) != numpys.values.view(np.uint32)).sum()
    return int(words + (ours.status != numpys.status).sum())
