"""Find the places of a module where a mutant can be made, draw some of them, and make the text of a mutated module."""

import ast
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mutation.operators import called, statement_variants, variants

SKIPPED_FUNCTIONS = frozenset(("__repr__", "__str__"))

SKIPPED_KEYWORDS = frozenset(
    ("dtype", "maxsize", "casting", "encoding", "strict", "kw_only", "eq", "frozen", "default_factory")
)
"""Keyword arguments that say how a value is stored, not what it is: they are not changed."""

FIRST_ARGUMENT_ONLY = frozenset(("require",))
"""Functions in whose calls only the first argument is changed: the others are the text of an error."""

TYPES = frozenset(("Literal", "ClassVar", "TypeVar", "Annotated"))

PACKAGE = "cadtof_cli"


@dataclass(frozen=True)
class Mutant:
    """One change of a file.

    Attributes:
        path: the file.
        place: number of the place in the file.
        variant: number of the variant at this place.
        function: the function around the place.
        before, after: text of the innermost statement, without the block below it, as it was and as it is changed.
        lines: first and last line of this statement, without the block below it.

    Room, function, before and after identify a mutant for good: line numbers and file names change.
    """

    path: str
    place: int
    variant: int
    function: str
    before: str
    after: str
    lines: tuple[int, int] = (0, 0)

    @property
    def room(self) -> str:
        """The room of the package with the file."""
        return Path(self.path).parts[1]

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What identifies the mutant, even when its file or its lines move."""
        return self.room, self.function, self.before, self.after


@dataclass
class _Place:
    """A place of a node in the tree: the field of its parent, the index if that is a list, and the innermost statement."""

    parent: ast.AST
    name: str
    index: int | None
    node: ast.AST
    statement: ast.stmt | None
    function: str
    variants: list[ast.AST] = field(default_factory=list)

    def put(self, node: ast.AST) -> None:
        """Put another node in this place."""
        if self.index is None:
            setattr(self.parent, self.name, node)
        else:
            getattr(self.parent, self.name)[self.index] = node


def all_mutants(tree: Path, rooms: Sequence[str], /) -> list[list[Mutant]]:
    """Return, for every place in the rooms of a tree, the mutants that can be made there."""
    files = [path for room in rooms for path in sorted((tree / PACKAGE / room).rglob("*.py"))]
    return [group for path in files for group in _mutants_of(path, str(path.relative_to(tree)))]


def drawn(places: Sequence[Sequence[Mutant]], count: int, seed: int, /) -> list[Mutant]:
    """Return one mutant at each of `count` places, or of all if there are fewer, chosen by the seed."""
    generator = random.Random(seed)
    chosen = generator.sample(range(len(places)), min(count, len(places)))
    return [generator.choice(places[index]) for index in chosen]


def mutated(source: str, mutant: Mutant, /) -> str:
    """Return a module's text with the change made."""
    return ast.unparse(mutated_module(source, mutant)) + "\n"


def mutated_module(source: str, mutant: Mutant, /) -> ast.Module:
    """Return a module with the change made; all other nodes keep their lines."""
    module = ast.parse(source)
    place = next(place for index, place in enumerate(_places(module)) if index == mutant.place)
    place.put(place.variants[mutant.variant])
    return ast.fix_missing_locations(module)


def _mutants_of(path: Path, name: str) -> Iterator[list[Mutant]]:
    module = ast.parse(path.read_text(encoding="utf-8"))
    for number, place in enumerate(_places(module)):
        before = _head(place.statement)
        made = []
        for index, variant in enumerate(place.variants):
            place.put(variant)
            after = _head(variant if isinstance(variant, ast.stmt) else place.statement)
            made.append(Mutant(name, number, index, place.function, before, after, _lines(place.statement)))
        place.put(place.node)
        yield [mutant for mutant in made if mutant.after != before]


def _head(statement: ast.AST | None) -> str:
    """Return the text of a statement without the block that belongs to it."""
    if statement is None:
        return ""
    head = ast.parse("pass").body[0]
    kept = dict(ast.iter_fields(statement))
    for block in ("body", "orelse", "finalbody", "handlers", "decorator_list"):
        if isinstance(kept.get(block), list):
            kept[block] = [head] if block == "body" else []
    text = ast.unparse(ast.fix_missing_locations(type(statement)(**kept)))
    return text.removesuffix("\n    pass") if isinstance(kept.get("body"), list) else text


def _lines(statement: ast.stmt | None) -> tuple[int, int]:
    if statement is None:
        return 0, 0
    body = getattr(statement, "body", None)
    last = max(statement.lineno, body[0].lineno - 1) if body else statement.end_lineno
    return statement.lineno, last or statement.lineno


def _places(module: ast.Module) -> Iterator[_Place]:
    """Yield the places of a module that have variants, always in the same order."""
    for place in _walk(module, None, (), set()):
        if place.variants:
            yield place


def _walk(node: ast.AST, statement: ast.stmt | None, scope: tuple[str, ...], bound: set[str]) -> Iterator[_Place]:
    for name, index, child in _children(node):
        inner = child if isinstance(child, ast.stmt) else statement
        place = _Place(node, name, index, child, inner, ".".join(scope))
        if isinstance(child, ast.stmt):
            place.variants += statement_variants(child, _rebinds(child, bound))
        elif inner is not None:
            place.variants += variants(child)
        yield place
        deeper, names = scope, bound
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            deeper, names = (*scope, child.name), _arguments(child)
        yield from _walk(child, inner, deeper, names)
        bound |= _assigned(child)


def _children(node: ast.AST) -> Iterator[tuple[str, int | None, ast.AST]]:
    """Yield the children that may be changed: no annotations, decorators, error texts, docstrings or types."""
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
        return
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "bases", "keywords"} and not isinstance(node, ast.Call):
            continue
        items: Iterable[tuple[int | None, object]] = enumerate(value) if isinstance(value, list) else [(None, value)]
        for index, child in items:
            if isinstance(child, ast.AST) and not _is_skipped(node, name, index, child):
                yield name, index, child


def _is_skipped(parent: ast.AST, name: str, index: int | None, child: ast.AST) -> bool:
    if isinstance(child, ast.arg | ast.operator | ast.cmpop | ast.boolop | ast.unaryop | ast.expr_context | ast.alias):
        return True
    if isinstance(parent, ast.Call) and called(parent) in FIRST_ARGUMENT_ONLY and (name != "args" or index != 0):
        return True
    return (
        (isinstance(child, ast.FunctionDef) and child.name in SKIPPED_FUNCTIONS)
        or (isinstance(child, ast.keyword) and child.arg in SKIPPED_KEYWORDS)
        or (isinstance(child, ast.withitem) and "errstate" in ast.unparse(child))
        or (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant))
        or (isinstance(child, ast.Subscript) and ast.unparse(child.value).split(".")[-1] in TYPES)
        or (isinstance(child, ast.Call) and called(child) in TYPES)
    )


def _rebinds(statement: ast.stmt, bound: set[str]) -> bool:
    names = _assigned(statement) if isinstance(statement, ast.Assign) else set()
    return bool(names) and names <= bound


def _assigned(node: ast.AST) -> set[str]:
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.For) else []
    return {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}


def _arguments(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    if isinstance(node, ast.ClassDef):
        return set()
    return {argument.arg for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)}
