"""Changes of meaning with a name: each replaces texts, wherever in the package they stand."""

import contextlib
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mutation.mutants import PACKAGE
from mutation.runs import CONTRACTS, KERNEL_LIBRARY, Bench

BESIDE = {"workflows": ("cli",)}
"""Folders of tests that belong to a room, besides the folder of the same name."""

Pair = tuple[str, str]
"""The text in the source, and the text that replaces it."""


class GoneError(Exception):
    """A text that a change replaces does not stand in the package exactly once."""


@dataclass(frozen=True)
class Change:
    """A change with a name; `python` and `kernel` are the texts that it replaces in modules and in the C of the kernel.

    `test` is a test that noticed the change when it was last tried; empty if none is known.
    """

    name: str
    python: tuple[Pair, ...]
    kernel: tuple[Pair, ...] = ()
    test: str = ""


def read_changes(path: Path, /) -> tuple[Change, ...]:
    """Return the changes in a file."""
    return tuple(_change(entry) for entry in tomllib.loads(path.read_text(encoding="utf-8"))["change"])


def changed_files(tree: Path, change: Change, /, *, kernel: bool) -> dict[Path, str]:
    """Return the new texts of the files that a change touches: modules, or the C of the kernel.

    Raises:
        GoneError: a text that it replaces is gone, or stands in the package more than once.
    """
    texts: dict[Path, str] = {}
    suffixes = {".c", ".h"} if kernel else {".py"}
    files = sorted(path for path in (tree / PACKAGE).rglob("*") if path.suffix in suffixes)
    for before, after in change.kernel if kernel else change.python:
        path, text = _replaced(files, texts, before, after, change.name)
        texts[path] = text
    return texts


def killer(bench: Bench, change: Change, /, *, kernel: bool) -> str:
    """Return the first test of a change's rooms or of the contracts that fails with the change; empty if none fails.

    With `kernel`, the change is made in the kernel alone, and the tests that compare the kernel with numpy are left
    out.
    """
    modules = [path.relative_to(bench.tree) for path in changed_files(bench.tree, change, kernel=False)]
    rooms = [folder for module in modules for folder in (module.parts[1], *BESIDE.get(module.parts[1], ()))]
    folders = dict.fromkeys((CONTRACTS, "cli", *rooms) if kernel else (*rooms, CONTRACTS))
    files = [file for folder in folders for file in sorted((bench.tree / "tests" / folder).rglob("test_*.py"))]
    if kernel:
        files = [file for file in files if not file.stem.startswith("test_kernel")]
    else:
        stems = {f"test_{module.stem}" for module in modules}
        files.sort(key=lambda file: file.stem not in stems)
    texts = changed_files(bench.tree, change, kernel=kernel)
    with bench.changed(texts, kernel=kernel), _compiled_anew(bench.tree) if kernel else contextlib.nullcontext():
        known = bench.failing([change.test]) if change.test else ""
        return known or bench.failing([str(file.relative_to(bench.tree)) for file in files])


@contextlib.contextmanager
def _compiled_anew(tree: Path) -> Iterator[None]:
    """Replace the tree's kernel for a while by one that is compiled from the changed C."""
    (there,) = (tree / PACKAGE).rglob(KERNEL_LIBRARY)
    before = there.read_bytes()
    # -O1 gives the same bits as -O3, and compiles in a fifth of the time
    setup = tree / "setup.py"
    setup.write_text(setup.read_text(encoding="utf-8").replace('"-O3"', '"-O1"'), encoding="utf-8")
    with tempfile.TemporaryDirectory() as place:
        # call setuptools directly: an environment made by uv has no pip
        command = [sys.executable, "setup.py", "--quiet", "build_ext", "--build-lib", place, "--build-temp", place]
        subprocess.run(command, check=True, cwd=tree)
        (made,) = Path(place).rglob(KERNEL_LIBRARY)
        after = made.read_bytes()
    if after == before:
        raise GoneError("the changed kernel was not compiled, or is the same as the unchanged one")
    try:
        there.unlink()
        there.write_bytes(after)
        yield
    finally:
        there.unlink()
        there.write_bytes(before)


def _replaced(files: list[Path], texts: Mapping[Path, str], before: str, after: str, name: str) -> tuple[Path, str]:
    pattern = re.compile(r"\s+".join(map(re.escape, before.split())))
    found = []
    for path in files:
        text = texts.get(path) or path.read_text(encoding="utf-8")
        found += [(path, text, match) for match in pattern.finditer(text)]
    if len(found) != 1:
        raise GoneError(
            f"{name}: {before!r} stands in the package {len(found)} times, expected once: correct named.toml"
        )
    ((path, text, match),) = found
    return path, text[: match.start()] + after + text[match.end() :]


def _change(entry: Mapping[str, Any]) -> Change:
    pairs = {key: tuple((before, after) for before, after in entry.get(key, ())) for key in ("python", "kernel")}
    return Change(entry["name"], pairs["python"], pairs["kernel"], entry.get("test", ""))
