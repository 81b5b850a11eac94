"""Note which lines of the package each test runs: mutants of all other lines need not be tried against it."""

import importlib
import os
import pkgutil
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coverage
import pytest

Lines = Mapping[str, frozenset[int]]
"""Line numbers, by file in the tree."""

_ONCE = "once, below "
"""Prefix of a coverage context, before a folder: lines of fixtures that are set up once for all tests below this folder."""


@dataclass(frozen=True)
class Test:
    """A test: its processor time in s, the lines that it runs, and whether it may run any lines: it starts processes of
    which none says what it runs, or it fails while it is watched."""

    seconds: float
    lines: Lines
    forks: bool

    __test__ = False


@dataclass(frozen=True)
class Calls:
    """All tests by node id, and the lines that run before any test does: what they compute may be used anywhere."""

    tests: Mapping[str, Test] = field(default_factory=dict)
    before: Lines = field(default_factory=dict)

    def __or__(self, other: "Calls") -> "Calls":
        return Calls({**self.tests, **other.tests}, _joined([self.before, other.before]))

    def may_notice(self, test: str, path: str, lines: range, /, *, reached: Callable[[str], bool]) -> bool:
        """Return whether a test may notice a change of some lines of a file; `reached` tells which files reach that
        file.

        If the lines run on import, a test may notice the change if its own file reaches them by its imports, or a
        module that the test runs, because rooms are also loaded by name.
        """
        known = self.tests[test]
        if known.forks or not known.lines.get(path, frozenset()).isdisjoint(lines):
            return True
        if self.before.get(path, frozenset()).isdisjoint(lines):
            return False
        return any(map(reached, {file_of(test), *known.lines}))

    def may_be_put_in(self, path: str, lines: range, /) -> bool:
        """Return whether some lines of a file can be changed after the imports, because none of them runs before a test."""
        return self.before.get(path, frozenset()).isdisjoint(lines)


class Watch:
    """A pytest plugin that notes which lines every test runs, and how long it takes.

    Lines that a fixture runs count for all tests of the same file, because they may share the fixture. Lines of a
    fixture that is set up once for many files count for all tests in its folder. The caches of the package are emptied
    before each test, so that no test finds an answer there that another test has computed. Programs that a test starts
    write the lines that they run into the folder `place`.
    """

    def __init__(self, package: Path, place: Path) -> None:
        self._package = package
        self._place = place
        self._coverage = coverage.Coverage(data_file=None, source=[str(package)], config_file=False, messages=False)
        self._test = ""
        self._forks: set[str] = set()
        self._failed: set[str] = set()
        self._by_programs = defaultdict[str, Lines](dict)
        self._seconds: dict[str, float] = {}

    def start(self) -> None:
        """Begin to note. It must be called before the package is imported."""
        os.register_at_fork(before=self._note_fork)
        sys.addaudithook(lambda event, _: self._note_fork() if event == "subprocess.Popen" else None)
        settings = self._place / "coverage.ini"
        options = {
            "parallel": True,
            "data_file": self._place / "lines",
            "source": self._package,
            "patch": "_exit, fork",
        }
        settings.write_text("[run]\n" + "".join(f"{name} = {value}\n" for name, value in options.items()))
        os.environ["COVERAGE_PROCESS_START"] = str(settings)
        os.register_at_fork(after_in_child=self._watch_fork)
        self._coverage.start()
        import_all(self._package)

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        """Count the lines that fixtures run for the whole file."""
        _empty_caches(self._package.name)
        self._test = item.nodeid
        self._coverage.switch_context(file_of(item.nodeid))
        yield

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        """Count the lines of a fixture that is set up once for many files for all of these files."""
        once = fixturedef.scope in {"session", "package"}
        if once:
            self._coverage.switch_context(_ONCE + fixturedef.baseid)
        yield
        if once:
            self._coverage.switch_context(file_of(self._test))

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """Note the lines that the test itself runs."""
        self._coverage.switch_context(item.nodeid)
        yield
        self._coverage.switch_context(file_of(item.nodeid))

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Note the processor time of a test, including that of the processes that it starts, and the lines that these run."""
        before = sum(os.times()[:4])
        yield
        self._seconds[item.nodeid] = sum(os.times()[:4]) - before
        for path in self._place.glob("lines.*"):
            data = coverage.CoverageData(basename=path)
            # a process that was killed leaves a file that cannot be read
            with suppress(coverage.CoverageException):
                data.read()
                ran = {file: frozenset(data.lines(file) or ()) for file in data.measured_files()}
                of_package = {str(Path(file).relative_to(self._package.parent)): lines for file, lines in ran.items()}
                self._by_programs[item.nodeid] = _joined([self._by_programs[item.nodeid], of_package])
            path.unlink(missing_ok=True)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note the tests that fail, perhaps only because they are watched: their lines are not known."""
        if report.failed:
            self._failed.add(report.nodeid)

    def calls(self) -> Calls:
        """Return what was noted."""
        self._coverage.stop()
        noted = self._noted()
        folders = [context.removeprefix(_ONCE) for context in noted if context.startswith(_ONCE)]
        tests = {}
        for name, seconds in self._seconds.items():
            contexts = [name, file_of(name), *(_ONCE + folder for folder in folders if name.startswith(folder))]
            told = self._by_programs[name]
            lines = _joined([*(noted.get(context, {}) for context in contexts), told])
            tests[name] = Test(seconds, lines, name in self._failed or (name in self._forks and not told))
        return Calls(tests, noted.get("", {}))

    def _noted(self) -> dict[str, Lines]:
        """Return the lines of every context."""
        data, found = self._coverage.get_data(), defaultdict[str, dict[str, set[int]]](lambda: defaultdict(set))
        for file in data.measured_files():
            path = str(Path(file).relative_to(self._package.parent))
            for line, contexts in data.contexts_by_lineno(file).items():
                for context in contexts:
                    found[context][path].add(line)
        return {context: {path: frozenset(lines) for path, lines in files.items()} for context, files in found.items()}

    def _watch_fork(self) -> None:
        """In a fork of this process: write its lines into a file, as programs do."""
        self._coverage.stop()
        coverage.process_startup(force=True)

    def _note_fork(self) -> None:
        self._forks.add(self._test)


class Chosen:
    """A pytest plugin that keeps only the chosen tests."""

    def __init__(self, tests: frozenset[str]) -> None:
        self._tests = tests

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the chosen tests."""
        items[:] = [item for item in items if item.nodeid in self._tests]


def import_all(package: Path, /) -> None:
    """Import every module of a package."""
    for module in pkgutil.walk_packages([str(package)], f"{package.name}."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)


def _joined(parts: list[Lines]) -> Lines:
    found = defaultdict[str, frozenset[int]](frozenset)
    for part in parts:
        for path, lines in part.items():
            found[path] |= lines
    return dict(found)


def file_of(test: str, /) -> str:
    """Return the file of a test's node id."""
    return test.split("::", maxsplit=1)[0]


def _empty_caches(package: str) -> None:
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] in {package, "tests"}:
            for value in list(vars(module).values()):
                empty = getattr(value, "cache_clear", None)
                if callable(empty):
                    empty()
