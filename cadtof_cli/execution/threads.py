"""Starts threads. `threading.Thread.start` would wait without end for a thread that lacks the memory to begin."""

import _thread
import sys
import threading
from collections.abc import Callable

BEGINS_S = 1.0
"""Longest wait for the first step of a new thread. A thread without memory ends before it, and tells nobody."""


def begin_thread(work: Callable[[], None], /) -> _thread.LockType | None:
    """Call `work` in a new thread.

    The end of the process does not wait for the thread.

    Returns:
        A lock that can be acquired as soon as `work` has ended. None if the system allows no more threads or memory: then
        `work` is never called.
    """
    begun, turn, ended = _thread.allocate_lock(), _thread.allocate_lock(), _thread.allocate_lock()
    begun.acquire()
    ended.acquire()
    trace, profile = threading.gettrace(), threading.getprofile()

    def run() -> None:
        if not turn.acquire(blocking=False):
            # it comes too late
            return
        begun.release()
        # what `threading` does for its threads: a debugger or a count of calls may want it
        sys.settrace(trace)
        sys.setprofile(profile)
        try:
            work()
        finally:
            ended.release()

    try:
        _thread.start_new_thread(run, ())
    except RuntimeError:
        return None
    return ended if begun.acquire(timeout=BEGINS_S) or not turn.acquire(blocking=False) else None
