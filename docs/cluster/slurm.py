"""Workers by Slurm: `python slurm.py --workers 64 CAPTURE OUT`, with dask-jobqueue, from a node that stays up.

The scheduler runs in this process; each job of Slurm is one node's share of workers, which comes when Slurm lets it.
`--dry-run` prints the job that would be submitted.
"""

import argparse
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
    parser.add_argument("--walltime", default="04:00:00")
    parser.add_argument("--interface", default=None, help="network that nodes reach each other by, such as ib0")
    parser.add_argument("--dry-run", action="store_true")
    given = parser.parse_args()
    cluster = SLURMCluster(
        queue=given.queue,
        walltime=given.walltime,
        cores=given.per_job,
        processes=given.per_job,  # a process for every core: cadtof uses one thread of a worker
        memory=f"{given.per_job}GiB",
        interface=given.interface,
        scheduler_options={"dashboard": False},
        # workers leave before Slurm ends their job, so that no frame is cut short
        worker_extra_args=["--no-dashboard", "--lifetime", "230m", "--lifetime-stagger", "5m"],
    )
    with cluster:
        if given.dry_run:
            print(cluster.job_script())
            return 0
        cluster.adapt(maximum_jobs=-(-given.workers // given.per_job))
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
