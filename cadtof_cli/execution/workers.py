"""Worker processes that end with their parent and never answer Ctrl-C themselves."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Literal

StartMethod = Literal["fork", "spawn", "forkserver"]

START_METHODS: tuple[StartMethod, ...] = ("fork", "spawn", "forkserver")


def available_cores() -> int:
    """Return how many cores this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def default_start_method() -> StartMethod:
    """Return `fork` on Linux, where it is safe before any thread runs and starts in milliseconds; else `spawn`."""
    return "fork" if os.uname().sysname == "Linux" else "spawn"


@contextmanager
def worker_pool(jobs: int, start_method: StartMethod) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of `jobs` processes; leaving by an exception abandons their work and ends them at once.

    The workers hold one end of a pipe whose other end lives here: it closes then, and also when this process is killed,
    so that no worker outlives it.
    """
    context = multiprocessing.get_context(start_method)
    listening, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin, initargs=(listening, held))
    try:
        yield pool
    except BaseException:
        held.close()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        held.close()
        listening.close()


def _begin(listening: Connection, held: Connection) -> None:
    """Prepare a worker: Ctrl-C is the parent's to handle, and the parent's end is ours too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    held.close()
    threading.Thread(target=_end_with_parent, args=(listening,), daemon=True).start()


def _end_with_parent(listening: Connection) -> None:
    try:
        listening.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)
