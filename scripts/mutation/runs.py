"""Mutants against tests: in a copy of the tree, a fork for each, the likeliest and the quickest tests first."""

import contextlib
import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import pytest

from mutation.mutants import Mutant, mutated
from mutation.reach import reaches

LEFT_BEHIND = (".git", ".venv*", "out", "__pycache__", ".*_cache", ".hypothesis", "docs", "build", "dist")

CONTRACTS = "contracts"

MEMORY_BYTES = 6 * 2**30

PATIENCE = 3.0
"""Times the duration of the unchanged tests, and …"""

LEAST_PATIENCE_S = 15.0
"""… at least this long, before a mutant counts as one that never ends."""

OPTIONS = (
    *("-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=line", "--hypothesis-seed=0"),
    # hypothesis is there before pytest, which warns that it cannot look into its assertions
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),
)

USAGE_ERRORS = frozenset((pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.NO_TESTS_COLLECTED))


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant: `killed`, `endless`, or `survived`, after how many seconds, by which room's tests."""

    mutant: Mutant
    verdict: str
    seconds: float
    by: str


class _Durations:
    """A pytest plugin that adds up how long the tests of each file take."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Take in one test's setup, call or teardown."""
        file = report.nodeid.split("::")[0]
        self.seconds[file] = self.seconds.get(file, 0.0) + report.duration


class Bench:
    """A copy of a tree where mutants are tried one after the other."""

    def __init__(self, root: Path, place: Path, seconds: Mapping[str, float] | None = None) -> None:
        self.tree = place / "tree"
        shutil.copytree(root, self.tree, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_BEHIND))
        self._log = place / "log.txt"
        self._clock = time.time() + 10.0
        self._seconds = dict(seconds or {})

    def measured(self, rooms: tuple[str, ...]) -> dict[str, float]:
        """Run the unchanged tests, which must pass, and return how many seconds each file takes."""
        for room in (*rooms, CONTRACTS):
            code, _ = self._run(self._files(room), 600.0)
            if code != pytest.ExitCode.OK:
                raise SystemExit(f"tests/{room} fail without any mutant:\n{self._log.read_text()[-4000:]}")
            self._seconds |= json.loads((self.tree / "durations.json").read_text())
        return self._seconds

    def tried(self, mutant: Mutant) -> Outcome:
        """Return what becomes of a mutant."""
        path = self.tree / mutant.path
        source = path.read_text(encoding="utf-8")
        self._write(path, mutated(source, mutant))
        begin = time.monotonic()
        try:
            for room in (mutant.room, CONTRACTS):
                files = self._ordered(room, mutant)
                if not files:
                    continue
                patience = max(PATIENCE * sum(self._seconds.get(file, 0.0) for file in files), LEAST_PATIENCE_S)
                code, ended = self._run(files, patience)
                if code in USAGE_ERRORS:
                    raise SystemExit(f"pytest could not run tests/{room}:\n{self._log.read_text()[-4000:]}")
                if code != pytest.ExitCode.OK:
                    return Outcome(mutant, "killed" if ended else "endless", time.monotonic() - begin, room)
        finally:
            self._write(path, source)
        return Outcome(mutant, "survived", time.monotonic() - begin, "")

    def _files(self, room: str) -> list[str]:
        return sorted(str(path.relative_to(self.tree)) for path in (self.tree / "tests" / room).rglob("test_*.py"))

    def _ordered(self, room: str, mutant: Mutant) -> list[str]:
        """Return the test files of a room that reach the module: that of its name, those that name it, and the others."""
        stem = Path(mutant.path).stem
        module = ".".join(Path(mutant.path).with_suffix("").parts)
        files = [file for file in self._files(room) if reaches(self.tree, self.tree / file, module)]

        def rank(file: str) -> tuple[int, float]:
            near = 0 if Path(file).stem == f"test_{stem}" else 2
            if near and module in (self.tree / file).read_text(encoding="utf-8"):
                near = 1
            return near, self._seconds.get(file, 0.0)

        return sorted(files, key=rank)

    def _write(self, path: Path, text: str) -> None:
        """Write a module with a time of its own, so that no compiled one from before is taken for it."""
        path.write_text(text, encoding="utf-8")
        self._clock += 2.0
        os.utime(path, (self._clock, self._clock))

    def _run(self, files: list[str], patience_s: float) -> tuple[int, bool]:
        """Run test files in a fork of this process; return pytest's exit code, and whether it ended by itself."""
        child = os.fork()
        if child == 0:
            self._be_pytest(files)
        deadline = time.monotonic() + patience_s
        while True:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                _kill_group(child)
                return os.waitstatus_to_exitcode(status), True
            if time.monotonic() > deadline:
                _kill_group(child)
                os.waitpid(child, 0)
                return -signal.SIGKILL, False
            time.sleep(0.01)

    def _be_pytest(self, files: list[str]) -> NoReturn:
        code = 99
        try:
            os.setsid()
            log = os.open(self._log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for stream in (1, 2):
                os.dup2(log, stream)
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
            os.chdir(self.tree)
            sys.path.insert(0, str(self.tree))
            durations = _Durations()
            code = int(pytest.main([*OPTIONS, f"--basetemp={self.tree.parent / 'tmp'}", *files], plugins=[durations]))
            (self.tree / "durations.json").write_text(json.dumps(durations.seconds))
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            raise
        finally:
            os._exit(code)


def _kill_group(leader: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(leader, signal.SIGKILL)
