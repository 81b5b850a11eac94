"""The messages between the processes of a pool, and how to wait for messages of many processes at once."""

import io
import pickle
import selectors
import sys
from collections.abc import Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

Who = TypeVar("Who")


NO_MORE = b""
"""The message to a worker that there are no more tasks. All others are tasks, see `TaskMessages`."""

COMPUTED = b""
"""The message of a worker that its current task is computed, and that the answer comes later. All others are the answer, a result
or a `Raised`, to the first task that the worker has not answered yet, as pickle writes it."""


class TaskMessages:
    """Messages with one task each, without the `shared` objects that tasks hold somewhere: both processes have these already.

    These objects are recognised by identity, not by equality.
    """

    def __init__(self, shared: Sequence[object]) -> None:
        self._shared = tuple(shared)
        self._places = {id(one): place for place, one in enumerate(self._shared)}

    def __reduce__(self) -> tuple[type["TaskMessages"], tuple[Sequence[object]]]:
        """Make pickle create a new instance in another process, because the objects have other addresses there."""
        return TaskMessages, (self._shared,)

    def message(self, task: object, /) -> bytes:
        """Return the message from which a worker restores the task."""
        written = io.BytesIO()
        _Pickler(written, self._places).dump(task)
        return written.getvalue()

    def task(self, message: bytes, /) -> Any:
        """Return the task in a message."""
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
    """Connections, each with an object that says who is at the other end; all of them are waited for at once.

    Each connection is registered with the operating system once, if the system can do that: to name all connections anew before
    every message takes longer than the message.
    """

    def __init__(self) -> None:
        self._ends: dict[Connection, Who] = {}
        self._selector = selectors.DefaultSelector() if sys.platform != "win32" else None

    def add(self, connection: Connection, who: Who, /) -> None:
        """Wait for this connection too."""
        self._ends[connection] = who
        if self._selector is not None:
            self._selector.register(connection, selectors.EVENT_READ, who)

    def remove(self, connection: Connection, /) -> None:
        """No longer wait for this connection, which must still be open."""
        del self._ends[connection]
        if self._selector is not None:
            self._selector.unregister(connection)

    def ready(self, timeout_s: float | None, /) -> list[Who]:
        """Wait until connections have a message, or their other end is closed; return their objects, none after `timeout_s`."""
        if self._selector is not None:
            return [key.data for key, _ in self._selector.select(timeout_s)]
        ready = wait(list(self._ends), timeout_s)
        return [who for connection, who in self._ends.items() if connection in ready]

    def close(self) -> None:
        """Stop waiting for the connections; they stay open."""
        if self._selector is not None:
            self._selector.close()
