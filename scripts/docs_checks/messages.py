"""The error messages in the source, and the entries of docs/troubleshooting.md that say what to do about them."""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

HOLE = "…"
"""Stands for every value that fills a message, and for any text in an entry."""

REASONS = frozenset(
    {
        "doubts",
        "_other_zero",
        "_other_lens",
        "likely_cause",
        "_zero_in_words",
        "why_no_answer",
        "hint_of_planes",
        "_too_much_scatter",
        "_other_distances",
        "_lost",
        "_message_and_status",
    }
)
"""Functions that return the text of a message instead of raising an error; besides them, all of `DOUBTS` that may return
a text."""

DOUBTS = "doubts"
"""The room whose functions say what is likely wrong with a recording."""

CHECKS = frozenset({"require", "require_ratio"})
"""Functions that raise “NAME: found …, expected …” if a condition, their first argument, does not hold."""

_PASSED_ON = frozenset({f"{HOLE}: found {HOLE}, expected {HOLE}", f"{HOLE} is not {HOLE}"})
"""Messages that are left out: they are only the template of a message whose words come from elsewhere."""

_CLICK = frozenset({"UsageError", "BadParameter", "ClickException"})


@dataclass(frozen=True)
class Message:
    """An error message with holes, and its place in the source."""

    text: str
    file: Path
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.text!r}"


def messages(package: Path, /) -> Iterator[Message]:
    """Yield every error message in the modules of a package, except those that only pass another message on."""
    trees = {file: ast.parse(file.read_text(encoding="utf-8")) for file in sorted(package.rglob("*.py"))}
    kinds = _CLICK | _error_kinds(trees.values())
    for file, tree in trees.items():
        for line, text in _texts(tree, kinds, doubts=file.parent.name == DOUBTS):
            if text not in _PASSED_ON and len(_words(text)) >= 2:
                yield Message(" ".join(text.split()), file, line)


def _words(text: str) -> list[str]:
    return re.findall(r"[A-Za-z]{2,}", text)


def _error_kinds(trees: Iterable[ast.Module]) -> frozenset[str]:
    """Return the names of all classes of errors that a user sees: CadtofError, and every class derived from it."""
    classes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    kinds, before = {"CadtofError"}, 0
    while before < len(kinds):
        before = len(kinds)
        kinds |= {
            one.name for one in classes if any(isinstance(base, ast.Name) and base.id in kinds for base in one.bases)
        }
    return frozenset(kinds)


def _returns_text(function: ast.FunctionDef, *, doubts: bool) -> bool:
    may_return = doubts and function.returns is not None and ast.unparse(function.returns) == "str | None"
    return may_return or function.name in REASONS


def _texts(tree: ast.Module, kinds: frozenset[str], *, doubts: bool) -> Iterator[tuple[int, str]]:
    constants = {
        node.targets[0].id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
            if name in kinds and len(node.args) >= 3:
                yield node.lineno, f"{_text(node.args[0])}: found {HOLE}, expected {_text(node.args[2])}"
            elif (name in kinds or name == "fail") and node.args:
                yield node.lineno, _text(node.args[0])
            elif name == "Typed" and (what := _text(node.args[1])):
                yield node.lineno, f"{HOLE} is not {what}"
            elif name in CHECKS and len(node.args) > 2:
                told = _text(node.args[3]) if len(node.args) > 3 else "a ratio"
                yield node.lineno, f"{_text(node.args[1])}: found {HOLE}, expected {told}"
        elif isinstance(node, ast.FunctionDef) and _returns_text(node, doubts=doubts):
            for inner in ast.walk(node):
                if isinstance(inner, ast.Return | ast.Assign | ast.AugAssign) and inner.value is not None:
                    yield from ((inner.lineno, text) for text in map(_text, _strings(inner.value, constants)))


def _strings(value: ast.expr, constants: Mapping[str, ast.expr]) -> Iterator[ast.expr]:
    """Yield the strings that an expression can be: itself, the branches of a choice, or a constant of the module."""
    match value:
        case ast.Tuple():
            yield from (part for item in value.elts for part in _strings(item, constants))
        case ast.IfExp():
            yield from (*_strings(value.body, constants), *_strings(value.orelse, constants))
        case ast.BoolOp():
            yield from (part for item in value.values for part in _strings(item, constants))
        case ast.Name() if value.id in constants:
            yield from _strings(constants[value.id], {})
        case ast.Constant(value=str()) | ast.JoinedStr() | ast.BinOp():
            yield value


def _text(node: ast.expr) -> str:
    match node:
        case ast.Constant():
            return str(node.value)
        case ast.JoinedStr():
            return "".join(map(_text, node.values))
        case ast.BinOp(op=ast.Add()):
            return _text(node.left) + _text(node.right)
        case _:
            return HOLE


@dataclass(frozen=True)
class Entry:
    """A message on the page, with holes, and what to do about it."""

    pattern: str
    cure: str

    def holds(self, message: str, /) -> bool:
        """Return whether the entry is about a message."""
        return re.fullmatch(".*".join(map(re.escape, self.pattern.split(HOLE))), message) is not None


def entries(page: Path, /) -> Iterator[Entry]:
    """Yield the entries of the page: the rows of its tables, with messages in code spans, and “or” between them.

    A message that contains NAME, followed by a list of names, stands for one message per name.
    """
    for message, cure in re.findall(r"(?m)^\| (`.*?) \| (.+) \|$", page.read_text(encoding="utf-8")):
        shown, _, names = message.partition(" with NAME one of ")
        for pattern in re.findall(r"`(.+?)`(?= or `|$)", shown):
            named = (pattern.replace("NAME", name.strip("`")) for name in names.split(", "))
            yield from (Entry(one, cure) for one in dict.fromkeys(named))


def unexplained(package: Path, page: Path, /) -> Iterator[str]:
    """Yield the messages without an entry, the entries without a message, and the entries that say too little."""
    every, rows = list(messages(package)), list(entries(page))
    for message in every:
        if not any(row.holds(message.text) for row in rows):
            yield f"{message} has no entry"
    for row in rows:
        if not any(row.holds(message.text) for message in every):
            yield f"{page.name}: no message is like {row.pattern!r} any more"
        if not re.sub(rf"found|expected|[\s:,{HOLE}]", "", row.pattern):
            yield f"{page.name}: {row.pattern!r} is like anything"
        if len(row.cure.split()) < 3:
            yield f"{page.name}: {row.pattern!r} has no cure"
