"""How a worker process starts, on its parent's side and on its own: it ends with its parent, and never answers Ctrl-C itself."""

import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

HANGUP: signal.Signals | None = getattr(signal, "SIGHUP", None)
"""What a terminal that goes away sends; None where the system knows nothing of it, as on Windows."""

_HELD_BACK = (signal.SIGINT, signal.SIGTERM) + ((HANGUP,) if HANGUP else ())

_PR_SET_PDEATHSIG = 1

_SAFE_PATH = "PYTHONSAFEPATH"


def cores_for(processes: int, /) -> tuple[int, ...]:
    """Return a core for each of so many processes, where that is one for every core there is; else none.

    A system moves processes from core to core, each time away from what the caches of one hold, where threads that wait for disks
    wake up between them. Where all cores are taken, nothing is gained by that; where some are not, it may be needed.
    """
    cores = tuple(sorted(os.sched_getaffinity(0))) if hasattr(os, "sched_getaffinity") else ()
    return cores if len(cores) == processes else ()


@contextmanager
def signals_held_back() -> Iterator[None]:
    """Put off what ends us while processes may start: until it has come to `begin_worker`, one would answer like its parent.

    Where signals cannot be put off, as on Windows, nothing is.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _HELD_BACK)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def current_folder_left_out() -> Iterator[None]:
    """Let processes that start import nothing from the current folder, where a file may be called like a module of Python's."""
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
    """Prepare a worker: Ctrl-C and a terminal that goes away are the parent's to handle; SIGTERM, and the parent's end, end it.

    Args:
        listening: the end of a pipe that gives way when the parent ends.
        held: the parent's end of it, of which a forked worker has a copy.
        core: that it stays on; None: it may be moved.
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
            # it may have been taken away from us
            os.sched_setaffinity(0, {core})
    if sys.platform == "linux":
        import ctypes

        # even where it is stopped
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    with suppress(RuntimeError):
        # the system may allow no more threads
        threading.Thread(target=_end_with_parent, args=(listening,), daemon=True).start()
    # what was here before the fork stays shared with the parent: nobody writes marks into it
    gc.freeze()


def _end_with_parent(listening: "Connection") -> None:
    try:
        listening.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)
