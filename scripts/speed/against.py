"""Compare two commits: CPU time of `cadtof resolve` per frame without the start-up, CPU time of one frame, and memory."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from speed.measure import ENVIRONMENT, ROOT, Row, capture_of, in_turns, resolve
from speed.runs import peak

MPI_MODEL = "--mpi-model"

DISCRETE = (MPI_MODEL, "discrete")


@dataclass(frozen=True)
class Case:
    """A kind of run.

    Attributes:
        options: options of `resolve`; a commit may lack some of them.
        frames: as many frames as take a second or so.
        scene: options of `simulate` for the frames; without any, they are copies of a sample.
        asked: the goal.
        environment: variables for the run.
    """

    options: tuple[str, ...]
    frames: int
    scene: tuple[str, ...] = ()
    asked: str | None = None
    environment: tuple[tuple[str, str], ...] = ()


THREE_HARMONICS = ("--periods-ns", "40,20,13.3333333333")

CASES = {
    "two paths": Case(DISCRETE, 100),
    "two paths by numpy": Case(DISCRETE, 20, asked="≤ 2", environment=(("CADTOF_KERNEL", "numpy"),)),
    "diffuse MPI": Case((), 10),
    "triangle waves": Case((*DISCRETE, "--waveform", "triangle"), 6, asked="≤ 1"),
    "triangle waves, diffuse MPI": Case((), 6, ("--waveform", "triangle")),
    "likelihood, three harmonics": Case(DISCRETE, 4, THREE_HARMONICS, asked="≤ 0.33"),
    "three paths": Case((*DISCRETE, "--paths", "3"), 2, THREE_HARMONICS, asked="≤ 0.33"),
    "lm": Case((*DISCRETE, "--solver", "lm"), 4, asked="≤ 0.33"),
    "lm, three harmonics": Case((*DISCRETE, "--solver", "lm"), 1, THREE_HARMONICS),
    "pooling 3 × 3": Case((*DISCRETE, "--pool", "3"), 12, asked="≤ 0.33"),
    "pooling 5 × 5": Case((*DISCRETE, "--pool", "5"), 6, asked="≤ 0.33"),
}


MEMORY, MEMORY_FRAMES = "memory", 300


def against(reference: str, place: Path, repeats: int, *, cases: list[str]) -> Iterator[Row]:
    """Measure this working tree and a commit in some cases; rows hold the time of this tree over that of the commit."""
    trees = {"this": ROOT, "that": _installed(reference, place)}
    known = {name: _help(tree) for name, tree in trees.items()}
    out = place / "out"
    for what in cases:
        if what == MEMORY:
            yield _memory(reference, place, {name: _understood(DISCRETE, told) for name, told in known.items()}, trees)
            continue
        case = CASES[what]
        captures = [_capture(case, place / f"{what} {count}", count) for count in (1, 1 + case.frames)]
        commands = {}
        for name, tree in trees.items():
            options = _understood(case.options, known[name])
            environment = {**dict(case.environment), "PYTHONPATH": str(tree)}
            for capture in captures:
                commands[f"{name} {capture.name}"] = resolve(capture, out, *options, "-j", "1", environment=environment)
        costs = in_turns(commands, repeats)
        per_frame, start = {}, {}
        for name in trees:
            one, many = (costs[f"{name} {capture.name}"].cpu_s for capture in captures)
            per_frame[name], start[name] = (many - one) / case.frames, one
        for capture in captures:
            shutil.rmtree(capture)
        ratio = per_frame["this"] / per_frame["that"]
        measured = f"{ratio:.2f} ({per_frame['this'] * 1e3:.1f} and {per_frame['that'] * 1e3:.1f} ms)"
        yield Row(f"{what}: CPU time per frame over that of {reference}", case.asked, measured, (ratio,))
        ratio = start["this"] / start["that"]
        yield Row("… of a run of one frame", None, f"{ratio:.2f}", (ratio,))


def _memory(reference: str, place: Path, options: Mapping[str, list[str]], trees: Mapping[str, Path]) -> Row:
    """Return the row of peak memory: two jobs, all processes together."""
    capture, out = capture_of(place / MEMORY, MEMORY_FRAMES), place / "out"
    this, that = (
        peak(resolve(capture, out, *options[name], "-j", "2", environment={"PYTHONPATH": str(tree)}))
        for name, tree in trees.items()
    )
    what = f"peak memory of the process tree, two jobs, {MEMORY_FRAMES} frames, over that of {reference}"
    return Row(what, "≤ 1", f"{this / that:.2f} ({this / 1e6:.0f} and {that / 1e6:.0f} MB)", (this / that, this, that))


def _installed(reference: str, place: Path) -> Path:
    """Install a commit into a folder of its own, with its compiled modules, and return the folder."""
    source, target = place / "source", place / "that"
    source.mkdir()
    archive = subprocess.run(["git", "-C", str(ROOT), "archive", reference], check=True, stdout=subprocess.PIPE)
    subprocess.run(["tar", "-x", "-C", str(source)], input=archive.stdout, check=True)
    pip = ["uv", "pip"] if shutil.which("uv") else [sys.executable, "-m", "pip"]
    python = ["--python", sys.executable] if pip[0] == "uv" else []
    command = [*pip, "install", "--quiet", *python, "--no-deps", "--target", str(target), str(source)]
    subprocess.run(command, check=True, env={**os.environ, "CC": os.environ.get("CC", "cc")})
    return target


def _help(tree: Path) -> str:
    command = [sys.executable, "-m", "cadtof_cli", "resolve", "--help"]
    environment = {**ENVIRONMENT, "PYTHONPATH": str(tree)}
    return subprocess.run(command, env=environment, cwd=tree, check=True, capture_output=True, text=True).stdout


def _understood(options: tuple[str, ...], help_text: str) -> list[str]:
    """Return the options that a commit knows by its help; each has a value."""
    pairs = zip(options[::2], options[1::2], strict=True)
    return [word for name, value in pairs if name in help_text for word in (name, value)]


def _capture(case: Case, folder: Path, frames: int) -> Path:
    if not case.scene:
        return capture_of(folder, frames)
    sample = folder.with_name(" ".join(case.scene))
    if not sample.exists():
        words = [sys.executable, "-m", "cadtof_cli", "simulate", "--scene", "corner", "-o", str(sample), *case.scene]
        subprocess.run(words, env={**ENVIRONMENT, "PYTHONPATH": str(ROOT)}, check=True, capture_output=True)
    return capture_of(folder, frames, sample=sample)
