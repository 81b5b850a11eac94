"""The import direction of the design, read from the sources, and what start-up leaves unimported."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.captures import record

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "cadtof_cli"

LATER = {
    "capture": {
        "simulation",
        "phasors",
        "calibration",
        "resolver",
        "maps",
        "workflows",
        "execution",
        "commands",
        "figures",
        "pipeline",
    },
    "phasors": {
        "simulation",
        "calibration",
        "resolver",
        "maps",
        "workflows",
        "execution",
        "commands",
        "figures",
        "pipeline",
    },
    "resolver": {"simulation", "maps", "workflows", "execution", "commands", "figures", "pipeline"},
    "maps": {"simulation", "workflows", "execution", "commands", "figures", "pipeline"},
    "execution": {"capture", "phasors", "resolver", "maps", "workflows", "commands", "figures", "pipeline"},
    "workflows": {"commands", "options", "cli"},
    "figures": {"workflows", "commands", "execution"},
}


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            names.add(node.module or "")
    return names


@pytest.mark.parametrize("part", LATER)
def test_nothing_imports_what_comes_later(part: str) -> None:
    files = sorted((PACKAGE / part).glob("*.py"))
    assert len(files) > 1
    for path in files:
        inner = {name.split(".")[1] for name in imported(path) if name.startswith("cadtof_cli.")}
        assert not inner & LATER[part], path


@pytest.mark.parametrize(
    ("library", "places"),
    [("click", {"cli.py", "options.py", "commands"}), ("matplotlib", {"figures"}), ("rich", {"commands"})],
)
def test_libraries_have_their_places(library: str, places: set[str]) -> None:
    users = [
        path.relative_to(PACKAGE).parts[0]
        for path in PACKAGE.rglob("*.py")
        if any(name.split(".")[0] == library for name in imported(path))
    ]
    assert users
    assert set(users) <= places


def modules_after(*arguments: object) -> set[str]:
    code = (
        "import sys\nfrom cadtof_cli.cli import main\nsys.argv[0] = 'cadtof'\n"
        "try:\n    main()\nexcept SystemExit as ended:\n    assert not ended.code\n"
        "print('MODULES', *{name.split('.')[0] for name in sys.modules})"
    )
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=60
    )
    return set(done.stdout.splitlines()[-1].split()[1:])


def test_help_imports_no_library_but_click() -> None:
    loaded = modules_after("--help")
    assert "click" in loaded
    assert not loaded & {"numpy", "scipy", "matplotlib", "rich", "tifffile", "OpenEXR"}


def test_resolve_without_a_terminal_imports_only_what_it_needs(tmp_path: Path) -> None:
    capture = record(tmp_path / "c").folder
    loaded = modules_after("resolve", capture, "-o", tmp_path / "out", "--jobs", 1)
    assert {"numpy", "tifffile"} <= loaded
    assert not loaded & {"scipy", "matplotlib", "rich"}
