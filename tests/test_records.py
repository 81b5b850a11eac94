"""Records behave as the standard library's: held against its own `dataclass`, over the same classes."""

import dataclasses
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict, astuple, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest

from cadtof_cli import records
from tests.support.captures import record
from tests.support.run_cadtof import ENVIRONMENT


def family(decorator: Callable[..., Any]) -> tuple[type[Any], ...]:
    """The same classes, made by a decorator: a base and what inherits from it, by place and by name, with and without `eq`."""

    @decorator(frozen=True)
    class Base:
        a: int
        b: list[int] = field(default_factory=list, compare=False)
        c: str = field(default="c", repr=False)

        @cached_property
        def doubled(self) -> int:
            return 2 * self.a

    @decorator(frozen=True)
    class Child(Base):
        d: float = 1.5

        def __post_init__(self) -> None:
            if self.a < 0:
                raise ValueError("below 0")
            object.__setattr__(self, "d", self.d * 2)

    @decorator(frozen=True, kw_only=True)
    class Named:
        a: int
        b: int | None = None

        def __repr__(self) -> str:
            return "its own"

    @decorator(frozen=True, eq=False)
    class Unlike:
        a: int = 1

    @decorator(frozen=True)
    class Empty:
        pass

    @decorator(frozen=True)
    class Filled:
        a: int = field(kw_only=True)
        b: list[int] = field(default_factory=list, init=False, compare=False)
        c: int = field(default=3, init=False)

    @decorator
    class Changed:
        a: int
        b: list[int] = field(default_factory=list)

    return Base, Child, Named, Unlike, Empty, Filled, Changed


LIBRARY, OURS = family(dataclasses.dataclass), family(records.dataclass)

ARGUMENTS: list[tuple[int, tuple[Any, ...], dict[str, Any]]] = [
    (0, (1,), {}),
    (0, (1, [2]), {}),
    (0, (1, [3]), {"c": "d"}),
    (0, (), {"a": 2}),
    (1, (1,), {}),
    (1, (1, [2], "c", 2.5), {}),
    (2, (), {"a": 1}),
    (2, (), {"a": 1, "b": 3}),
    (3, (), {}),
    (3, (2,), {}),
    (4, (), {}),
    (5, (), {"a": 1}),
    (6, (1,), {}),
]


def made(classes: tuple[type[Any], ...]) -> list[Any]:
    return [classes[kind](*places, **names) for kind, places, names in ARGUMENTS]


def refusal(kind: type[Any], places: tuple[Any, ...], names: dict[str, Any]) -> str | None:
    """What a class says of arguments that it does not take."""
    try:
        kind(*places, **names)
    except TypeError as error:
        return str(error)
    return None


@pytest.mark.parametrize("times", range(30))
def test_they_say_the_same_of_themselves(times: int) -> None:
    """However many there are of a kind: the first are made in another way."""
    for ours, library in zip(made(OURS), made(LIBRARY), strict=True):
        assert repr(ours) == repr(library) or type(ours).__name__ == "Unlike"
        assert repr(ours).split("(")[-1] == repr(library).split("(")[-1]
        assert (asdict(ours), astuple(ours)) == (asdict(library), astuple(library))
        assert [item.name for item in fields(ours)] == [item.name for item in fields(library)]
        assert type(ours).__match_args__ == type(library).__match_args__


def test_they_take_the_same() -> None:
    for ours, library in zip(family(records.dataclass), family(dataclasses.dataclass), strict=True):
        for _ in range(30):
            for places, names in (
                ((), {}),
                ((1, 2, 3, 4, 5, 6), {}),
                ((1,), {"a": 1}),
                ((1,), {"new": 1}),
                ((), {"b": 1}),
            ):
                assert refusal(ours, places, names) == refusal(library, places, names)
        assert str(inspect.signature(ours)) == str(inspect.signature(library))
        assert ours.__init__.__qualname__ == library.__init__.__qualname__
    for first, second in zip(made(OURS)[-2:], made(OURS)[-2:], strict=True):
        assert first.b is not second.b


def test_what_is_not_frozen_changes_and_has_no_hash() -> None:
    for classes in (OURS, LIBRARY):
        one = classes[-1](1)
        one.a, one.new = 2, 3
        assert (one.a, one.new, one == classes[-1](2)) == (2, 3, True)
        assert classes[-1].__hash__ is None


def test_the_same_ones_are_equal_and_have_the_same_hash() -> None:
    tables = [[[one == other for other in made(kind)] for one in made(kind)] for kind in (OURS, LIBRARY)]
    assert tables[0] == tables[1]
    for one, other in zip(made(OURS)[:-1], made(OURS)[:-1], strict=True):
        assert (one == other) == (hash(one) == hash(other)) == (type(one).__name__ != "Unlike")
        assert one != object()


@pytest.mark.parametrize("name", ["a", "b", "new"])
def test_nothing_in_them_changes(name: str) -> None:
    for classes in (OURS, LIBRARY):
        one = classes[0](1)
        with pytest.raises(FrozenInstanceError):
            setattr(one, name, 5)
        with pytest.raises(FrozenInstanceError):
            delattr(one, name)
        assert (one.a, one.b, one.doubled, one.doubled) == (1, [], 2, 2)
        assert replace(one, a=4).doubled == 8
        with pytest.raises(ValueError, match="below 0"):
            classes[1](-1)
        with pytest.raises(TypeError):
            classes[2](1)


@records.dataclass(frozen=True)
class Sent:
    """Found by its name in another process."""

    a: int
    b: str = "b"


def test_they_cross_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(Sent(3))) == Sent(3, "b")


_SEEN = """
import sys, dataclasses
from unittest.mock import patch
from cadtof_cli.cli import main
with patch.object(sys, "argv", ["cadtof", *sys.argv[1:]]):
    try:
        main()
    except SystemExit as ended:
        assert ended.code == 0
compiled = {
    f"{one.__module__}.{one.__qualname__}"
    for name, module in list(sys.modules.items()) if name.startswith("cadtof_cli")
    for one in vars(module).values()
    if isinstance(one, type) and dataclasses.is_dataclass(one) and one.__dataclass_params__.repr
}
print(*sorted(one for one in compiled if one.startswith("cadtof_cli")))
"""


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="the library is as quick from there on")
def test_a_run_makes_no_others(tmp_path: Path) -> None:
    capture = record(tmp_path / "A")
    words = ["resolve", str(capture.folder), "-o", str(tmp_path / "out"), "-q"]
    done = subprocess.run(
        [sys.executable, "-c", _SEEN, *words], env=ENVIRONMENT, capture_output=True, text=True, check=True
    )
    # what has slots is the library's
    assert done.stdout.split() == ["cadtof_cli.capture.frames.FrameSource"]
