"""Workers by Slurm: `python slurm.py --workers 64 CAPTURE OUT`, with dask-jobqueue, from a node that stays up.

The scheduler runs in this process. All jobs are asked for at once. Each is one node's share of workers, which comes when Slurm
lets it. In place of a job that has ended, another is asked for. `--dry-run` prints the job that would be submitted.
"""

import argparse
import shlex
import subprocess
import sys

from dask_jobqueue import SLURMCluster


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("capture")
    parser.add_argument("out")
    parser.add_argument("--workers", type=int, default=64)
    parser.add_argument("--per-job", type=int, default=16, help="workers, and cores, of a job")
    parser.add_argument("--queue", default="normal")
    parser.add_argument("--walltime", default="04:00:00", help="HH:MM:SS")
    parser.add_argument("--interface", default=None, help="network that nodes reach each other by, such as ib0")
    parser.add_argument("--dry-run", action="store_true")
    given = parser.parse_args()
    try:
        hours, minutes, seconds = map(int, given.walltime.split(":"))
    except ValueError:
        parser.error(f"--walltime: found {given.walltime}, expected HH:MM:SS such as 04:00:00")
    walltime_s = 3600 * hours + 60 * minutes + seconds
    cluster = SLURMCluster(
        queue=given.queue,
        walltime=given.walltime,
        cores=given.per_job,
        processes=given.per_job,  # a process for every core: cadtof uses one thread of a worker
        memory=f"{given.per_job}GiB",
        interface=given.interface,
        python=shlex.quote(sys.executable),  # it goes into a script
        scheduler_options={"dashboard": False},
        # workers leave after 93 to 97 % of the time of their job, so that Slurm cuts no frame short
        worker_extra_args=[
            "--no-dashboard",
            "--lifetime",
            f"{0.95 * walltime_s:.0f}s",
            "--lifetime-stagger",
            f"{0.02 * walltime_s:.0f}s",
        ],
    )
    with cluster:
        if given.dry_run:
            print(cluster.job_script())
            return 0
        jobs = -(-given.workers // given.per_job)
        # never fewer: dask would start no job for a run that waits for its first worker
        cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)
        command = (
            "cadtof",
            "resolve",
            given.capture,
            "-o",
            given.out,
            "--scheduler",
            cluster.scheduler_address,
            "--resume",
        )
        return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
