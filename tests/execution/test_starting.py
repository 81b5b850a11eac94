"""Workers start and end without a word on stderr, whatever signal comes."""

import signal
import subprocess
import sys
import time
from multiprocessing import Pipe, get_context
from pathlib import Path

import pytest

from cadtof_cli.errors import WorkersError
from cadtof_cli.execution.messages import TaskMessages
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.serve import serve
from cadtof_cli.execution.workers import Workers
from tests.support.run_cadtof import ENVIRONMENT, ROOT

_FIRST_WORKER = """
import sys
from multiprocessing import get_context
from cadtof_cli.execution.starting import signals_held_back
from tests.execution.test_starting import say_what_is_held_back
if __name__ == "__main__":
    context = get_context(sys.argv[1])
    first = context.Process(target=say_what_is_held_back)
    with signals_held_back(sys.argv[1]):
        first.start()
    first.join()
    say_what_is_held_back()
"""


def say_what_is_held_back() -> None:
    """Print the names of the signals that this process holds back."""
    held = map(signal.Signals, signal.pthread_sigmask(signal.SIG_BLOCK, ()))
    sys.stdout.write(" ".join(sorted(one.name for one in held)) + "\n")
    sys.stdout.flush()


@pytest.mark.parametrize("start_method", ["fork", "spawn"])
def test_the_first_worker_holds_signals_back_until_it_can_handle_them(start_method: str) -> None:
    """Python starts its resource tracker with the first worker that is spawned, and lets the signals through after that."""
    words = [sys.executable, "-c", _FIRST_WORKER, start_method]
    done = subprocess.run(words, env=ENVIRONMENT, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines() == ["SIGHUP SIGINT SIGTERM", ""]


def test_the_fork_server_says_if_the_path_of_its_socket_is_too_long(tmp_path: Path) -> None:
    folder = tmp_path / (100 * "x")
    folder.mkdir()
    script = "from tests.execution.test_starting import start_by_fork_server\nstart_by_fork_server()"
    words, environment = [sys.executable, "-c", script], {**ENVIRONMENT, "TMPDIR": str(folder)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=60, check=True)
    # newer Pythons take another folder then
    message = "no worker process can be started (AF_UNIX path too long): set TMPDIR to a folder with a shorter path"
    assert done.stdout.strip() in {message, "0.0"}


def start_by_fork_server() -> None:
    """Print the result of a task, or why there is none."""
    try:
        (outcome, *_) = run_ordered(_slow, [0.0, 0.0], workers=Workers(jobs=2, start_method="forkserver"))
        sys.stdout.write(str(outcome.result))
    except WorkersError as error:
        sys.stdout.write(str(error))


def _slow(task: float) -> float:
    time.sleep(task)
    return task


def test_a_worker_whose_parent_is_gone_shows_no_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    ours, theirs = Pipe()
    listening, held = Pipe(duplex=False)
    messages = TaskMessages([])
    worker = get_context("fork").Process(target=serve, args=(_slow, messages, theirs, ours, listening, held, None))
    worker.start()
    theirs.close()
    ours.send_bytes(messages.message(0.5))
    # as if the parent were gone: nobody is there to take the answer; `held` stays open, as it may for a moment
    ours.close()
    worker.join(30)
    assert worker.exitcode == 1
    assert capfd.readouterr().err == ""
