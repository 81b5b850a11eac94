"""Try mutants against tests: in a copy of the tree, each in a fork, the likeliest and the quickest tests first."""

import ast
import contextlib
import itertools
import math
import os
import pickle
import re
import shutil
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path

import pytest

from mutation.calls import Calls, Chosen, Watch, file_of
from mutation.mutants import PACKAGE, Mutant, mutated
from mutation.reach import reaches
from mutation.session import NOT_PUT_IN, TOOL_FAILED, Request, Session, end_with, ended, limit

LEFT_BEHIND = (".git", ".venv*", "out", "__pycache__", ".*_cache", ".hypothesis", "build", "dist")

INNER = frozenset(("optics", "phasors", "resolver", "maps", "calibration", "simulation"))
"""Rooms whose tests call them directly: their mutants are tried against these tests and the contracts. …"""

CONTRACTS = "contracts"

OUTER = (
    *("capture", "cli", "commands", CONTRACTS, "doubts", "execution", "files", "pipeline", "report", "workflows"),
    *("simulation/test_record.py", "test_api.py", "test_first_phasor.py"),
)
"""… Mutants of all other rooms are tried against these folders and files of tests: what such rooms do for a user is
tested by commands."""

KERNEL_LIBRARY = "_kernel*.so"

COMPILED_LIBRARIES = "_*.so"

KERNEL_FRONTS = frozenset(("kernels", "kernel"))
"""Modules whose mutants are tried with the compiled kernel."""

KERNEL_CALLS = frozenset(("extension", "compiled_search", "compiled"))
"""If a function calls one of these, or a function of a module of that name, its mutants are tried with the compiled
kernel, too. For all other mutants, numpy does the work: tests must notice what a change does, not that numpy and the
kernel differ."""

PATIENCE = 3.0
"""A mutant counts as endless after this many times the duration of the unchanged tests, …"""

LEAST_PATIENCE_S = 15.0
"""… but not before this processor time."""

FIRST_S = 2.0
"""Every mutant is tried first against the quickest tests that may notice it, which take this time in all. The other
tests follow when this is done for all mutants."""

NEAR_FIRST = (0.1, 0.3, 1.0)
"""Factors on the durations by which tests are sorted: tests of the mutant's own module, tests that name the module,
and all other tests."""

OPTIONS = (
    *("-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=line", "--hypothesis-seed=0"),
    # hypothesis is imported before pytest; pytest then warns that it cannot rewrite the assertions of hypothesis
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),
)

FAILED = r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$"
"""A test that failed, in what pytest prints."""

NOTED = frozenset((pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED))

USAGE_ERRORS = frozenset((pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.NO_TESTS_COLLECTED))


@dataclass(frozen=True)
class Outcome:
    """The outcome of a mutant, `killed`, `endless` or `survived`, and the seconds until then."""

    mutant: Mutant
    verdict: str
    seconds: float


class Bench:
    """A copy of a tree in which mutants are tried one after the other, against tests that take at most `most_s` in all.

    `kernel`: all mutants are tried with the compiled kernel.
    """

    def __init__(
        self, root: Path, place: Path, calls: Calls | None = None, most_s: float = math.inf, *, kernel: bool = False
    ) -> None:
        self.tree = place / "tree"
        shutil.copytree(root, self.tree, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_BEHIND))
        self._kernels = {path: place / path.name for path in (self.tree / PACKAGE).rglob(COMPILED_LIBRARIES)}
        self._kernel = kernel
        self._use_kernel(kernel)
        self._log = place / "log.txt"
        self._clock = time.time() + 10.0
        self._calls = calls or Calls()
        self._most_s = most_s
        self._noted = place / "calls.pickle"
        self._handing = dict[Mutant, bool]()
        self._failed = frozenset[str]()

    def watched(self, rooms: tuple[str, ...]) -> Calls:
        """Run the unchanged tests, and return which lines each of them runs, and how long it takes."""
        for part in dict.fromkeys(part for room in rooms for part in tests_of(room)):
            code, _ = self._run(self._files(part), 3600.0, Watch(self.tree / PACKAGE, self._noted.parent))
            if code not in {*NOTED, pytest.ExitCode.NO_TESTS_COLLECTED}:
                raise SystemExit(f"tests/{part} cannot be run:\n{self._log.read_text()[-4000:]}")
            self._calls |= pickle.loads(self._noted.read_bytes())
        return self._calls

    def tried(self, mutant: Mutant, *, quick: bool) -> Outcome:
        """Try a mutant against the quick tests that may notice it, or against the other tests that may; return the outcome.

        A test that fails without the mutant, too, kills nothing: it is told and left out.
        """
        path, kernel = self.tree / mutant.path, self._of_kernel(mutant)
        before = path.read_text(encoding="utf-8")
        text = mutated(before, mutant)
        if self._by_session(mutant):
            # it imports the package, and must not import the change
            _ = self._waiting
        begin, left_out = time.monotonic(), frozenset[str]()
        while True:
            with self.changed({path: text}, kernel=kernel):
                files, tests = self._portion(mutant, quick=quick, left_out=left_out)
                patience = max(PATIENCE * sum(self._seconds(test) for test in tests), LEAST_PATIENCE_S)
                code, by_itself = self._outcome(mutant, before, files, tests, patience) if tests else (0, True)
            if code == pytest.ExitCode.OK:
                return Outcome(mutant, "survived", time.monotonic() - begin)
            failed = self._failed & tests if code == pytest.ExitCode.TESTS_FAILED else frozenset[str]()
            if not by_itself or not failed or not self._fail_anyway(failed, mutant, kernel=kernel):
                return Outcome(mutant, "killed" if by_itself else "endless", time.monotonic() - begin)
            print(f"fails without any mutant, too: {', '.join(failed)}", file=sys.stderr)
            left_out |= failed

    def _fail_anyway(self, tests: frozenset[str], mutant: Mutant, *, kernel: bool) -> bool:
        """Return whether tests that failed with a mutant fail in the same way of running them without it."""
        patience = max(PATIENCE * sum(self._seconds(test) for test in tests), LEAST_PATIENCE_S)
        with self.changed({}, kernel=kernel):
            if self._by_session(mutant):
                code, _ = self._waiting.tried(Request(None, "", tuple(tests), patience))
            else:
                code, _ = self._run(sorted(map(file_of, tests)), patience, Chosen(tests))
        return code != pytest.ExitCode.OK

    def _by_session(self, mutant: Mutant) -> bool:
        """Return whether the waiting session can try a mutant."""
        return self._calls.may_be_put_in(mutant.path, _lines(mutant)) and not self._of_kernel(mutant)

    def _of_kernel(self, mutant: Mutant) -> bool:
        """Return whether a mutant, unlike the others, is tried with the compiled kernel: its code hands work to it.

        The first call must precede the change.
        """
        if self._kernel:
            return False
        if mutant not in self._handing:
            path = self.tree / mutant.path
            handing = path.stem in KERNEL_FRONTS or hands_to_kernel(path.read_text(encoding="utf-8"), mutant.lines[0])
            self._handing[mutant] = handing
        return self._handing[mutant]

    def _outcome(
        self, mutant: Mutant, source: str, files: list[str], tests: frozenset[str], patience_s: float
    ) -> tuple[int, bool]:
        """Run tests against a mutant that is written into the tree, by the waiting session if that gives the same result."""
        if self._by_session(mutant):
            rank = {file: number for number, file in enumerate(files)}
            ordered = sorted(
                (test for test in self._calls.tests if test in tests), key=lambda test: rank[file_of(test)]
            )
            code, by_itself = self._waiting.tried(Request(mutant, source, tuple(ordered), patience_s))
            if code not in {NOT_PUT_IN, TOOL_FAILED}:
                self._failed = frozenset({self._waiting.failed} if code == pytest.ExitCode.TESTS_FAILED else ())
                return code, by_itself
        code, by_itself = self._run(files, patience_s, Chosen(tests))
        if code in {*USAGE_ERRORS, TOOL_FAILED}:
            raise SystemExit(f"pytest could not run {' '.join(files)}:\n{self._log.read_text()[-4000:]}")
        self._failed = frozenset(re.findall(FAILED, self._log.read_text(), re.MULTILINE))
        return code, by_itself

    @cached_property
    def _waiting(self) -> Session:
        files = sorted({file_of(test) for test in self._calls.tests})
        options = [*OPTIONS, f"--basetemp={self.tree.parent / 'tmp'}", *files]
        return Session(self.tree, options, self._log.with_name("session.txt"))

    @contextlib.contextmanager
    def changed(self, texts: Mapping[Path, str], *, kernel: bool) -> Iterator[None]:
        """Replace the texts of some files of the tree for a while, with or without the compiled kernel."""
        before = {path: path.read_text(encoding="utf-8") for path in texts}
        try:
            for path, text in texts.items():
                self._write(path, text)
            self._use_kernel(kernel or self._kernel)
            yield
        finally:
            for path, text in before.items():
                self._write(path, text)

    def failing(self, tests: Sequence[str]) -> str:
        """Run test files or tests in their order, and return the first that fails; empty if all pass."""
        code, _ = self._run(list(tests), 1800.0, None)
        if code == pytest.ExitCode.OK:
            return ""
        failed = re.search(FAILED, self._log.read_text(), re.MULTILINE)
        if code in USAGE_ERRORS or failed is None:
            raise SystemExit(f"pytest could not run {' '.join(tests)}:\n{self._log.read_text()[-4000:]}")
        return failed[1]

    def _use_kernel(self, wanted: bool) -> None:
        """Put the compiled kernel into the tree, or take it out."""
        for there, aside in self._kernels.items():
            if there.exists() != wanted:
                (aside.rename(there) if wanted else there.rename(aside))

    def _files(self, part: str) -> list[str]:
        place = self.tree / "tests" / part
        paths = [place] if place.is_file() else place.rglob("test_*.py")
        return sorted(str(path.relative_to(self.tree)) for path in paths)

    def seconds(self, mutant: Mutant, *, quick: bool) -> float:
        """Return the time in s of the tests that `tried` runs against a mutant, if none fails."""
        return sum(map(self._seconds, self._portion(mutant, quick=quick)[1]))

    def _portion(
        self, mutant: Mutant, *, quick: bool, left_out: frozenset[str] = frozenset()
    ) -> tuple[list[str], frozenset[str]]:
        """Return the quick tests that may notice a mutant, or the others; their files, too. The tests `left_out` are
        not among them.

        Tests of the mutant's module come first. Tests in files that name the module come second, and all others last.
        """
        stem, module = Path(mutant.path).stem, ".".join(Path(mutant.path).with_suffix("").parts)

        def reached(file: str) -> bool:
            return file == mutant.path or reaches(self.tree, self.tree / file, module)

        @cache
        def near(file: str) -> int:
            if Path(file).stem == f"test_{stem}":
                return 0
            return 1 if module in (self.tree / file).read_text(encoding="utf-8") else 2

        files, lines = {file for part in tests_of(mutant.room) for file in self._files(part)}, _lines(mutant)
        of_kernel = self._of_kernel(mutant)
        tests = [
            test
            for test in self._calls.tests
            if file_of(test) in files
            and test not in left_out
            and (of_kernel or self._calls.may_notice(test, mutant.path, lines, reached=reached))
        ]
        # those that may run any lines come last
        tests.sort(
            key=lambda test: (self._calls.tests[test].forks, self._seconds(test) * NEAR_FIRST[near(file_of(test))])
        )
        sums = list(itertools.accumulate(self._seconds(test) for test in tests))
        count, most = (sum(1 for total in sums if total <= limit) for limit in (FIRST_S, self._most_s))
        tests = tests[:count] if quick else tests[count:most]
        seconds: dict[str, float] = defaultdict(float)
        for test in tests:
            seconds[file_of(test)] += self._seconds(test)
        return sorted(seconds, key=lambda file: (near(file), seconds[file])), frozenset(tests)

    def _seconds(self, test: str) -> float:
        return self._calls.tests[test].seconds

    def _write(self, path: Path, text: str) -> None:
        """Write a module with a new modification time, so that Python does not use bytecode of the text before."""
        path.write_text(text, encoding="utf-8")
        self._clock += 2.0
        os.utime(path, (self._clock, self._clock))

    def _run(self, files: list[str], patience_s: float, plugin: Watch | Chosen | None) -> tuple[int, bool]:
        """Run tests in a fork of this process; return pytest's exit code, and whether the fork ended by itself."""
        child = os.fork()
        if child == 0:
            end_with(partial(self._tried, files, patience_s, plugin), self.tree, self._log)
        return ended(child, patience_s)

    def _tried(self, files: list[str], patience_s: float, plugin: Watch | Chosen | None) -> int:
        limit(patience_s)
        # keep the bytecode: unchanged modules are compiled only once
        sys.dont_write_bytecode = False
        options = [*OPTIONS, f"--basetemp={self.tree.parent / 'tmp'}", *files]
        if isinstance(plugin, Watch):
            options.append("--maxfail=0")
            plugin.start()
        code = int(pytest.main(options, plugins=[plugin] if plugin else []))
        if isinstance(plugin, Watch):
            self._noted.write_bytes(pickle.dumps(plugin.calls()))
        return code


def tests_of(room: str, /) -> tuple[str, ...]:
    """Return the folders and files of `tests` that may notice mutants of a room."""
    return (room, CONTRACTS) if room in INNER else OUTER


def hands_to_kernel(source: str, line: int, /) -> bool:
    """Return whether a line of a module stands in a function that calls the compiled kernel."""
    functions = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef))
    around = (node for node in functions if node.lineno <= line <= (node.end_lineno or node.lineno))
    calls = (part.func for node in around for part in ast.walk(node) if isinstance(part, ast.Call))
    return any(ast.unparse(called).partition(".")[0] in KERNEL_CALLS for called in calls)


def _lines(mutant: Mutant) -> range:
    return range(mutant.lines[0], mutant.lines[1] + 1)
