"""Measure speed and memory of cadtof.

It prints ratios of things measured side by side in one run: absolute times mean little.
"""

import argparse
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_kernel import diffuse_rows, kernel_rows, recorded, triangle_rows
from speed.against import CASES, MEMORY, against
from speed.measure import ROOT, Row, least_seconds
from speed.paper_way import paper_way
from speed.runs import end_to_end, memory, start_up

from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths

SCIPY_PIXELS = 300

SLOT_PIXELS, SLOT_FRAMES = 10, 5
"""Pixels that scipy solves, and frames that cadtof resolves, in one slot; the slots take turns. Both slots take
about the same time. They are so short that the processor keeps its speed from one to the next."""


def main() -> None:
    """Print the table, each row as soon as it is measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "parts",
        nargs="*",
        help=f"which of {', '.join(PARTS)}; with --against which of {', '.join(COMPARED)} [default: all]",
    )
    parser.add_argument("--against", metavar="REF", help="compare this working tree with a commit")
    parser.add_argument("--repeats", type=int, default=3, help="number of turns; the shortest time of each side counts")
    parser.add_argument("--long", type=int, default=1000, help="number of frames of the memory part")
    parser.add_argument(
        "--place", type=Path, help="folder below which the runs write [default: that of temporary files]"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file")
    arguments = parser.parse_args()
    known = COMPARED if arguments.against else PARTS
    unknown = [name for name in arguments.parts if name not in known]
    if unknown:
        parser.error(f"parts: found {', '.join(unknown)}, expected some of {', '.join(known)}")
    keep_freed_memory()
    rows: list[Row] = []
    print("| what | asked | measured |\n|---|---|---|", flush=True)
    for row in _rows(arguments):
        rows.append(row)
        print(row.as_markdown(), flush=True)
        if arguments.json:
            arguments.json.write_text(json.dumps([asdict(one) for one in rows], indent=2, ensure_ascii=False) + "\n")


def _rows(arguments: argparse.Namespace) -> Iterator[Row]:
    for part in [_against] if arguments.against else [PARTS[name] for name in arguments.parts or PARTS]:
        with tempfile.TemporaryDirectory(dir=arguments.place) as place:
            yield from part(arguments, Path(place).resolve())


def _against(arguments: argparse.Namespace, place: Path) -> Iterator[Row]:
    yield from against(arguments.against, place, arguments.repeats, cases=arguments.parts or COMPARED)


def _each(work: Callable[..., Any], of: Sequence[tuple[Any, ...]]) -> list[Any]:
    return [work(*one) for one in of]


def closed_form(arguments: argparse.Namespace, _place: Path) -> Iterator[Row]:
    """Measure a frame from voltages to maps against the paper's solver: time per pixel on one core, and wrong pixels.

    Slots of pixels (scipy) and of frames (cadtof) take turns. scipy begins from the same starts in every turn. The
    shortest time of each slot counts.
    """
    rng, size = np.random.default_rng(9), SCIPY_PIXELS
    a, b = np.full(size, 1 / 6.3), np.where(np.arange(size) < size // 2, 0.3 / 6.3, 0.0)
    x, y = rng.uniform(0, np.pi, size), rng.uniform(1.2, 2 * np.pi - 1.2, size)
    noise = rng.normal(scale=1 / (2 * np.sqrt(1e5)), size=(2, size, 2)) @ np.array([1, 1j])
    p1, p2 = (a * np.exp(1j * h * x) + b * np.exp(1j * h * (x + y)) + noise[h - 1] for h in (1, 2))
    stored, plan = recorded(ROOT / "sample_data" / "corner")
    pixels = list(zip(p1, p2, rng.uniform(-1, 1, (size, 10, 2)), strict=True))
    works: dict[str, Callable[[], object]] = {}
    for start in range(0, size, SLOT_PIXELS):
        works[f"scipy {start}"] = partial(_each, paper_way, pixels[start : start + SLOT_PIXELS])
        works[f"ours {start}"] = partial(_each, partial(resolve_frame, plan=plan), [(stored,)] * SLOT_FRAMES)
    times = least_seconds(works, 4 * arguments.repeats)
    paper, ours = (sum(taken for name, taken in times.items() if name.startswith(side)) for side in ("scipy", "ours"))
    paper, ours = paper / size, ours / (size / SLOT_PIXELS * SLOT_FRAMES * stored[0, 0].size)
    ratio, found = paper / ours, _each(paper_way, pixels)
    yield Row(
        "closed form, voltages to maps, times faster per pixel than ten starts of `scipy.optimize.leastsq` on Eq. (9)",
        "≥ 40,000",
        f"{ratio:,.0f} ({paper * 1e6:.0f} µs and {ours * 1e9:.1f} ns)",
        (ratio, paper, ours),
    )
    with np.errstate(all="ignore"):
        two = two_paths(fundamental_frame(p1, p2))
    answers = list(zip(two.a * (two.cos_x + 1j * two.sin_x), two.b * (two.cos_y + 1j * two.sin_y), strict=True))

    def wrong(answers: list[tuple[complex, complex]], pixels: slice) -> int:
        residuals = [
            max(abs(a + b - q1), abs(a * a / abs(a) + b * b / abs(b) - q2)) if a and b else abs(a + b - q1)
            for (a, b), q1, q2 in zip(answers[pixels], p1[pixels], p2[pixels], strict=True)
        ]
        return int(sum(residual > 1e-6 for residual in residuals))

    halves = (slice(0, size // 2), slice(size // 2, size))
    counts = [wrong(one, half) for one in (found, answers) for half in halves]
    yield Row(
        f"… pixels that each gets wrong, of {size // 2} with and {size // 2} without MPI",
        None,
        f"{counts[0]} and {counts[1]} (scipy), {counts[2]} and {counts[3]}",
        tuple(counts),
    )


def _end_to_end(arguments: argparse.Namespace, place: Path) -> Iterator[Row]:
    yield from end_to_end(place, arguments.repeats, 200)
    # some rows measure time on the clock, which other work on the machine lengthens: every command needs a quiet moment,
    # hence twice the turns
    yield from end_to_end(place, 2 * arguments.repeats, 1000)


COMPARED = [*CASES, MEMORY]

PARTS: dict[str, Callable[[Any, Path], Iterator[Row]]] = {
    "closed-form": closed_form,
    "kernel": lambda arguments, _: kernel_rows(10 * arguments.repeats),
    "diffuse": lambda arguments, _: diffuse_rows(10 * arguments.repeats),
    "triangle": lambda arguments, place: triangle_rows(place, 2 * arguments.repeats),
    "end-to-end": _end_to_end,
    "start-up": lambda arguments, place: start_up(place, arguments.repeats),
    "memory": lambda arguments, place: memory(place, arguments.long),
}

if __name__ == "__main__":
    main()
