"""Who does the work: processes of this machine, or the workers of a dask scheduler."""

import os
import re
import sys
from dataclasses import field, replace
from typing import Literal

from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.cores import available_cores
from cadtof_cli.records import dataclass, setting

StartMethod = Literal["fork", "spawn", "forkserver"]

START_METHODS: tuple[StartMethod, ...] = ("fork", "spawn", "forkserver") if hasattr(os, "fork") else ("spawn",)
"""How processes can be started on this system."""

START_METHOD: StartMethod = "fork" if sys.platform == "linux" and hasattr(os, "fork") else "spawn"
"""The default: `fork` on Linux, which starts a process in milliseconds and is safe as long as no thread runs; else `spawn`."""

LOCAL = "local"

_SCHEDULER = r"tcp://[^\s/:]+:\d+|tcp://\[[0-9a-fA-F:]+\]:\d+"

LONGEST_S = 1e8
"""Longest time limit, in s: three years. The clocks of operating systems end somewhere beyond that."""

JOBS_PER_CORE = 4
"""Most processes per core that users get: further processes take memory and do not make the work faster."""


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Who does the work: `jobs` processes of this machine, 1 for this process alone, or the workers of a dask scheduler."""

    jobs: int = field(default_factory=available_cores)
    start_method: StartMethod = setting(
        START_METHOD,
        "How Python starts the worker processes.  [default: fork on Linux, spawn elsewhere]",
        show_default=False,
    )
    task_timeout_s: float | None = setting(
        None,
        "Seconds after which a frame counts as failed because it hangs; it is tried twice.",
        option="--frame-timeout",
        metavar="S",
    )
    scheduler: str = setting(
        LOCAL,
        "local: worker processes on this machine. Or the address of a dask scheduler whose workers see the same files; needs "
        "the extra `cluster`.",
        metavar="local|tcp://HOST:PORT",
    )

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise SettingsError(f"--jobs: found {self.jobs}, expected 1 or more")
        if self.start_method not in START_METHODS:
            raise SettingsError(
                f"--start-method: found {self.start_method}, which this system does not have; expected {', '.join(START_METHODS)}"
            )
        if self.task_timeout_s is not None and not 0 < self.task_timeout_s <= LONGEST_S:
            raise SettingsError(
                f"--frame-timeout: found {self.task_timeout_s:g}, expected seconds above 0, at most {LONGEST_S:g}"
            )
        if self.scheduler != LOCAL and not re.fullmatch(_SCHEDULER, self.scheduler):
            raise SettingsError(f"--scheduler: found {self.scheduler!r}, expected local or tcp://HOST:PORT")
        if self.scheduler != LOCAL and self.task_timeout_s is not None:
            raise SettingsError(
                "--frame-timeout works only with processes of this machine; leave out --scheduler or --frame-timeout"
            )

    def at_most(self, tasks: int, /) -> "Workers":
        """Return the same workers, but no more processes than tasks: the others would have nothing to do."""
        return replace(self, jobs=max(min(self.jobs, tasks), 1))


ALONE = Workers(jobs=1)
"""This process alone does the work."""
