"""Starts threads. `threading.Thread.start` would wait without end for a thread that lacks the memory to begin."""

import _thread
import sys
import threading
from collections.abc import Callable

BEGINS_S = 1.0
"""Longest wait for the first step of a new thread. A thread without memory ends before it, and tells nobody."""


def begin_thread(work: Callable[[], None], ends: list[_thread.LockType], /) -> bool:
    """Call `work` in a new thread, and return whether it began. If the system allows no more threads or memory, it never will.

    The end of the process does not wait for the thread. `ends` gets a lock, which the thread holds while it works: whoever
    acquires the lock waits for the end of the work, or keeps it from beginning. The lock is in the list before there is a
    thread, because an exception by a signal may end this function at any step.
    """
    begun, end = _thread.allocate_lock(), _thread.allocate_lock()
    begun.acquire()
    trace, profile = threading.gettrace(), threading.getprofile()

    def run() -> None:
        if not end.acquire(blocking=False):
            # it comes too late
            return
        begun.release()
        # what `threading` does for its threads: a debugger or a count of calls may want it
        sys.settrace(trace)
        sys.setprofile(profile)
        try:
            work()
        finally:
            end.release()

    ends.append(end)
    try:
        _thread.start_new_thread(run, ())
        if begun.acquire(timeout=BEGINS_S) or not end.acquire(blocking=False):
            return True
    except RuntimeError:
        pass
    ends.remove(end)
    return False
