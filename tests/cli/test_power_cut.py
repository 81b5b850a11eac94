"""A disk that loses power: everything that was not synchronised is gone, and every file that is left is whole."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support.captures import record
from tests.support.needed import miss
from tests.support.processes import session_is_over
from tests.support.run_cadtof import ENVIRONMENT, PROGRAM, program
from tests.support.runs import maps_of, require_same_run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the layer is preloaded, as Linux does")

_SOURCE = Path(__file__).parents[1] / "support" / "power_cut.c"


@pytest.fixture(scope="module")
def layer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library that records what is synchronised, compiled by the compiler of the system; processes preload it."""
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        miss("no C compiler is installed")
    library = tmp_path_factory.mktemp("layer") / "power_cut.so"
    options = ("-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", "-O1")
    subprocess.run([compiler, *options, "-o", str(library), str(_SOURCE), "-ldl"], check=True)
    return library


def _environment(layer: Path, memory: Path) -> dict[str, str]:
    memory.mkdir()
    # LD_PRELOAD separates its libraries by spaces, and a folder may have one in its name
    return {
        **ENVIRONMENT,
        "LD_PRELOAD": layer.name,
        "LD_LIBRARY_PATH": str(layer.parent),
        "POWER_CUT": str(memory),
    }


def _synchronised(out: Path, memory: Path) -> dict[str, int]:
    """Return the names that a folder had when it was last synchronised, each with the inode of its file."""
    kept = memory / f"{out.stat().st_ino}.names"
    lines = kept.read_text().splitlines() if kept.exists() else []
    return {name: int(inode) for inode, name in (line.split(" ", 1) for line in lines)}


def _lose_power(out: Path, memory: Path, *, names_too: bool) -> None:
    """Replace a folder by what the disk still has of it after a power cut.

    Each file has the content that was synchronised last. With `names_too`, only names that were synchronised are left;
    otherwise all names are.
    """
    names = _synchronised(out, memory) if names_too else {path.name: path.stat().st_ino for path in out.iterdir()}
    contents = {name: memory / str(inode) for name, inode in names.items()}
    left = {name: file.read_bytes() if file.exists() else b"" for name, file in contents.items()}
    shutil.rmtree(out)
    out.mkdir()
    for name, content in left.items():
        (out / name).write_bytes(content)


def test_the_layer_drops_what_was_not_synchronised(layer: Path, tmp_path: Path) -> None:
    out, memory = tmp_path / "out", tmp_path / "memory"
    out.mkdir()
    script = """
import os, sys
for name, synchronised in (("kept", True), ("lost", False), ("half", True)):
    with open(f"{sys.argv[1]}/{name}", "w") as file:
        file.write("first")
        file.flush()
        if synchronised:
            os.fsync(file.fileno())
        if name == "half":
            file.write("second")
"""
    subprocess.run([sys.executable, "-c", script, str(out)], env=_environment(layer, memory), check=True)
    _lose_power(out, memory, names_too=False)
    assert {path.name: path.read_text() for path in out.iterdir()} == {"kept": "first", "lost": "", "half": "first"}


@pytest.mark.parametrize("names_too", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_a_run_is_resumed_after_power_was_lost(share: float, names_too: bool, layer: Path, tmp_path: Path) -> None:
    capture, out, fresh = record(tmp_path / "A", frames=12), tmp_path / "out", tmp_path / "fresh"
    assert program("resolve", capture.folder, "-o", fresh, "-j", 2).status == 0
    whole, memory = maps_of(fresh), tmp_path / "memory"
    command = [*PROGRAM, "resolve", str(capture.folder), "-o", str(out), "-j", "2", "-q"]
    process = subprocess.Popen(command, env=_environment(layer, memory), start_new_session=True)
    deadline = time.monotonic() + 60
    while process.poll() is None:
        assert time.monotonic() < deadline
        names = _synchronised(out, memory) if names_too and out.exists() else [path.name for path in out.glob("*")]
        if sum(name in whole for name in names) > share * 12:
            break
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    # a worker may be in the middle of renaming a file
    assert session_is_over(process.pid, 60)
    _lose_power(out, memory, names_too=names_too)
    left = maps_of(out)
    assert left
    assert all(content == whole[name] for name, content in left.items())
    json.loads((out / "run.json").read_text())
    assert program("resolve", capture.folder, "-o", out, "-j", 2, "--resume").status == 0
    require_same_run(out, fresh)
