"""A session of pytest that has collected all tests and waits. Each mutant gets a fork of it, with the changed
functions.

The fork imports and collects nothing again, so a mutant costs only the time of its tests.
"""

import ast
import gc
import multiprocessing
import os
import resource
import signal
import sys
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType, FunctionType
from typing import NoReturn

import pytest

from mutation.calls import import_all
from mutation.mutants import PACKAGE, Mutant, mutated_module

NOT_PUT_IN = 98
"""Exit code if a change cannot be put into the existing functions."""

TOOL_FAILED = 97
"""Exit code if something other than a test failed, which says nothing about the mutant."""

MEMORY_BYTES = 6 * 2**30

WAITS = 20
"""A mutant may take this many times its processor time on the clock, because other programs may keep the processor busy."""


class NotPutInError(Exception):
    """An existing function has no changed function that matches it, or one that takes other names from the scopes
    around it."""


@dataclass(frozen=True)
class Request:
    """A mutant, the unchanged text of its file, the tests to run in order, and their limit of processor time. Without a
    mutant, the tests run with the code as it is."""

    mutant: Mutant | None
    source: str
    tests: tuple[str, ...]
    patience_s: float


class Session:
    """The waiting process, as seen by its parent.

    It has imported the package when the constructor returns: a file of the package that is changed only then is not
    imported as it is changed.
    """

    def __init__(self, tree: Path, options: Sequence[str], log: Path) -> None:
        self._connection, theirs = multiprocessing.Pipe()
        self._failed = log.with_name("failed.txt")
        if os.fork() == 0:
            self._connection.close()
            end_with(partial(_wait_for_requests, tree, options, theirs, self._failed), tree, log)
        theirs.close()
        try:
            self._connection.recv()
        except EOFError:
            raise SystemExit(f"pytest could not collect the tests:\n{log.read_text()[-4000:]}") from None

    @property
    def failed(self) -> str:
        """The test that failed last."""
        return self._failed.read_text(encoding="utf-8")

    def tried(self, request: Request, /) -> tuple[int, bool]:
        """Run the tests of a request; return their exit code, and whether they ended by themselves."""
        self._connection.send(request)
        code, ended = self._connection.recv()
        return int(code), bool(ended)


def put_in(path: Path, module: ast.Module, /) -> None:
    """Replace the code of the functions of a file that is already imported by their code in `module`.

    Raises:
        NotPutInError: a function has no counterpart in `module`, or none that fits.
    """
    codes = defaultdict[tuple[str, int], list[CodeType]](list)
    for code in _codes(compile(module, str(path), "exec")):
        codes[code.co_qualname, code.co_firstlineno].append(code)
    for function in gc.get_objects():
        if isinstance(function, FunctionType) and function.__code__.co_filename == str(path):
            old = function.__code__
            found = codes[old.co_qualname, old.co_firstlineno]
            if len(found) != 1 or found[0].co_freevars != old.co_freevars:
                raise NotPutInError(old.co_qualname)
            function.__code__ = found[0]


def limit(patience_s: float, /) -> None:
    """Make this process the leader of a process group, and limit its processor time and its memory.

    SIGINT interrupts this process, as some tests need; a process that a shell starts in the background would ignore it.
    """
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (int(patience_s) + 1, int(patience_s) + 2))


def ended(child: int, patience_s: float, /) -> tuple[int, bool]:
    """Wait for a process and end its group; return its exit code, and whether it ended by itself."""
    deadline = time.monotonic() + WAITS * patience_s
    while True:
        there, status = os.waitpid(child, os.WNOHANG)
        if there:
            _kill_group(child)
            code = os.waitstatus_to_exitcode(status)
            return code, code not in {-signal.SIGXCPU, -signal.SIGKILL}
        if time.monotonic() > deadline:
            _kill_group(child)
            os.waitpid(child, 0)
            return -signal.SIGKILL, False
        time.sleep(0.005)


def end_with(run: Callable[[], int], tree: Path, log: Path, /) -> NoReturn:
    """Call `run` in the tree, with its output in the log; then end this process, a fork, with the exit code that
    `run` returns."""
    code = TOOL_FAILED
    try:
        target = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(target, stream)
        os.chdir(tree)
        sys.path.insert(0, str(tree))
        code = run()
    except BaseException:
        traceback.print_exc()
        raise
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _wait_for_requests(tree: Path, options: Sequence[str], connection: Connection, failed: Path) -> int:
    import_all(tree / PACKAGE)
    return int(pytest.main(list(options), plugins=[_Waiting(tree, connection, failed)]))


class _Waiting:
    """A pytest plugin that answers requests: it runs the tests of each request in a fork."""

    def __init__(self, tree: Path, connection: Connection, failed: Path) -> None:
        self._tree = tree
        self._connection = connection
        self._failed = failed

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Answer requests until the parent closes the connection."""
        items = {item.nodeid: item for item in session.items}
        with suppress(EOFError):
            self._connection.send(None)
            while True:
                request: Request = self._connection.recv()
                child = os.fork()
                if child == 0:
                    self._run(session, [items[test] for test in request.tests], request)
                self._connection.send(ended(child, request.patience_s))
        return True

    def _run(self, session: pytest.Session, items: list[pytest.Item], request: Request) -> NoReturn:
        code = TOOL_FAILED
        try:
            limit(request.patience_s)
            if request.mutant:
                put_in(self._tree / request.mutant.path, mutated_module(request.source, request.mutant))
            for item, following in zip(items, [*items[1:], None], strict=True):
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if session.testsfailed:
                    self._failed.write_text(item.nodeid, encoding="utf-8")
                    break
            code = int(session.testsfailed > 0)
        except NotPutInError:
            code = NOT_PUT_IN
        finally:
            os._exit(code)


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _kill_group(leader: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(leader, signal.SIGKILL)
