"""What a worker process does: one task after the other, until there are no more."""

import os
import pickle
import threading
from concurrent.futures import Future
from enum import IntEnum
from multiprocessing.connection import Connection
from queue import Queue
from typing import Any

from cadtof_cli.execution.finisher import LATER_AT_ONCE, Finisher
from cadtof_cli.execution.outcome import Work
from cadtof_cli.execution.workers import begin_worker


class Said(IntEnum):
    """What a message of a worker says: the task that it was at is computed, and its result will come; or what came of the first
    task that it has not answered for, a result or an exception."""

    COMPUTED = 0
    RESULT = 1
    ERROR = 2


class _Answers:
    """What a worker says, with a thread that waits for results and sends them in the order of the tasks."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._one_at_a_time = connection, threading.Lock()
        self._begun: Queue[Future[Any] | None] = Queue(LATER_AT_ONCE)
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def add(self, result: Future[Any]) -> None:
        """Answer for the next task."""
        if result.done() and not self._begun.unfinished_tasks:
            self._tell(result)
            return
        self._say(Said.COMPUTED, None)
        self._begun.put(result)

    def end(self) -> None:
        """Return when all is answered."""
        self._begun.put(None)
        self._thread.join()

    def _send(self) -> None:
        try:
            while (result := self._begun.get()) is not None:
                self._tell(result)
                self._begun.task_done()
        finally:
            if result is not None:
                # what cannot be sent would be waited for
                os._exit(1)

    def _tell(self, result: Future[Any]) -> None:
        error = result.exception()
        if error is None:
            self._say(Said.RESULT, result.result())
        else:
            self._say(Said.ERROR, error)

    def _say(self, said: Said, what: Any) -> None:
        with self._one_at_a_time:
            self._connection.send((int(said), what))


def serve(
    function: Work[Any, Any], connection: Connection, parents: Connection, listening: Connection, held: Connection
) -> None:
    """Answer one task after the other, until an empty message comes.

    Args:
        function: what is done to tasks.
        connection: the end of the connection that is ours.
        parents: its other end, of which a forked worker has a copy.
        listening, held: see `begin_worker`.
    """
    begin_worker(listening, held)
    parents.close()
    answers = _Answers(connection)
    with Finisher(LATER_AT_ONCE) as finisher:
        while message := connection.recv_bytes():
            answers.add(finisher.attempt(lambda message: function(pickle.loads(message)), message))
        answers.end()
