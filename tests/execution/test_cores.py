"""A container may see all cores of its machine, but get the time of a few: only as many processes are started."""

import math
from pathlib import Path

import pytest

from cadtof_cli.execution.cores import available_cores, quota_cores
from cadtof_cli.execution.workers import Workers

V2, V1 = {"cpu.max": "150000 100000\n"}, {"cpu.cfs_quota_us": "50000\n", "cpu.cfs_period_us": "100000\n"}


@pytest.mark.parametrize(
    ("membership", "folder", "files", "cores"),
    [
        ("0::/\n", "", V2, 1.5),
        ("0::/user.slice/run\n", "user.slice/run", V2, 1.5),
        ("0::/user.slice/run\n", "user.slice", V2, 1.5),
        ("0::/a\n", "unified/a", V2, 1.5),
        ("3:cpuset:/\n2:cpu,cpuacct:/docker/4f\n", "cpu,cpuacct/docker/4f", V1, 0.5),
        ("2:cpu,cpuacct:/docker/4f\n", "cpu,cpuacct", V1, 0.5),
        ("2:cpu:/a:b\n", "cpu/a:b", V1, 0.5),
        ("0::/\n", "", {"cpu.max": "max 100000\n"}, math.inf),
        ("2:cpu:/\n", "cpu", {**V1, "cpu.cfs_quota_us": "-1\n"}, math.inf),
        ("3:cpuset:/\n", "cpuset", V1, math.inf),
        ("0::/a\n", "b", V2, math.inf),
        ("nonsense", "", V2, math.inf),
        ("0::/\n", "", {"cpu.max": "nonsense"}, math.inf),
        ("0::/\n", "", {"cpu.max": "1000 0\n"}, math.inf),
    ],
)
def test_the_quota_of_a_control_group_is_a_number_of_cores(
    membership: str, folder: str, files: dict[str, str], cores: float, tmp_path: Path
) -> None:
    (tmp_path / "cgroup").write_text(membership)
    (tmp_path / "groups" / folder).mkdir(parents=True)
    for name, text in files.items():
        (tmp_path / "groups" / folder / name).write_text(text)
    assert quota_cores(tmp_path / "cgroup", tmp_path / "groups") == cores


def test_the_smallest_quota_counts_and_no_group_is_no_limit(tmp_path: Path) -> None:
    (tmp_path / "cgroup").write_text("0::/a/b\n")
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "cpu.max").write_text("200000 100000\n")
    (tmp_path / "a" / "b" / "cpu.max").write_text("300000 100000\n")
    assert quota_cores(tmp_path / "cgroup", tmp_path) == 2.0
    assert quota_cores(tmp_path / "nowhere", tmp_path) == math.inf


@pytest.mark.parametrize(("quota", "cores"), [(math.inf, 5), (1.5, 2), (0.1, 1), (64.0, 5)])
def test_available_cores_are_limited_by_the_quota_but_at_least_one(
    quota: float, cores: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(5)), raising=False)
    monkeypatch.setattr("cadtof_cli.execution.cores.quota_cores", lambda: quota)
    assert available_cores() == cores


@pytest.mark.parametrize(("jobs", "tasks", "processes"), [(4, 2, 2), (4, 9, 4), (4, 0, 1), (1, 5, 1)])
def test_there_are_no_more_processes_than_tasks_but_at_least_one(jobs: int, tasks: int, processes: int) -> None:
    assert Workers(jobs=jobs).at_most(tasks).jobs == processes
