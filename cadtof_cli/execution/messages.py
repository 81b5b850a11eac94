"""What the processes of a pool say to each other, and how what comes from many of them is waited for."""

import io
import pickle
import selectors
import sys
from collections.abc import Sequence
from enum import IntEnum
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

Who = TypeVar("Who")


class Said(IntEnum):
    """What a message of a worker says: the task that it was at is computed, and its result will come; or what came of the first
    task that it has not answered for, a result or an exception."""

    COMPUTED = 0
    RESULT = 1
    ERROR = 2


_COMPUTED = bytes((Said.COMPUTED,))


def answer_message(said: Said, what: Any = None, /) -> bytes:
    """Return a message of a worker."""
    return _COMPUTED if said == Said.COMPUTED else bytes((said,)) + pickle.dumps(what, pickle.HIGHEST_PROTOCOL)


def answer_of(message: bytes, /) -> tuple[int, Any]:
    """Return what a message of a worker says, one of `Said`, and the result or exception that comes with it."""
    return message[0], pickle.loads(memoryview(message)[1:]) if len(message) > 1 else None


class TaskMessages:
    """Messages that hold a task each, without what all tasks have in common: both sides know that already.

    Args:
        shared: objects that tasks hold, each of them by itself or within others: they are told by which objects they are.
    """

    def __init__(self, shared: Sequence[object]) -> None:
        self._shared = tuple(shared)
        self._places = {id(one): place for place, one in enumerate(self._shared)}

    def __reduce__(self) -> tuple[type["TaskMessages"], tuple[Sequence[object]]]:
        """Return how another process makes its own, where the objects lie elsewhere."""
        return TaskMessages, (self._shared,)

    def message(self, task: object, /) -> bytes:
        """Return the message that a worker makes the task from."""
        written = io.BytesIO()
        _Pickler(written, self._places).dump(task)
        return written.getvalue()

    def task(self, message: bytes, /) -> Any:
        """Return the task that a message holds."""
        return _Unpickler(io.BytesIO(message), self._shared).load()


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, places: dict[int, int]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._places = places

    def persistent_id(self, one: object) -> int | None:
        return self._places.get(id(one))


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, place: int) -> object:
        return self._shared[place]


class Incoming(Generic[Who]):
    """Connections, and whom each leads to; all of them are waited for at once.

    The system is told of a connection once, where it can be: to tell it of all of them before every message takes longer than
    the message.
    """

    def __init__(self) -> None:
        self._ends: dict[Connection, Who] = {}
        self._selector = selectors.DefaultSelector() if sys.platform != "win32" else None

    def add(self, connection: Connection, who: Who, /) -> None:
        """Wait for this one too."""
        self._ends[connection] = who
        if self._selector is not None:
            self._selector.register(connection, selectors.EVENT_READ, who)

    def remove(self, connection: Connection, /) -> None:
        """No longer wait for this one, which is still open."""
        del self._ends[connection]
        if self._selector is not None:
            self._selector.unregister(connection)

    def ready(self, timeout_s: float | None, /) -> list[Who]:
        """Return from whom something has come, or whose end is closed, as soon as there is any; nobody after the time."""
        if self._selector is not None:
            return [key.data for key, _ in self._selector.select(timeout_s)]
        ready = wait(list(self._ends), timeout_s)
        return [who for connection, who in self._ends.items() if connection in ready]

    def close(self) -> None:
        """Let go of the connections, which are not closed."""
        if self._selector is not None:
            self._selector.close()
