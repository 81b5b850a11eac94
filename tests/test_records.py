"""Our `dataclass` makes the same records as that of the standard library: both are applied to the same classes."""

import dataclasses
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict, astuple, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, cast

import pytest

from cadtof_cli import records
from tests.support.captures import record
from tests.support.run_cadtof import ENVIRONMENT


def family(decorator: Callable[..., Any]) -> tuple[type[Any], ...]:
    """Return classes made by a decorator: a base, its child, fields by name only, without `eq`, and without fields."""

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

    @decorator(frozen=True)
    class Grandchild(Child):
        kind: ClassVar[int] = 7
        c: str = "other"

    @decorator(frozen=True)
    class Youngest(Grandchild):
        pass

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

    return Base, Child, Named, Unlike, Empty, Grandchild, Youngest


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
    (5, (1,), {}),
    (6, (1,), {"d": 2.0}),
]


def made(classes: tuple[type[Any], ...]) -> list[Any]:
    return [classes[kind](*places, **names) for kind, places, names in ARGUMENTS]


def test_repr_fields_and_dicts_are_those_of_the_library() -> None:
    for ours, library in zip(made(OURS), made(LIBRARY), strict=True):
        assert repr(ours) == repr(library) or type(ours).__name__ == "Unlike"
        assert repr(ours).split("(")[-1] == repr(library).split("(")[-1]
        assert (asdict(ours), astuple(ours)) == (asdict(library), astuple(library))
        assert [item.name for item in fields(ours)] == [item.name for item in fields(library)]
        assert type(ours).__match_args__ == type(library).__match_args__
        for name in "abcd":
            assert getattr(type(ours), name, "nothing") == getattr(type(library), name, "nothing")


def test_equality_and_hash_are_those_of_the_library() -> None:
    tables = [[[one == other for other in made(kind)] for one in made(kind)] for kind in (OURS, LIBRARY)]
    assert tables[0] == tables[1]
    for one, other in zip(made(OURS), made(OURS), strict=True):
        assert (one == other) == (hash(one) == hash(other)) == (type(one).__name__ != "Unlike")
        assert one != object()


@pytest.mark.parametrize("name", ["a", "b", "new"])
def test_frozen_records_cannot_be_changed(name: str) -> None:
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


def test_signatures_and_messages_for_wrong_arguments_are_those_of_the_library() -> None:
    wrong: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
        ((), {}),
        ((), {"c": "c"}),
        ((1, 2, 3, 4, 5, 6), {}),
        ((1,), {"a": 1}),
        ((1,), {"new": 1}),
        ((), {"a": 1, "new": 1}),
    ]
    for ours, library in zip(OURS, LIBRARY, strict=True):
        assert str(inspect.signature(ours)) == str(inspect.signature(library))
        for places, names in wrong:
            assert _complaint(ours, *places, **names) == _complaint(library, *places, **names)


def _complaint(kind: type[Any], /, *places: Any, **names: Any) -> str | None:
    """Return the message for wrong arguments, which begins with the class's own name; None if there is no error."""
    try:
        kind(*places, **names)
    except TypeError as error:
        return str(error)
    return None


def counting(decorator: Callable[..., Any]) -> type[Any]:
    @decorator
    class Counting:
        a: int
        b: list[int] = field(default_factory=list)
        c: int = field(default=3, init=False)
        d: str = field(init=False)

        def __post_init__(self) -> None:
            self.d = str(self.a)

    return cast("type[Any]", Counting)


def test_records_that_can_change_are_like_those_of_the_library() -> None:
    ours, library = counting(records.dataclass), counting(dataclasses.dataclass)
    assert str(inspect.signature(ours)) == str(inspect.signature(library))
    for kind in (ours, library):
        one, other = kind(1), kind(a=1)
        assert one == other
        assert repr(one).endswith("Counting(a=1, b=[], c=3, d='1')")
        one.b.append(2)
        other.c += 1
        assert (one.b, other.b, one.c, other.c, one == other) == ([2], [], 3, 4, False)
        assert kind.__hash__ is None


@records.dataclass(frozen=True)
class Sent:
    """A record that another process can find by its name."""

    a: int
    b: str = "b"


def test_records_can_be_sent_to_other_processes() -> None:
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
    if isinstance(one, type) and hasattr(one, "__dataclass_params__") and one.__dataclass_params__.frozen
}
print(*sorted(one for one in compiled if one.startswith("cadtof_cli")))
"""


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="the library is as quick from there on")
def test_a_run_lets_the_library_make_no_frozen_record_without_slots(tmp_path: Path) -> None:
    capture = record(tmp_path / "A")
    words = ["resolve", str(capture.folder), "-o", str(tmp_path / "out"), "-q", "--mpi-model", "discrete"]
    done = subprocess.run(
        [sys.executable, "-c", _SEEN, *words], env=ENVIRONMENT, capture_output=True, text=True, check=True
    )
    # a class with slots is made by the library
    assert done.stdout.split() == ["cadtof_cli.capture.frames.FrameSource"]
