"""A connection to a dask scheduler: work goes to named workers, and news of it comes back. Only this module knows dask."""

import logging
import pickle
import queue
import socket
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from uuid import uuid4

from cadtof_cli.errors import ClusterError, SettingsError
from cadtof_cli.execution.cluster.worker import wait_until_idle
from cadtof_cli.execution.outcome import Raised

CONNECT_S = 10
"""Longest wait for a scheduler to answer."""

GATHER_S = 5
"""Longest wait for a result that lies on a worker, before other news is looked at: if that worker is lost, no result comes."""

LISTEN_S = 1
"""Longest wait for news, before the connection itself is checked."""

COMPARE_S = 5
"""Time between two requests for the list of workers, which are made because news of a worker may have gone missing."""

STOP_S = 10
"""Longest wait for workers to finish their current tasks when a run is stopped."""

_CALL = "(lambda function, arguments: function(*arguments))(*__import__('pickle').loads(packed))"
"""The expression that a worker evaluates. Text and pickled bytes are sent instead of a function of cadtof: on a worker without
cadtof, such a function would end the worker, and it would fail at the scheduler, which need not have cadtof."""

_LIBRARIES = ("distributed", "tornado")
"""Libraries that log a traceback when a connection is lost; cadtof reports the loss itself."""


@dataclass(frozen=True)
class WorkerJoined:
    """A worker has joined the scheduler."""

    worker: str


@dataclass(frozen=True)
class WorkerLost:
    """A worker has left the scheduler; `expected` is True if the worker was told to leave."""

    worker: str
    expected: bool


@dataclass(frozen=True)
class Finished:
    """A piece of work has ended. The answer is the value that it returned, or `Raised` if an exception kept it from returning."""

    work: int
    answer: Any


News = WorkerJoined | WorkerLost | Finished


class Connection:
    """A client of a scheduler. Every piece of work is bound to one worker, so that the scheduler never moves work by itself.

    This side, not dask, takes care of lost workers: only it can tell a task that kills its worker from one that was beside it.
    """

    def __init__(self, address: str, /) -> None:
        """Connect; raises SettingsError if dask is not installed, or no scheduler answers."""
        try:
            from distributed import Client
        except ImportError as error:
            raise SettingsError(
                f"--scheduler {address}: needs the extra cluster: pip install 'cadtof[cluster]'"
            ) from error
        for name in [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in _LIBRARIES]:
            # dask sets the levels of some of these loggers itself
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self.address = address
        self._run = uuid4().hex[:8]
        self._news: queue.SimpleQueue[WorkerJoined | WorkerLost | int] = queue.SimpleQueue()
        self._futures: dict[int, Any] = {}
        self._workers: set[str] = set()
        try:
            host, _, port = address.removeprefix("tcp://").rpartition(":")
            # dask tries again and again if nobody listens at the address, and waits for ever if another program listens
            # there. A scheduler sends the first byte; a dashboard does not
            with socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT_S) as line:
                if not line.recv(1):
                    raise ConnectionResetError("the program that listens there closes the connection")
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                self._client = Client(address, timeout=CONNECT_S, set_as_default=False, name="cadtof")
        except (OSError, ValueError, OverflowError) as error:
            raise SettingsError(f"--scheduler {address}: no dask scheduler answers there ({error})") from error
        self.notes = tuple(str(one.message) for one in told)
        self._client.subscribe_topic("all", self._heard)
        self._compared = 0.0

    def submit(self, work: int, worker: str, function: Callable[..., Any], /, *arguments: Any) -> None:
        """Make a worker call a function; news of the call comes under the number `work`."""
        future = self._futures[work] = self._submitted(str(work), worker, function, *arguments)
        future.add_done_callback(lambda _: self._news.put(work))

    def _submitted(self, work: str, worker: str, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Return the future of a call on a worker."""
        key, packed = f"{function.__name__}-{self._run}-{work}", pickle.dumps((function, arguments))
        return self._client.submit(eval, _CALL, {"packed": packed}, key=key, pure=False, workers=[worker])

    def forget(self, works: Iterable[int], /) -> None:
        """Cancel pieces of work, wherever they are; there will be no news of them."""
        futures = [self._futures.pop(work) for work in works if work in self._futures]
        if futures and self._client.status == "running":
            self._client.cancel(futures)

    def news(self) -> list[News]:
        """Wait for news, `LISTEN_S` at most, and return all news; raises ClusterError if the scheduler is lost."""
        heard: list[WorkerJoined | WorkerLost | int] = []
        self._compare_workers()
        with suppress(queue.Empty):
            heard.append(self._news.get(timeout=LISTEN_S))
            while True:
                heard.append(self._news.get_nowait())
        return [news for one in heard for news in self._understood(one)]

    def close(self) -> None:
        """Cancel all work, wait until the workers have finished their current tasks, and disconnect."""
        # a cluster that is gone, or slow, must not keep a run from ending
        with suppress(OSError, TimeoutError, CancelledError):
            if self._futures and self._client.status == "running":
                self.forget(list(self._futures))
                self._wait_until_idle()
        with suppress(OSError, TimeoutError, CancelledError):
            self._client.close(timeout=CONNECT_S)

    def _heard(self, event: tuple[float, Any]) -> None:
        """Put an event of the scheduler in the queue of news; dask's client calls this in its own thread."""
        _, message = event
        match message.get("action"):
            case "add-worker":
                self._news.put(WorkerJoined(message["worker"]))
            case "remove-worker":
                self._news.put(WorkerLost(message["worker"], bool(message.get("expected"))))

    def _understood(self, heard: WorkerJoined | WorkerLost | int) -> Iterator[News]:
        if isinstance(heard, WorkerJoined):
            if heard.worker not in self._workers:
                self._workers.add(heard.worker)
                yield heard
        elif isinstance(heard, WorkerLost):
            if heard.worker in self._workers:
                self._workers.remove(heard.worker)
                yield heard
        elif (future := self._futures.get(heard)) is not None:
            yield from self._ended(heard, future)

    def _ended(self, work: int, future: Any) -> Iterator[Finished]:
        """Yield the end of a piece of work. Yield nothing if its result does not come in time: it is asked for again later. Yield
        nothing if the work was lost with its worker: other news says so."""
        try:
            if future.status == "finished":
                result = future.result(timeout=GATHER_S)
                del self._futures[work]
                yield Finished(work, result)
            elif future.status == "error":
                error = future.exception(timeout=GATHER_S)
                if type(error).__name__ != "KilledWorker":
                    del self._futures[work]
                    yield Finished(work, Raised(error))
            elif future.status == "cancelled":
                raise self._lost()
        except OSError:
            # the result is late: a worker or this machine was frozen or cut off; if the worker is lost, other news says so
            self._news.put(work)
        except CancelledError as error:
            raise self._lost() from error

    def _compare_workers(self) -> None:
        """Check that the scheduler is there, and every `COMPARE_S` that it has the same workers as `_workers`."""
        if self._client.status != "running":
            raise self._lost()
        if time.monotonic() - self._compared < COMPARE_S:
            return
        try:
            there = set(self._client.nthreads())
        except (OSError, ValueError, CancelledError) as error:
            raise self._lost() from error
        self._compared = time.monotonic()
        for worker in self._workers - there:
            self._news.put(WorkerLost(worker, expected=False))
        for worker in there - self._workers:
            self._news.put(WorkerJoined(worker))

    def _wait_until_idle(self) -> None:
        """Send every worker a call that ends only when the worker has no other task, and wait for these calls."""
        until = time.monotonic() + STOP_S
        sent = [self._submitted(f"end-{place}", worker, wait_until_idle) for place, worker in enumerate(self._workers)]
        for future in sent:
            future.result(timeout=max(until - time.monotonic(), 0.01))

    def _lost(self) -> ClusterError:
        return ClusterError(
            f"the scheduler at {self.address} does not answer any more; finished maps are kept: start it and its workers "
            "again, then give the same command with --resume, without --overwrite"
        )
