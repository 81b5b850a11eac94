"""Waits for the end of processes that a test has killed: it takes some time until a killed process is gone."""

import time
from collections.abc import Callable
from pathlib import Path


def alive(pid: int) -> bool:
    """Return True if a process can still do anything; a zombie, whose parent has not waited for it, cannot."""
    state = _stat(str(pid))
    return bool(state) and state[0] not in "ZX"


def nobody_left(pids: list[int], within: float) -> bool:
    """Wait for processes to end, `within` seconds at most; return True if all have ended."""
    return _comes_true(lambda: not any(map(alive, pids)), within)


def session_is_over(leader: int, within: float) -> bool:
    """Wait for all processes of a session, `within` seconds at most; return True if all have ended."""
    return _comes_true(lambda: not any(_lives_in(leader, place.name) for place in Path("/proc").glob("[0-9]*")), within)


def _lives_in(session: int, pid: str) -> bool:
    state = _stat(pid)
    return bool(state) and state[3] == str(session) and state[0] not in "ZX"


def _stat(pid: str) -> list[str]:
    """Return state, parent, group, session and more of a process, or an empty list if there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return []


def _comes_true(holds: Callable[[], bool], within: float) -> bool:
    until = time.monotonic() + within
    while not holds() and time.monotonic() < until:
        time.sleep(0.02)
    return holds()
