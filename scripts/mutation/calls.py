"""Which functions of the package each test calls: the others' mutants need not be tried against it."""

import importlib
import os
import pkgutil
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

Function = tuple[str, str]
"""File in the tree, and name with the names of what it stands in, as a mutant has it."""

PARTS = frozenset(("<lambda>", "<genexpr>", "<listcomp>", "<setcomp>", "<dictcomp>"))
"""What has a code object of its own, and is no function by name."""


@dataclass(frozen=True)
class Test:
    """A test: how long it takes, which functions it calls, and whether it starts other processes, which may call any."""

    seconds: float
    calls: frozenset[Function]
    forks: bool

    __test__ = False


@dataclass(frozen=True)
class Calls:
    """All tests by node id, and the functions that are called before any test runs, so that all of them depend on these."""

    tests: dict[str, Test] = field(default_factory=dict)
    before: frozenset[Function] = frozenset()

    def __or__(self, other: "Calls") -> "Calls":
        return Calls(self.tests | other.tests, self.before | other.before)

    def may_notice(self, test: str, function: Function, /, *, reached: Callable[[str], bool]) -> bool:
        """Return whether a test may notice a change of a function; `reached` tells which files can reach that function's.

        What stands outside functions may be noticed by whoever reaches it, by the test file's own imports or by those of
        the modules that it calls: rooms are loaded by name, too.
        """
        known = self.tests[test]
        if known.forks or function in self.before or function in known.calls:
            return True
        if function in self.functions:
            return False
        return any(map(reached, {test.split("::", maxsplit=1)[0], *(path for path, _ in known.calls)}))

    @cached_property
    def functions(self) -> frozenset[Function]:
        """All that any test calls."""
        return frozenset().union(*(test.calls for test in self.tests.values()))


class Watch:
    """A pytest plugin that notes what every test calls, and how long it takes.

    What a fixture calls counts for all tests of its file, which may share it. Caches of the package are emptied before each
    test, so that none finds the answer of another's call.
    """

    def __init__(self, package: Path) -> None:
        self._package = package
        self._codes: dict[str, dict[int, CodeType]] = {"": {}}
        self._now = self._codes[""]
        self._test = ""
        self._forks: set[str] = set()
        self._seconds: dict[str, float] = {}

    def start(self) -> None:
        """Begin to note; before the package is imported."""
        os.register_at_fork(before=self._note_fork)
        sys.addaudithook(lambda event, _: self._note_fork() if event == "subprocess.Popen" else None)
        threading.settrace(self._trace)
        sys.settrace(self._trace)
        for module in pkgutil.walk_packages([str(self._package)], f"{self._package.name}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        """Note what fixtures call for the whole file."""
        _empty_caches(self._package.name)
        self._test = item.nodeid
        self._now = self._codes.setdefault(item.nodeid.split("::")[0], {})
        yield

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """Note what the test itself calls."""
        self._now = self._codes.setdefault(item.nodeid, {})
        sys.settrace(self._trace)
        yield

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add up how long setup, call and teardown take."""
        self._seconds[report.nodeid] = self._seconds.get(report.nodeid, 0.0) + report.duration

    def calls(self) -> Calls:
        """Return what was noted."""
        called = {name: self._functions(codes) for name, codes in self._codes.items()}
        none: frozenset[Function] = frozenset()
        tests = {
            name: Test(seconds, called.get(name, none) | called.get(name.split("::")[0], none), name in self._forks)
            for name, seconds in self._seconds.items()
        }
        return Calls(tests, called[""])

    def _functions(self, codes: dict[int, CodeType]) -> frozenset[Function]:
        names = set()
        for code in codes.values():
            path = Path(code.co_filename)
            if path.is_relative_to(self._package):
                parts = [part for part in code.co_qualname.split(".") if part != "<locals>" and part not in PARTS]
                names.add((str(path.relative_to(self._package.parent)), ".".join(parts)))
        return frozenset(names)

    def _trace(self, frame: FrameType, event: str, argument: object) -> None:
        self._now[id(frame.f_code)] = frame.f_code

    def _note_fork(self) -> None:
        self._forks.add(self._test)


class Chosen:
    """A pytest plugin that leaves out all tests but some."""

    def __init__(self, tests: frozenset[str]) -> None:
        self._tests = tests

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the chosen tests."""
        items[:] = [item for item in items if item.nodeid in self._tests]


def _empty_caches(package: str) -> None:
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] in {package, "tests"}:
            for value in list(vars(module).values()):
                empty = getattr(value, "cache_clear", None)
                if callable(empty):
                    empty()
