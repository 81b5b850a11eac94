"""docs/architecture.md names every room and file of the package, and nothing else; all modules keep to the house style."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def _named() -> set[str]:
    """Paths in the page's tree, by indentation; folders end with a slash."""
    tree = PAGE.split("```")[1].strip("\n").splitlines()
    folders: list[str] = []
    found = set()
    for line in tree:
        depth, name = (len(line) - len(line.lstrip())) // 2, line.split()[0]
        folders = folders[:depth]
        found.add("".join(folders) + name)
        if name.endswith("/"):
            folders.append(name)
    return found


def _existing() -> set[str]:
    package = ROOT / "cadtof_cli"
    sources = [
        path for path in package.rglob("*") if path.suffix in {".py", ".c", ".h", ".html", ".js", ".css", ".json"}
    ]
    files = {path.relative_to(ROOT).as_posix() for path in sources if path.name != "__init__.py"}
    return files | {f"{path.parent.relative_to(ROOT).as_posix()}/" for path in sources}


def test_every_room_and_file_is_in_the_tree() -> None:
    missing = _existing() - _named()
    assert not missing, f"docs/architecture.md, The tree, needs a line for {', '.join(sorted(missing))}"


def test_nothing_in_the_tree_is_gone() -> None:
    gone = _named() - _existing()
    assert not gone, (
        f"docs/architecture.md, The tree, names {', '.join(sorted(gone))}, which is not there: remove the line"
    )


def test_functions_on_the_way_of_a_frame_exist() -> None:
    places = re.findall(r"`([\w/]+\.py): (\w+)`", PAGE)
    assert len(places) > 10
    for file, function in places:
        source = (ROOT / "cadtof_cli" / file).read_text(encoding="utf-8")
        assert re.search(rf"^def {function}\(", source, re.MULTILINE), f"{file} has no function {function}"


def test_files_that_changes_touch_exist() -> None:
    table = PAGE.split("## What a change touches")[1]
    named = re.findall(r"`((?:\w+/)*\w+\.py)`", table)
    files = [file for file in named if "NAME" not in file and file != "solver.py"]
    assert len(files) > 10
    for file in files:
        place = ROOT if file.startswith(("tests/", "scripts/")) else ROOT / "cadtof_cli"
        assert (place / file).is_file(), f"docs/architecture.md, What a change touches: there is no {file}"


MODULES = sorted((ROOT / "cadtof_cli").rglob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_modules_and_functions_are_short(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    lines = len(text.splitlines())
    assert lines < 350, f"{path} has {lines} lines: it is more than one thing, which belong into files of their own"
    for one in ast.walk(ast.parse(text)):
        if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (one.end_lineno or one.lineno) - one.lineno + 1
            assert length < 70, f"{path}: {one.name} has {length} lines, which should be steps with names"


ARRAY = re.compile(r"(NDArray\[.*\]|Float(32)?|Complex(64)?|Bool|Index|Int64|Status|Stored|Values)( \| None)?")


def _public(body: list[ast.stmt]) -> Iterator[ast.FunctionDef]:
    """Yield the public functions of a module, and those of its public classes."""
    for one in body:
        if isinstance(one, ast.FunctionDef) and not one.name.startswith("_"):
            yield one
        elif isinstance(one, ast.ClassDef) and not one.name.startswith("_"):
            yield from _public(one.body)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_arrays_are_positional_only_and_public_functions_are_described(path: Path) -> None:
    for function in _public(ast.parse(path.read_text(encoding="utf-8")).body):
        arrays = [
            one.arg for one in function.args.args if one.annotation and ARRAY.fullmatch(ast.unparse(one.annotation))
        ]
        assert not arrays, f"{path}: {function.name} can be called with {', '.join(arrays)} by name: it needs a /"
        overload = any(ast.unparse(one) == "overload" for one in function.decorator_list)
        assert overload or ast.get_docstring(function), f"{path}: {function.name} has no docstring"
