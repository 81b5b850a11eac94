"""How many cores this process may use: by its affinity, and by the processor time that its control groups allow."""

import math
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_OWN_GROUPS = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")


def available_cores() -> int:
    """Return how many cores this process may keep busy.

    A container that is limited to the time of two cores still sees all cores of the machine. If it runs more than two processes,
    they take turns, and all of them stand still when the time is used up.
    """
    seen = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(seen, quota_cores())))


def quota_cores(own_groups: Path = _OWN_GROUPS, groups: Path = _GROUPS) -> float:
    """Return the processor time that the control groups of this process allow, in cores; infinity if nothing limits it.

    `own_groups` has a line of hierarchy, controllers and group for each group (man 7 cgroups), which is mounted in `groups`.
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
    """Yield the limit of a group, and the limit of every group that it lies in, in cores."""
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
