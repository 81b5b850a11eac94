"""Messages between processes arrive as they were sent, without objects that both sides share, and none is missed."""

import os
import pickle
import subprocess
import sys
from dataclasses import dataclass
from multiprocessing import Pipe
from pathlib import Path

import pytest

from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import FrameSource
from cadtof_cli.execution.messages import Incoming, TaskMessages
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import Work
from cadtof_cli.execution.workers import START_METHODS, StartMethod, Workers
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.workflows.recording import FrameReader
from cadtof_cli.workflows.resolve.frame_task import FrameTask
from cadtof_cli.workflows.resolve.reports import FrameReport
from tests.support.captures import record
from tests.support.run_cadtof import ENVIRONMENT


@dataclass(frozen=True)
class Heavy:
    """An object that takes long to send."""

    text: str


@dataclass(frozen=True)
class Part:
    number: int
    heavy: Heavy


HEAVY = Heavy("x" * 100_000)


def test_shared_objects_are_not_sent_and_are_the_same_object_in_all_tasks() -> None:
    ours = TaskMessages([HEAVY])
    theirs: TaskMessages = pickle.loads(pickle.dumps(ours))
    messages = [ours.message(Part(number, HEAVY)) for number in range(3)]
    assert all(len(message) < 500 for message in messages)
    parts = [theirs.task(message) for message in messages]
    assert parts == [Part(number, HEAVY) for number in range(3)]
    assert len({id(part.heavy) for part in parts}) == 1


@pytest.mark.parametrize("heavy", [Heavy("y"), Heavy(HEAVY.text)], ids=["other", "equal"])
def test_objects_that_are_not_shared_arrive_too_even_if_they_equal_a_shared_one(heavy: Heavy) -> None:
    messages = TaskMessages([HEAVY])
    arrived = messages.task(messages.message(Part(1, heavy)))
    assert arrived == Part(1, heavy)
    assert arrived.heavy is not HEAVY


def length(part: Part) -> tuple[int, int]:
    return part.number, len(part.heavy.text)


@pytest.mark.parametrize("start_method", START_METHODS)
def test_workers_have_the_shared_objects_with_every_start_method(start_method: StartMethod) -> None:
    workers = Workers(jobs=2, start_method=start_method)
    tasks = (Part(number, HEAVY) for number in range(5))
    outcomes = run_ordered(length, tasks, workers=workers, shared=[HEAVY])
    assert [outcome.result for outcome in outcomes] == [(number, 100_000) for number in range(5)]


class DiesWhereItArrives:
    """A function that ends the process which gets it, as if that had too little memory to start."""

    def __call__(self, part: Part) -> int:
        return part.number

    def __reduce__(self) -> tuple[object, ...]:
        return os._exit, (1,)


def print_results_of_workers_that_die_at_once() -> None:
    dying: Work[Part, int] = DiesWhereItArrives()
    workers = Workers(jobs=2, start_method="spawn")
    outcomes = run_ordered(dying, [Part(number, HEAVY) for number in range(3)], workers=workers, shared=[HEAVY])
    sys.stdout.write(" ".join(type(outcome.result).__name__ for outcome in outcomes))


def test_workers_that_die_at_once_keep_nobody_waiting() -> None:
    """Python sends a spawned process its arguments through a pipe that it holds open itself; HEAVY does not fit into it."""
    script = "from tests.execution import test_messages as m\nm.print_results_of_workers_that_die_at_once()"
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "WorkerDied WorkerDied WorkerDied"


def given(answer: object) -> object:
    if isinstance(answer, Exception):
        raise answer
    return answer


@pytest.mark.parametrize("answer", [None, b"", {"a": 1}], ids=["none", "empty", "mapping"])
def test_answers_arrive(answer: object) -> None:
    (outcome,) = run_ordered(given, [answer], workers=Workers(jobs=2))
    assert outcome.result == answer


def test_exceptions_arrive() -> None:
    with pytest.raises(ValueError, match=r"^why$"):
        list(run_ordered(given, [ValueError("why")], workers=Workers(jobs=2)))


def test_the_task_of_a_frame_arrives_whole_and_small(tmp_path: Path) -> None:
    record(tmp_path / "capture", frames=1)
    capture = find_captures([tmp_path / "capture"])[0]
    plan = FramePlan(metadata=capture.source.metadata)
    stack = FrameSource("below/stack_0003", (tmp_path / "stack.tif",), 3)
    before = FrameReport("a", "b", "ok", None, 0.5)
    reader = FrameReader(capture.layout, plan.metadata, (20, 30))
    task = FrameTask((*capture.frames, stack), reader, plan, tmp_path / "o.tif", True, before, "token")
    messages = TaskMessages([plan, reader])
    message = messages.message(task)
    assert messages.task(message) == task
    assert messages.task(message).plan is plan
    assert len(message) < 1000 + 4 * len(str(tmp_path))
    assert pickle.loads(pickle.dumps(task)) == task


@pytest.mark.parametrize("system", ["this one", "win32"])
def test_connections_with_a_message_or_a_closed_end_are_ready(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if system != "this one":
        monkeypatch.setattr(sys, "platform", system)
    incoming = Incoming[str]()
    ends = {name: Pipe() for name in ("silent", "sender", "gone", "left")}
    for name, (ours, _) in ends.items():
        incoming.add(ours, name)
    assert incoming.ready(0.0) == []
    for name in ("sender", "left"):
        ends[name][1].send_bytes(b"x")
    ends["gone"][1].close()
    incoming.remove(ends["left"][0])
    assert sorted(incoming.ready(None)) == ["gone", "sender"]
    assert ends["sender"][0].recv_bytes() == b"x"
    incoming.remove(ends["gone"][0])
    assert incoming.ready(0.0) == []
    incoming.close()
    for ours, theirs in ends.values():
        ours.close()
        theirs.close()
