"""What a worker process does: one task after the other, until there are no more."""

import os
import threading
from collections import deque
from multiprocessing.connection import Connection
from typing import Any

from cadtof_cli.execution.messages import Said, TaskMessages, answer_message
from cadtof_cli.execution.outcome import LATER_AT_ONCE, Later, Work, finishing
from cadtof_cli.execution.starting import begin_worker


class _Answers:
    """What a worker says: results in the order of the tasks, each from the thread that had the last of those before it."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._begun: deque[Later[Any]] = deque()
        self._change = threading.Condition()

    def add(self, result: Later[Any]) -> None:
        """Answer for the next task; where too many results are waited for, this waits too."""
        with self._change:
            if result.there and not self._begun:
                self._tell(result)
                return
            self._connection.send_bytes(answer_message(Said.COMPUTED))
            self._begun.append(result)
        # it may have come meanwhile
        self.tell_all()
        self._wait_for_at_most(LATER_AT_ONCE + 1)

    def end(self) -> None:
        """Return when all is answered."""
        self._wait_for_at_most(0)

    def _wait_for_at_most(self, count: int) -> None:
        with self._change:
            self._change.wait_for(lambda: len(self._begun) <= count)

    def tell_all(self) -> None:
        """Tell the results that are there, and have none before them that is not."""
        try:
            with self._change:
                while self._begun and self._begun[0].there:
                    self._tell(self._begun.popleft())
                self._change.notify()
        except BaseException:  # noqa: BLE001  (what cannot be sent would be waited for)
            os._exit(1)

    def _tell(self, result: Later[Any]) -> None:
        said, what = (Said.RESULT, result.result()) if result.error is None else (Said.ERROR, result.error)
        self._connection.send_bytes(answer_message(said, what))


def serve(
    function: Work[Any, Any],
    messages: TaskMessages,
    connection: Connection,
    parents: Connection,
    listening: Connection,
    held: Connection,
    core: int | None,
) -> None:
    """Answer one task after the other, until an empty message comes.

    Args:
        function: what is done to tasks.
        messages: how they come.
        connection: the end of the connection that is ours.
        parents: its other end, of which a forked worker has a copy.
        listening, held, core: see `begin_worker`.
    """
    begin_worker(listening, held, core)
    parents.close()
    answers = _Answers(connection)
    with finishing(answers.tell_all) as finisher:
        while message := connection.recv_bytes():
            answers.add(finisher.attempt(lambda message: function(messages.task(message)), message))
        answers.end()
