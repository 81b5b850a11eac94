"""How many cores there are for this process: by its affinity, and by the time that its control groups are given."""

import math
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_OWN_GROUPS = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")


def available_cores() -> int:
    """Return how many cores this process may keep busy.

    A container that is given the time of two cores sees all of the machine's; more processes than two take turns there, and
    stand still together when the time is used up.
    """
    seen = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(seen, math.ceil(min(seen, quota_cores()))))


def quota_cores(own_groups: Path = _OWN_GROUPS, groups: Path = _GROUPS) -> float:
    """Return the time of how many cores the control groups of this process are given; infinity where nothing limits it.

    Args:
        own_groups: lines of hierarchy, controllers and group (man 7 cgroups).
        groups: where the groups are mounted.
    """
    least = math.inf
    with suppress(OSError, ValueError):
        for line in own_groups.read_text().splitlines():
            _, controllers, group = line.split(":", 2)
            if controllers and "cpu" not in controllers.split(","):
                continue
            for root in (groups / controllers, groups / ("cpu" if controllers else "unified")):
                least = min([least, *_quotas(root, group)])
    return least


def _quotas(root: Path, group: str) -> Iterator[float]:
    """Yield what a group and those that it lies in are given, each in cores."""
    folder = root / group.lstrip("/")
    for one in (folder, *folder.parents):
        if not one.is_relative_to(root):
            return
        for names in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
            with suppress(OSError, ValueError, ZeroDivisionError):
                quota, period, *_ = " ".join((one / name).read_text() for name in names).split()
                # unlimited: max, or -1
                if quota != "max" and int(quota) > 0:
                    yield int(quota) / int(period)
