"""The campaign of `scripts/kills`, in short: every kind of run and victim, once. Clusters are in `test_cluster.py`."""

import subprocess
import sys

import pytest

from tests.support.run_cadtof import ENVIRONMENT, ROOT

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are found by /proc")


def test_killed_runs_end_like_undisturbed_ones() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "kills.py"), "--kills", "12", "--seed", "7", "--kinds"]
    command.append("resolve,resume,stacks,overwrite")
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=240, check=False)
    assert done.stdout.splitlines()[-1] == "12 of 12 kills: all maps and records equal those of an undisturbed run"
    assert done.returncode == 0
