"""The files of docs/cluster do what docs/cluster.md says: the tests run them, dry-run them, or parse them."""

import itertools
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from tests.support.captures import record
from tests.support.cluster import NO_SETTINGS, require_dask
from tests.support.run_cadtof import ENVIRONMENT, ROOT

PLACE = ROOT / "docs" / "cluster"

WITH_TOOLS = {**ENVIRONMENT, **NO_SETTINGS, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def test_a_cluster_started_by_hand_resolves_a_capture(tmp_path: Path) -> None:
    require_dask()
    capture = record(tmp_path / "room", frames=3)
    command = ["bash", str(PLACE / "by_hand.sh"), str(capture.folder), str(tmp_path / "out"), "1"]
    environment = {**WITH_TOOLS, "CADTOF_PORT": str(_free_port()), "DASK_TEMPORARY_DIRECTORY": str(tmp_path)}
    done = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "resolved 3 of 3 frames" in done.stderr


SBATCH = """#!/bin/sh
cp "$1" "$JOBS/script"
setsid --fork sh -c 'echo $$ > "$JOBS/job.$$"; exec bash "$JOBS/script"' > "$JOBS/log" 2>&1 < /dev/null
echo "Submitted batch job 7"
"""
"""Starts a job at once, where Slurm would wait for a free node."""

SCANCEL = """#!/bin/sh
kill -- -$(cat "$JOBS"/job.*)
"""


def test_a_run_on_slurm_gets_workers(tmp_path: Path) -> None:
    """The run waits for a worker before it has work for one, so jobs must be asked for in any case."""
    require_dask("dask_jobqueue")
    capture = record(tmp_path / "room", frames=3)
    tools, jobs = tmp_path / "bin", tmp_path / "jobs"
    tools.mkdir()
    jobs.mkdir()
    for name, script in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (tools / name).write_text(script)
        (tools / name).chmod(0o755)
    command = [sys.executable, str(PLACE / "slurm.py"), str(capture.folder), str(tmp_path / "out"), "--per-job", "1"]
    environment = {**WITH_TOOLS, "JOBS": str(jobs)}
    environment["PATH"] = f"{tools}{os.pathsep}{environment['PATH']}"
    try:
        done = subprocess.run(
            [*command, "--workers", "1", "--interface", "lo"],
            env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
        )  # fmt: skip
    finally:
        for job in jobs.glob("job.*"):
            with suppress(ProcessLookupError):
                os.killpg(int(job.read_text()), signal.SIGKILL)
    assert done.returncode == 0, done.stderr
    assert "resolved 3 of 3 frames" in done.stderr


def test_the_job_for_slurm(tmp_path: Path) -> None:
    require_dask("dask_jobqueue")
    # an environment below a folder whose name has a space
    (tmp_path / "my env").symlink_to(sys.prefix)
    python = str(tmp_path / "my env" / os.path.relpath(sys.executable, sys.prefix))
    command = [
        python,
        str(PLACE / "slurm.py"),
        "room",
        "out",
        "--per-job",
        "8",
        "--dry-run",
        "--interface",
        "lo",
        "--walltime",
        "01:00:00",
    ]
    done = subprocess.run(
        command, env=ENVIRONMENT | NO_SETTINGS, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    options = dict(re.findall(r"(?m)^#SBATCH (-\w|--[\w-]+)[ =](.+)$", done.stdout))
    assert options["--cpus-per-task"] == "8"
    assert options["-t"] == "01:00:00"
    worker = shlex.split(done.stdout.strip().splitlines()[-1])
    assert worker[:2] == [python, "-m"]
    worker_options = dict(itertools.pairwise(worker))
    assert (worker_options["--nworkers"], worker_options["--nthreads"]) == ("8", "1")
    # a worker leaves after its lifetime, give or take what keeps workers from leaving together
    lifetime_s, stagger_s = (int(worker_options[name].rstrip("s")) for name in ("--lifetime", "--lifetime-stagger"))
    assert 3000 < lifetime_s + stagger_s < 3600 - 60
    subprocess.run(["bash", "-n"], input=done.stdout, text=True, check=True, timeout=10)


def test_the_objects_for_kubernetes() -> None:
    cluster, job = yaml.safe_load_all((PLACE / "kubernetes.yaml").read_text())
    assert (cluster["apiVersion"], cluster["kind"]) == ("kubernetes.dask.org/v1", "DaskCluster")
    assert (job["apiVersion"], job["kind"]) == ("batch/v1", "Job")
    scheduler, worker, resolve = (
        _container(part["spec"])
        for part in (cluster["spec"]["scheduler"], cluster["spec"]["worker"], job["spec"]["template"])
    )
    assert scheduler["image"] == worker["image"] == resolve["image"]
    # the run and its workers see the same files at the same place
    pods = (cluster["spec"]["worker"]["spec"], job["spec"]["template"]["spec"])
    assert pods[0]["volumes"] == pods[1]["volumes"]
    assert worker["volumeMounts"] == resolve["volumeMounts"]
    name, port = cluster["metadata"]["name"], cluster["spec"]["scheduler"]["service"]["ports"][0]["port"]
    command = resolve["command"]
    assert command[command.index("--scheduler") + 1] == f"tcp://{name}-scheduler:{port}"
    assert all(Path(path).is_relative_to(worker["volumeMounts"][0]["mountPath"]) for path in (command[2], command[4]))
    assert cluster["spec"]["scheduler"]["service"]["selector"] == {
        "dask.org/cluster-name": name, "dask.org/component": "scheduler",
    }  # fmt: skip
    assert worker["args"][worker["args"].index("--nthreads") + 1] == "1"
    for part, options in ((scheduler, {"--host"}), (worker, {"--name", "--nthreads", "--no-dashboard"})):
        program, *more = part["args"][:2]
        command = [Path(sys.executable).with_name(program), *more, "--help"]
        done = subprocess.run(command, env=WITH_TOOLS, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        assert all(option in done.stdout for option in options)


def _container(pod: dict[str, Any]) -> dict[str, Any]:
    (container,) = pod["containers"]
    assert isinstance(container, dict)
    return container


def test_the_image_installs_what_is_here() -> None:
    steps = [
        line.split(maxsplit=1) for line in (PLACE / "Dockerfile").read_text().splitlines() if line and line[0] != "#"
    ]
    assert [step[0] for step in steps] == ["FROM", "RUN", "COPY", "RUN", "WORKDIR"]
    assert "-c /cadtof/constraints.txt" in steps[3][1]
    assert "[cluster]" in steps[3][1]
