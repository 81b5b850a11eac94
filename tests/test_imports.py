"""Which part may import which: files → voltages → phasors → paths → maps. Libraries stay where they are used."""

import ast
import graphlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from cadtof_cli.cli import COMMANDS
from tests.support.captures import record
from tests.support.loaded import COMMAND_LINE, loaded_modules

PACKAGE = Path(__file__).parents[1] / "cadtof_cli"

ANYBODY = {"errors", "units", "arrays", "records", "version"}

ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "units": set(),
    "arrays": set(),
    "records": set(),
    "version": set(),
    "execution": set(),
    "files": set(),
    "capture": {"files"},
    "optics": {"capture"},
    "phasors": {"capture"},
    "resolver": {"capture", "optics", "phasors"},
    "maps": {"capture", "files", "optics", "phasors", "resolver"},
    "calibration": {"capture", "files", "maps", "optics", "phasors", "resolver"},
    "simulation": {"capture", "optics"},
    "pipeline": {"calibration", "capture", "files", "maps", "optics", "phasors", "resolver"},
    "doubts": {"calibration", "capture", "files", "maps", "phasors", "pipeline", "resolver"},
    "report": {"capture", "files", "maps", "optics", "resolver"},
    "api": {
        *("calibration", "capture", "doubts", "files", "maps", "phasors", "pipeline", "resolver", "simulation"),
        "workflows",
    },
    "figures": {"calibration", "capture", "files", "maps", "optics", "pipeline", "resolver", "simulation"},
}
"""Parts that a part may import besides itself and `ANYBODY`: only parts that come before it."""

LIBRARIES: dict[str, set[str]] = {
    "click": {"cli", "commands"},
    "rich": {"commands"},
    "matplotlib": {"figures"},
    "PIL": {"figures"},
    "imageio_ffmpeg": {"figures"},
    "OpenEXR": {"files"},
    "tifffile": {"files"},
    "distributed": {"execution"},
}


def _modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def _part(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imported(path: Path) -> Iterator[str]:
    """Yield the dotted names of the modules that a module imports, wherever in it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            yield node.module


def _name(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Imports within functions and for types alone count, too: one of two such modules could not be read without the other."""
    paths = {_name(path): path for path in _modules()}
    names = {name: [*_imported(path)] for name, path in paths.items()}
    try:
        graphlib.TopologicalSorter({name: paths.keys() & imported for name, imported in names.items()}).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" → ".join(error.args[1]))


def _imported_parts(path: Path) -> set[str]:
    """Parts of the package that a module imports."""
    names = [name.split(".") for name in _imported(path) if name.split(".")[0] == "cadtof_cli"]
    return {words[1] if len(words) > 1 else words[0] for words in names}


@pytest.mark.parametrize("part", ALLOWED)
def test_a_part_imports_only_what_comes_before_it(part: str) -> None:
    modules = [path for path in _modules() if _part(path) == part]
    assert modules
    for path in modules:
        beyond = _imported_parts(path) - ALLOWED[part] - ANYBODY - {part}
        after = f"{path} imports {', '.join(sorted(beyond))}, which come after {part}: move what it needs to an earlier part"
        assert not beyond, f"{after}, or let a later part call it; ALLOWED above has the order"


def test_only_the_command_line_knows_of_commands() -> None:
    for path in _modules():
        if _part(path) not in {"cli", "commands", "__main__"}:
            assert not _imported_parts(path) & {"cli", "commands"}, (
                f"{path}: a command calls it, not the other way round"
            )
        if _part(path) not in {"commands", "api", "workflows"}:
            assert "workflows" not in _imported_parts(path), f"{path}: a workflow calls it, not the other way round"


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_is_imported_only_where_it_is_used(library: str) -> None:
    users = {_part(path) for path in _modules() if any(name.split(".")[0] == library for name in _imported(path))}
    beyond = users - LIBRARIES[library]
    assert not beyond, (
        f"{', '.join(beyond)} must not import {library}: call a function in {', '.join(LIBRARIES[library])}"
    )
    assert users


@pytest.mark.parametrize("arguments", [("--help",), ("resolve", "--help")])
def test_help_loads_no_heavy_library(arguments: tuple[str, ...]) -> None:
    loaded = loaded_modules(COMMAND_LINE, *arguments)
    assert "click" in loaded
    assert not loaded & {"numpy", "scipy", "matplotlib", "rich", "tifffile", "OpenEXR", "distributed"}


def test_the_help_of_the_commands_needs_no_more_than_numpy() -> None:
    """The build of the package makes man pages from the help."""
    loaded = loaded_modules("\n".join(f"import cadtof_cli.commands.{name}" for name in COMMANDS))
    assert "numpy" in loaded
    assert not loaded & {"scipy", "matplotlib", "rich", "tifffile", "OpenEXR", "distributed"}


def test_resolving_loads_only_what_it_needs(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    loaded = loaded_modules(COMMAND_LINE, "resolve", str(capture.folder), "-o", str(tmp_path / "out"), "-j", "1")
    assert {"numpy", "tifffile"} <= loaded
    needless = loaded & {"scipy", "numpy.ma", "matplotlib", "rich", "OpenEXR", "distributed"}
    assert not needless, f"a run loads {', '.join(needless)}; np.median loads numpy.ma, arrays.py: median does not"
