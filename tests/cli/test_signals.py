"""Signals that come in moments in which Python cannot end."""

import signal
import subprocess
import sys

import pytest

from tests.support.run_cadtof import ENVIRONMENT

_SIGNAL_IN_A_CALLBACK = """
import os, sys, time
from cadtof_cli import cli
class Dropped:
    def __del__(self):
        os.kill(os.getpid(), int(sys.argv[1]))
def invoke(context):
    Dropped()
    time.sleep(9)
    return 0
cli.cli.invoke = invoke
cli.main()
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_ends_a_command_also_while_python_drops_exceptions(number: signal.Signals, status: int) -> None:
    """Python calls weak references' callbacks with every import; the run went on, with a traceback and status 0."""
    command = [sys.executable, "-c", _SIGNAL_IN_A_CALLBACK, str(int(number))]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr.strip()) == (status, "interrupted" if number == signal.SIGINT else "")
