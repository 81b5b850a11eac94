"""Processes that a test has killed, and whether they are gone: a kill is an order, which takes its time."""

import time
from collections.abc import Callable
from pathlib import Path


def alive(pid: int) -> bool:
    """Whether a process can still do anything; one that only nobody has waited for cannot."""
    state = _stat(str(pid))
    return bool(state) and state[0] not in "ZX"


def nobody_left(pids: list[int], within: float) -> bool:
    """Wait for processes to end; return whether they have, after so many seconds at most."""
    return _comes_true(lambda: not any(map(alive, pids)), within)


def session_is_over(leader: int, within: float) -> bool:
    """Wait for whatever was started in a session, by its leader or by others; return whether all of it has ended."""
    return _comes_true(lambda: not any(_lives_in(leader, place.name) for place in Path("/proc").glob("[0-9]*")), within)


def _lives_in(session: int, pid: str) -> bool:
    state = _stat(pid)
    return bool(state) and state[3] == str(session) and state[0] not in "ZX"


def _stat(pid: str) -> list[str]:
    """Return state, parent, group, session and more of a process, or nothing when there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return []


def _comes_true(holds: Callable[[], bool], within: float) -> bool:
    until = time.monotonic() + within
    while not holds() and time.monotonic() < until:
        time.sleep(0.02)
    return holds()
