"""Worker processes that end with their parent, never answer Ctrl-C themselves, and keep the memory they have freed."""

import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from multiprocessing.connection import Connection
from typing import Literal

from cadtof_cli.errors import SettingsError

StartMethod = Literal["fork", "spawn", "forkserver"]

START_METHODS: tuple[StartMethod, ...] = ("fork", "spawn", "forkserver")

LOCAL = "local"

_SCHEDULER = re.compile(r"tcp://[^\s/:]+:\d+|tcp://\[[0-9a-fA-F:]+\]:\d+")

KEPT_BYTES = 16 * 2**20

_HELD_BACK = (signal.SIGINT, signal.SIGTERM)


def available_cores() -> int:
    """Return how many cores this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def default_start_method() -> StartMethod:
    """Return `fork` on Linux, where it is safe before any thread runs and starts in milliseconds; else `spawn`."""
    return "fork" if os.uname().sysname == "Linux" else "spawn"


@dataclass(frozen=True, kw_only=True)
class Workers:
    """What work is done by.

    Attributes:
        jobs: processes; 1 is this one alone.
        start_method: how other processes start.
        scheduler: `local`, or the address of a dask scheduler whose workers do the work instead.
    """

    jobs: int = field(default_factory=available_cores)
    start_method: StartMethod = field(default_factory=default_start_method)
    scheduler: str = LOCAL

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise SettingsError(f"--jobs: found {self.jobs}, expected 1 or more")
        if self.scheduler != LOCAL and not _SCHEDULER.fullmatch(self.scheduler):
            raise SettingsError(f"--scheduler: found {self.scheduler!r}, expected local or tcp://HOST:PORT")

    def at_most(self, tasks: int, /) -> "Workers":
        """Return no more workers than there are tasks."""
        return replace(self, jobs=min(self.jobs, tasks))


ALONE = Workers(jobs=1)
"""This process."""


@contextmanager
def worker_pool(workers: Workers, /) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of processes; leaving by an exception abandons their work and ends them at once.

    The workers hold one end of a pipe whose other end lives here: it closes then, and also when this process is killed,
    so that no worker outlives it.
    """
    context = multiprocessing.get_context(workers.start_method)
    listening, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(workers.jobs, mp_context=context, initializer=_begin, initargs=(listening, held))
    try:
        yield pool
    except BaseException:
        held.close()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        held.close()
        listening.close()


@contextmanager
def signals_held_back() -> Iterator[None]:
    """Put off Ctrl-C and SIGTERM while processes may start: until it has come to `_begin`, one would answer like its parent."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _HELD_BACK)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(listening: Connection, held: Connection) -> None:
    """Prepare a worker: Ctrl-C is the parent's to handle, SIGTERM ends it, and the parent's end is ours too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _HELD_BACK)
    held.close()
    threading.Thread(target=_end_with_parent, args=(listening,), daemon=True).start()


def _end_with_parent(listening: Connection) -> None:
    try:
        listening.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


@cache
def keep_freed_memory() -> None:
    """Let the C library keep the memory of temporary arrays for the next ones; called again, it does nothing.

    A block's arrays are just large enough that glibc asks the system for fresh pages for each and returns them at once: over a
    thousand page faults per frame, a third of the time. It learns otherwise when one larger array is freed: from then on, arrays
    up to that size come from memory that it keeps, and up to twice that much of it. No page of this array is touched.
    """
    import numpy as np

    np.empty(KEPT_BYTES, np.uint8)
