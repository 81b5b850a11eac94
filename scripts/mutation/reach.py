"""Find the modules that a test file can reach by its imports: mutants of other modules need not be tried against it."""

import ast
from functools import cache
from pathlib import Path

ENTRY = "cadtof_cli.cli"
"""The command line. It loads its commands by name, so a file that reaches it reaches everything."""

EVERYTHING = frozenset(("*",))


def reaches(tree: Path, test_file: Path, module: str, /) -> bool:
    """Return whether a test file imports a module of the package, at any depth and wherever the imports stand."""
    reached = _reached(tree, test_file)
    return reached is EVERYTHING or module in reached


@cache
def _reached(tree: Path, file: Path) -> frozenset[str]:
    """Return all modules that a file imports, directly or by way of other modules; EVERYTHING if one is the command line."""
    known: set[str] = set()
    waiting = sorted(_imported(tree, file))
    while waiting:
        name = waiting.pop()
        if name == ENTRY:
            return EVERYTHING
        if name not in known:
            known.add(name)
            path = _path(tree, name)
            waiting += sorted(_imported(tree, path)) if path else []
    return frozenset(known)


@cache
def _imported(tree: Path, file: Path) -> frozenset[str]:
    """Return the modules of package and tests that a file names in its imports, and the packages around them."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    parents = {name.rsplit(".", level)[0] for name in names for level in range(1, name.count(".") + 1)}
    return frozenset(name for name in names | parents if _path(tree, name))


@cache
def _path(tree: Path, name: str) -> Path | None:
    if name.split(".", maxsplit=1)[0] not in {"cadtof_cli", "tests"}:
        return None
    base = tree.joinpath(*name.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None
