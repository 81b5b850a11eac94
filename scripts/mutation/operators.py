"""What a mutant may change: operators, constants, calls, slices, branches and whole statements of a syntax tree."""

import ast
from collections.abc import Iterator
from copy import copy

ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}

KEPT_CALLS = frozenset(
    (
        *(
            "float",
            "int",
            "bool",
            "str",
            "complex",
            "tuple",
            "list",
            "dict",
            "set",
            "frozenset",
            "len",
            "repr",
            "print",
        ),
        *("range", "zip", "enumerate", "map", "isinstance", "getattr", "hasattr", "cast", "super", "partial", "field"),
        *(
            "array",
            "asarray",
            "ascontiguousarray",
            "astype",
            "stack",
            "concatenate",
            "empty",
            "empty_like",
            "zeros_like",
        ),
        *("finfo", "float32", "float64", "uint32", "intp"),
    )
)
"""Calls that only change a value's type or container. They are not replaced by their first argument, because that
often means the same."""

SYMMETRIC_CALLS = frozenset(
    (
        *("maximum", "minimum", "max", "min", "add", "multiply", "hypot", "outer", "logical_and", "logical_or"),
        *("isinstance", "getattr"),
    )
)
"""Calls whose first two arguments are not exchanged: the exchange changes nothing, or the arguments are no values."""

WITHOUT_ARGUMENTS = frozenset(("conj", "conjugate", "copy", "strip"))
"""Methods without arguments: a mutant leaves out the call."""


def variants(node: ast.AST, /) -> Iterator[ast.AST]:
    """Yield the nodes that may replace an expression."""
    if isinstance(node, ast.BinOp):
        yield from _arithmetic(node)
    elif isinstance(node, ast.UnaryOp):
        if not isinstance(node.op, ast.UAdd):
            yield node.operand
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in COMPARISONS[type(node.ops[0])]:
            yield ast.Compare(node.left, [other()], node.comparators)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.Constant):
        yield from (ast.Constant(value) for value in _numbers(node.value))
    elif isinstance(node, ast.Call):
        yield from _calls(node)
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Slice):
        if node.lower is not None and ast.unparse(node.lower) != "0":
            yield ast.Slice(None, node.upper, node.step)
        if node.upper is not None:
            yield ast.Slice(node.lower, None, node.step)


def statement_variants(node: ast.stmt, rebound: bool, /) -> Iterator[ast.stmt]:
    """Yield the nodes that may replace a statement; `rebound`: the statement assigns names that already have a value."""
    if isinstance(node, ast.Expr | ast.AugAssign | ast.Raise | ast.Delete) or (
        isinstance(node, ast.Assign)
        and (rebound or all(isinstance(target, ast.Subscript | ast.Attribute) for target in node.targets))
    ):
        yield ast.Pass()
    if isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC:
        yield ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value)
    if isinstance(node, ast.If) and not isinstance(node.test, ast.Compare | ast.BoolOp | ast.UnaryOp):
        negated = copy(node)
        negated.test = ast.UnaryOp(ast.Not(), node.test)
        yield negated


def called(node: ast.Call, /) -> str:
    """Return the last name of the called function: of `a.b.c()`, this is `c`."""
    if isinstance(node.func, ast.Attribute):
        return node.func.attr
    return node.func.id if isinstance(node.func, ast.Name) else ""


def _arithmetic(node: ast.BinOp) -> Iterator[ast.AST]:
    if type(node.op) not in ARITHMETIC or _is_text(node.left) or _is_text(node.right):
        return
    yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
    if isinstance(node.op, ast.Mod):
        yield node.left


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))


def _numbers(value: object) -> Iterator[bool | int | float | complex]:
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value - 1)
        if value not in {0, 1}:
            yield 0
    elif isinstance(value, float):
        yield from (2.0 * value, 0.0) if value else (1.0,)
    elif isinstance(value, complex):
        yield 2.0 * value if value else 1j


def _calls(node: ast.Call) -> Iterator[ast.AST]:
    name = called(node)
    if not node.args:
        if name in WITHOUT_ARGUMENTS and isinstance(node.func, ast.Attribute):
            yield node.func.value
        return
    first, *rest = node.args
    plain = not any(isinstance(argument, ast.Starred) for argument in node.args)
    if plain and name not in KEPT_CALLS and not name[:1].isupper():
        yield first
    if name == "where" and len(node.args) == 3:
        yield ast.Call(node.func, [first, node.args[2], node.args[1]], node.keywords)
    elif plain and rest and name not in SYMMETRIC_CALLS and ast.dump(first) != ast.dump(rest[0]):
        yield ast.Call(node.func, [rest[0], first, *rest[1:]], node.keywords)
