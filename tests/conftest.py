"""Tests run as in the foreground, and with programs of other makers if they are installed."""

import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest

from cadtof_cli import errors
from tests.support.needed import miss
from tests.support.outside_tools import MAKERS, run_tool

Tool = Callable[..., str]

ROOT = Path(__file__).parents[1]


def pytest_configure(config: pytest.Config) -> None:
    """Undo what a user has set for kernels, terminals, dask and warnings, and let programs that tests start be stopped.

    In the background, shells and `nohup` make programs ignore signals.
    """
    for name in tuple(os.environ):
        if name in {"CADTOF_KERNEL", "CDPATH", "COLUMNS", "LINES", "PYTHONWARNINGS"} or name.startswith("DASK_"):
            del os.environ[name]
    if "MPLCONFIGDIR" not in os.environ and not os.access(f"{os.environ.get('HOME')}/.", os.W_OK):
        # without a home, matplotlib would say so on stderr, and list the fonts again in every process
        os.environ["MPLCONFIGDIR"] = folder = tempfile.mkdtemp()
        config.add_cleanup(lambda: shutil.rmtree(folder))
    for name, handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, handler)
    # no deadline: the time of an example depends on how busy the machine is
    hypothesis.settings.register_profile("any machine", deadline=None)
    hypothesis.settings.load_profile("any machine")


def pytest_terminal_summary(terminalreporter: "pytest.TerminalReporter") -> None:
    """After failures, say if C code has changed since it was compiled: pytest does not compile it."""
    files = [file for file in (ROOT / "cadtof_cli" / "resolver").rglob("*") if file.is_file()]
    built = [file.stat().st_mtime for file in files if file.suffix in {".so", ".pyd"}]
    if terminalreporter.stats.get("failed") and built:
        for file in files:
            if file.suffix in {".c", ".h"} and file.stat().st_mtime > max(built):
                told = "is newer than the compiled modules: .venv/bin/python setup.py build_ext --inplace"
                terminalreporter.write_line(f"{file.relative_to(ROOT)} {told}")


@pytest.fixture
def no_memory_for_scipy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let scipy count as not yet imported, and take more memory than any machine has."""
    monkeypatch.delitem(sys.modules, "scipy", raising=False)
    monkeypatch.setattr(errors, "SCIPY_BYTES", 2**62)


@pytest.fixture
def tool() -> Tool:
    """Return a function that runs a program and returns what it prints; a missing one skips the test, but fails it under CI."""

    def run(name: str, *arguments: str | Path) -> str:
        printed = run_tool(name, *arguments)
        if printed is None:
            miss(f"{name} of {MAKERS[name].name} is not installed")
        return printed

    return run
