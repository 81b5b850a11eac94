"""Make small changes of meaning to the package, one at a time, and count how many of them no test notices."""

import argparse
import importlib
import itertools
import json
import math
import multiprocessing
import os
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path

from mutation.calls import Calls
from mutation.mutants import PACKAGE, Mutant, all_mutants, drawn
from mutation.named import Change, GoneError, changed_files, killer, read_changes
from mutation.runs import INNER, KERNEL_LIBRARY, Bench, Outcome

ROOT = Path(__file__).resolve().parent.parent

ROOMS = ("optics", "phasors", "resolver", "maps", "calibration", "simulation")

NAMED = Path(__file__).with_name("mutation") / "named.toml"

EQUIVALENT = Path(__file__).with_name("mutation") / "equivalent.toml"

IMPORTED = ("numpy", "scipy.optimize", "scipy.stats", "scipy.integrate", "hypothesis", "tifffile", "OpenEXR", "click")
"""Libraries that are imported before the forks. Every fork imports the package itself anew."""

Key = tuple[str, str, str, str]


def main() -> None:
    """Draw mutants, try them, and report; exit with 1 if fewer are killed than asked."""
    arguments = _arguments()
    if arguments.named is not None:
        sys.exit(_try_named([change for change in read_changes(NAMED) if arguments.named in change.name]))
    places = all_mutants(ROOT, arguments.room or ROOMS)
    known = _equivalent(EQUIVALENT)
    _note_stale(known, places, arguments.room or ROOMS)
    chosen = _named(places, arguments.again) if arguments.again else drawn(places, arguments.count, arguments.seed)
    if not chosen:
        sys.exit("no mutant to try: the code has none of those that --again names")
    print(f"{len(chosen)} mutants of {len(places)} places, seed {arguments.seed}", file=sys.stderr)
    outcomes = []
    for number, outcome in enumerate(_outcomes(chosen, arguments.jobs, arguments.most_seconds), start=1):
        outcomes.append(outcome)
        _tell(number, len(chosen), outcome, known)
    rate = _report(outcomes, known)
    _write_survivors(arguments.survivors, outcomes, known)
    sys.exit(rate < arguments.least)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=400, help="mutants to draw [default: 400]")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw [default: 1]")
    parser.add_argument(
        "--room",
        action="append",
        help="a room of the package; may be given several times [default: the six inner rooms]",
    )
    parser.add_argument(
        "--jobs", type=int, default=len(os.sched_getaffinity(0)), help="number of processes [default: all cores]"
    )
    parser.add_argument(
        "--most-seconds",
        type=float,
        default=math.inf,
        help="processor time of a mutant's tests: the slower tests beyond it are left out [default: no limit]",
    )
    parser.add_argument(
        "--least",
        type=float,
        default=0.9,
        help="share of mutants that must be killed; below it, exit with 1 [default: 0.9]",
    )
    parser.add_argument(
        "--survivors", type=Path, default=ROOT / "out" / "mutants.jsonl", help="file for the mutants that survive"
    )
    parser.add_argument("--again", type=Path, help="try the mutants of such a file instead of drawing")
    parser.add_argument(
        "--named",
        nargs="?",
        const="",
        metavar="PART",
        help="make the changes of scripts/mutation/named.toml instead, one at a time; PART: only those with PART in their names",
    )
    return parser.parse_args()


def _try_named(changes: Sequence[Change]) -> bool:
    """Make every change alone, print which test notices it, and return whether a change goes unnoticed."""
    _require_texts(changes)
    for name in IMPORTED:
        importlib.import_module(name)
    killers: dict[bool, set[str]] = {False: set(), True: set()}
    unnoticed = 0
    with tempfile.TemporaryDirectory(prefix="mutants-") as place:
        bench = Bench(ROOT, _folder(Path(place)))
        compiled = any((ROOT / PACKAGE).rglob(KERNEL_LIBRARY))
        for change in changes:
            for kernel in (False, True) if compiled and change.kernel else (False,):
                found = killer(bench, change, kernel=kernel)
                unnoticed += not found
                where = "kernel" if kernel else "numpy" if change.kernel else "python"
                print(f"{change.name} [{where}]: {found or 'NO TEST FAILS'}", flush=True)
                killers[kernel] |= {found} - {""}
        for kernel, tests in killers.items():
            with bench.changed({}, kernel=kernel):
                if tests and (failed := bench.failing(sorted(tests))):
                    raise SystemExit(f"{failed} fails without any change")
    print(f"{len(changes)} changes, {unnoticed} of them unnoticed; without any, the tests named here pass")
    return unnoticed > 0


def _require_texts(changes: Sequence[Change]) -> None:
    """Make sure, before any test runs, that every text that is to be replaced stands in the package."""
    gone = []
    for change, kernel in itertools.product(changes, (False, True)):
        try:
            changed_files(ROOT, change, kernel=kernel)
        except GoneError as error:
            gone.append(str(error))
    if gone:
        raise SystemExit("\n".join(gone))


def _outcomes(chosen: Sequence[Mutant], jobs: int, most_s: float) -> Iterator[Outcome]:
    """Yield the outcomes of the mutants, in the order in which they end."""
    for name in IMPORTED:
        importlib.import_module(name)
    rooms = tuple(sorted({mutant.room for mutant in chosen}))
    with tempfile.TemporaryDirectory(prefix="mutants-") as place:
        # what a command says without the compiled kernel is another text
        kernel = INNER.isdisjoint(rooms)
        calls = Bench(ROOT, _folder(Path(place)), kernel=kernel).watched(rooms)
        context = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(
            jobs, context, initializer=_start, initargs=(Path(place), calls, most_s, kernel)
        ) as pool:
            left = []
            for done in as_completed([pool.submit(_try, mutant, quick=True) for mutant in chosen]):
                if done.result().verdict == "survived":
                    left.append(done.result().mutant)
                else:
                    yield done.result()
            bench = Bench(ROOT, _folder(Path(place)), calls, most_s, kernel=kernel)
            left.sort(key=lambda mutant: bench.seconds(mutant, quick=False))
            print(f"{len(left)} of {len(chosen)} are left for the slower tests", file=sys.stderr)
            for done in as_completed([pool.submit(_try, mutant, quick=False) for mutant in left]):
                yield done.result()


_benches: list[Bench] = []
"""The bench of this worker process."""


def _start(place: Path, calls: Calls, most_s: float, kernel: bool) -> None:
    _benches.append(Bench(ROOT, _folder(place), calls, most_s, kernel=kernel))


def _folder(place: Path) -> Path:
    """Make a folder for this process alone."""
    own = Path(tempfile.mkdtemp(dir=place))
    own.chmod(0o755)
    return own


def _try(mutant: Mutant, *, quick: bool) -> Outcome:
    return _benches[0].tried(mutant, quick=quick)


def _equivalent(path: Path) -> dict[Key, str]:
    """Return, for known survivors, the reason why they change nothing that can be seen, by the key of the mutant."""
    entries = tomllib.loads(path.read_text(encoding="utf-8")).get("mutant", [])
    return {(e["room"], e["function"], e["before"], e["after"]): e["reason"] for e in entries}


def _note_stale(known: dict[Key, str], places: Sequence[Sequence[Mutant]], rooms: Sequence[str]) -> None:
    there = {mutant.key for group in places for mutant in group}
    for key in known:
        if key[0] in rooms and key not in there:
            print(f"{EQUIVALENT.name}: no such mutant any more: {' | '.join(key)}", file=sys.stderr)


def _named(places: Sequence[Sequence[Mutant]], path: Path) -> list[Mutant]:
    keys = {tuple(json.loads(line)[name] for name in ("room", "function", "before", "after")) for line in path.open()}
    return [mutant for group in places for mutant in group if mutant.key in keys]


def _verdict(outcome: Outcome, known: dict[Key, str]) -> str:
    return "equivalent" if outcome.verdict == "survived" and outcome.mutant.key in known else outcome.verdict


def _tell(number: int, count: int, outcome: Outcome, known: dict[Key, str]) -> None:
    mutant = outcome.mutant
    verdict = _verdict(outcome, known)
    line = f"{number:4}/{count} {verdict:10} {outcome.seconds:5.1f} s  {mutant.path} {mutant.function}"
    if verdict == "survived":
        line += f"\n      - {mutant.before}\n      + {mutant.after}"
    print(line, file=sys.stderr)


def _report(outcomes: Sequence[Outcome], known: dict[Key, str]) -> float:
    """Print a line per room, and return the share of all mutants that were killed; equivalent mutants count as not killed."""
    print(f"{'room':<14}{'mutants':>8}{'killed':>8}{'endless':>8}{'equivalent':>12}{'survived':>10}{'killed':>9}")
    rooms = sorted({outcome.mutant.room for outcome in outcomes})
    rate = 0.0
    for room in [*rooms, "all"]:
        counts = Counter(_verdict(o, known) for o in outcomes if room in {o.mutant.room, "all"})
        total = counts.total()
        rate = (counts["killed"] + counts["endless"]) / max(total, 1)
        numbers = (
            f"{total:>8}{counts['killed']:>8}{counts['endless']:>8}{counts['equivalent']:>12}{counts['survived']:>10}"
        )
        print(f"{room:<14}{numbers}{rate:>9.1%}")
    return rate


def _write_survivors(path: Path, outcomes: Sequence[Outcome], known: dict[Key, str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        for outcome in outcomes:
            if outcome.verdict == "survived":
                mutant = outcome.mutant
                record = {"room": mutant.room, **asdict(mutant), "reason": known.get(mutant.key)}
                file.write(json.dumps(record, ensure_ascii=False) + "\n")
    print(f"survivors in {path}", file=sys.stderr)


if __name__ == "__main__":
    main()
