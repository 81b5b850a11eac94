"""What a worker process does: it computes one task after the other, until there are no more."""

import os
import pickle
import threading
from collections import deque
from multiprocessing.connection import Connection
from typing import Any

from cadtof_cli.execution.messages import COMPUTED, NO_MORE, TaskMessages
from cadtof_cli.execution.outcome import LATER_AT_ONCE, Later, Work, finishing
from cadtof_cli.execution.starting import begin_worker


class _Answers:
    """The answers of a worker, sent in the order of the tasks by the thread that finished the last one that was missing."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._begun: deque[Later[Any]] = deque()
        self._change = threading.Condition()

    def add(self, result: Later[Any]) -> None:
        """Answer for the next task; this blocks while too many results are waited for."""
        with self._change:
            if result.there and not self._begun:
                self._tell(result)
                return
            self._connection.send_bytes(COMPUTED)
            self._begun.append(result)
        # the result may have come before it was in the queue
        self.tell_all()
        self.wait_for_at_most(LATER_AT_ONCE + 1)

    def wait_for_at_most(self, count: int) -> None:
        """Wait until no more than `count` results are still to be sent."""
        with self._change:
            self._change.wait_for(lambda: len(self._begun) <= count)

    def tell_all(self) -> None:
        """Send the results that are there, in order, up to the first one that is missing."""
        try:
            with self._change:
                while self._begun and self._begun[0].there:
                    self._tell(self._begun.popleft())
                self._change.notify()
        except BaseException:  # noqa: BLE001  (a result that cannot be sent would be waited for without end)
            os._exit(1)

    def _tell(self, result: Later[Any]) -> None:
        self._connection.send_bytes(pickle.dumps(result.answer(), pickle.HIGHEST_PROTOCOL))


def serve(
    function: Work[Any, Any],
    messages: TaskMessages | None,
    connection: Connection,
    parent_end: Connection,
    listening: Connection,
    held: Connection,
    core: int | None,
) -> None:
    """Answer one task after the other with `function`, until there are no more.

    `messages` come first on the connection if they are None here. `parent_end` is the other end of the connection, of which a
    forked worker has a copy; see `begin_worker` for the last three.
    """
    begin_worker(listening, held, core)
    parent_end.close()
    answers = _Answers(connection)
    with finishing(answers.tell_all) as finisher:
        try:
            known: TaskMessages = messages or pickle.loads(connection.recv_bytes())
            while (message := connection.recv_bytes()) != NO_MORE:
                answers.add(finisher.attempt(lambda message: function(known.task(message)), message))
        except (OSError, EOFError):
            # the parent has ended, and nobody is there to read a traceback
            os._exit(1)
        answers.wait_for_at_most(0)
