"""How a worker process starts, in its parent and in itself. It ends when its parent ends, and it ignores Ctrl-C."""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING

from cadtof_cli.execution.outcome import begin_thread

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

HANGUP: signal.Signals | None = getattr(signal, "SIGHUP", None)
"""The signal of a terminal that goes away; None if the system does not have it, as on Windows."""

_HELD_BACK = (signal.SIGINT, signal.SIGTERM) + ((HANGUP,) if HANGUP else ())

_PR_SET_PDEATHSIG = 1

_SAFE_PATH = "PYTHONSAFEPATH"


def cores_for(processes: int, /) -> tuple[int, ...]:
    """Return one core for each process if there are as many processes as cores; else an empty tuple.

    When threads that wait for disks wake up, the system moves processes to other cores, and each time a process loses what the
    caches of its core hold. If every core has a process, such a move gains nothing. If some cores are free, it may be needed.
    """
    cores = tuple(sorted(os.sched_getaffinity(0))) if hasattr(os, "sched_getaffinity") else ()
    return cores if len(cores) == processes else ()


@contextmanager
def signals_held_back(start_method: str, /) -> Iterator[None]:
    """Hold back the signals that end this process while a worker starts; do nothing if the system cannot, as on Windows.

    Until a worker has reached `begin_worker`, it would handle these signals like its parent.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    if start_method != "fork":
        from multiprocessing import resource_tracker

        # Python starts this helper with the first worker, and then lets the signals through again
        resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _HELD_BACK)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def current_folder_left_out() -> Iterator[None]:
    """Keep starting processes from importing files of the current folder, which may have the name of a standard module."""
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before


def begin_worker(listening: "Connection", held: "Connection", core: int | None, /) -> None:
    """Prepare a worker: SIGTERM ends it, and so does the end of its parent; Ctrl-C and the end of a terminal are for the parent.

    Args:
        listening: the worker's end of a pipe; a read from it fails when the parent ends.
        held: the parent's end of the pipe, of which a forked worker has a copy.
        core: the core that the worker stays on; None: the system may move it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if HANGUP:
        signal.signal(HANGUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _HELD_BACK)
    held.close()
    if core is not None and hasattr(os, "sched_setaffinity"):
        with suppress(OSError):
            # this process may have lost the core since
            os.sched_setaffinity(0, {core})
    if sys.platform == "linux":
        import ctypes

        # the kernel kills the worker when its parent ends, even if the worker is stopped (SIGSTOP)
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    begin_thread(partial(_end_with_parent, listening), [])
    # objects from before the fork stay in memory that is shared with the parent: the garbage collector no longer writes into them
    gc.freeze()


def _end_with_parent(listening: "Connection") -> None:
    try:
        listening.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)
