"""Tables as docs/solvers.md shows them, and times."""

import time
from collections.abc import Callable


def table(*columns: str) -> None:
    print(f"\n| {' | '.join(columns)} |\n|{'|'.join('---' for _ in columns)}|", flush=True)


def row(*cells: object) -> None:
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def seconds(run: Callable[[], object]) -> float:
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def processor_seconds(run: Callable[[], object]) -> float:
    began = time.process_time()
    run()
    return time.process_time() - began
