"""The mutation tool: what it changes in a small module, what it leaves alone, and which tests it tries."""

import ast
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from mutation.calls import Calls, Test
from mutation.mutants import Mutant, all_mutants, drawn, mutated
from mutation.named import Change, GoneError, changed_files, read_changes
from mutation.reach import reaches
from mutation.runs import hands_to_kernel
from mutation.session import NotPutInError, put_in

SOURCE = '''"""A module; its numbers, 3, are no constants."""

from functools import lru_cache
from typing import Literal

Kind = Literal["a", 2]
LIMIT = 2.5


class Thing:
    size: int = 4

    def __repr__(self) -> str:
        return "x" * 3

    @lru_cache(maxsize=7)
    def wrapped(self, x: float, y: float) -> float:
        """Return 9."""
        if x < y:
            raise ValueError(f"found {x + 1}")
        x %= LIMIT
        return -abs(x - y) if x and y else max(x, y)


def part(values: list[float]) -> list[float]:
    values[0] = 1.0
    assert len(values) > 5
    return values[1:].copy()
'''


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    room = tmp_path / "cadtof_cli" / "maps" / "deep"
    room.mkdir(parents=True)
    for folder in (tmp_path / "cadtof_cli", room.parent, room):
        (folder / "__init__.py").touch()
    (room / "thing.py").write_text(SOURCE)
    return tmp_path


def changes(tree: Path) -> set[tuple[str, str, str]]:
    return {(m.function, m.before, m.after) for group in all_mutants(tree, ["maps"]) for m in group}


def test_numbers_comparisons_operators_and_statements_are_changed_one_at_a_time(tree: Path) -> None:
    returned = "return -abs(x - y) if x and y else max(x, y)"
    assert changes(tree) == {
        ("", "LIMIT = 2.5", "LIMIT = 5.0"),
        ("", "LIMIT = 2.5", "LIMIT = 0.0"),
        ("Thing", "size: int = 4", "size: int = 5"),
        ("Thing", "size: int = 4", "size: int = 3"),
        ("Thing", "size: int = 4", "size: int = 0"),
        ("Thing.wrapped", "if x < y:", "if x <= y:"),
        ("Thing.wrapped", "if x < y:", "if x >= y:"),
        ("Thing.wrapped", "raise ValueError(f'found {x + 1}')", "pass"),
        ("Thing.wrapped", "x %= LIMIT", "pass"),
        ("Thing.wrapped", "x %= LIMIT", "x *= LIMIT"),
        ("Thing.wrapped", returned, "return max(x, y) if x and y else -abs(x - y)"),
        ("Thing.wrapped", returned, "return abs(x - y) if x and y else max(x, y)"),
        ("Thing.wrapped", returned, "return -(x - y) if x and y else max(x, y)"),
        ("Thing.wrapped", returned, "return -abs(x + y) if x and y else max(x, y)"),
        ("Thing.wrapped", returned, "return -abs(x - y) if x or y else max(x, y)"),
        ("Thing.wrapped", returned, "return -abs(x - y) if x and y else x"),
        ("part", "values[0] = 1.0", "pass"),
        ("part", "values[0] = 1.0", "values[1] = 1.0"),
        ("part", "values[0] = 1.0", "values[-1] = 1.0"),
        ("part", "values[0] = 1.0", "values[0] = 2.0"),
        ("part", "values[0] = 1.0", "values[0] = 0.0"),
        ("part", "return values[1:].copy()", "return values[1:]"),
        ("part", "return values[1:].copy()", "return values[:].copy()"),
        ("part", "return values[1:].copy()", "return values[2:].copy()"),
        ("part", "return values[1:].copy()", "return values[0:].copy()"),
    }


def test_every_mutant_is_a_module_that_differs_in_that_statement(tree: Path) -> None:
    for group in all_mutants(tree, ["maps"]):
        for mutant in group:
            text = mutated(SOURCE, mutant)
            compile(text, mutant.path, "exec")
            assert mutant.after.removesuffix(":") in text
            assert mutant.room == "maps"


def test_a_draw_follows_from_its_seed_and_takes_each_place_once(tree: Path) -> None:
    places = all_mutants(tree, ["maps"])
    assert drawn(places, 8, 1) == drawn(places, 8, 1)
    assert drawn(places, 8, 1) != drawn(places, 8, 2)
    everything = drawn(places, 1000, 1)
    assert len({mutant.place for mutant in everything}) == len(everything) == len(places)


def test_a_mutant_is_named_by_its_text_and_not_by_its_place() -> None:
    one = Mutant("cadtof_cli/maps/a.py", 3, 0, "f", "x = 1", "x = 2")
    moved = Mutant("cadtof_cli/maps/b.py", 9, 1, "f", "x = 1", "x = 2")
    assert one.key == moved.key == ("maps", "f", "x = 1", "x = 2")


def test_a_test_reaches_what_it_imports_at_any_depth(tree: Path) -> None:
    tests = tree / "tests" / "maps"
    tests.mkdir(parents=True)
    (tree / "cadtof_cli" / "other.py").write_text("def f():\n    from cadtof_cli.maps.deep import thing\n")
    (tree / "cadtof_cli" / "cli.py").touch()
    sources = {
        "near": "from cadtof_cli.maps.deep.thing import part",
        "far": "import cadtof_cli.other",
        "none": "import numpy",
        "command": "from cadtof_cli.cli import main",
    }
    for name, source in sources.items():
        (tests / f"test_{name}.py").write_text(source)
    reached = {name: reaches(tree, tests / f"test_{name}.py", "cadtof_cli.maps.deep.thing") for name in sources}
    assert reached == {"near": True, "far": True, "none": False, "command": True}


def test_tests_that_run_the_changed_lines_or_may_are_tried() -> None:
    path, other = "cadtof_cli/maps/deep/thing.py", "cadtof_cli/other.py"
    calls = Calls(
        {
            "tests/a.py::runs": Test(1.0, {path: frozenset({20, 21})}, forks=False),
            "tests/a.py::else": Test(1.0, {other: frozenset({20})}, forks=False),
            "tests/b.py::forks": Test(1.0, {}, forks=True),
        },
        {path: frozenset({1, 2})},
    )

    def noticing(lines: range, *reaching: str) -> list[str]:
        found = [t for t in calls.tests if calls.may_notice(t, path, lines, reached=lambda file: file in reaching)]
        return [test.split("::")[1] for test in found]

    assert noticing(range(21, 24), "tests/a.py") == ["runs", "forks"]
    assert noticing(range(22, 24), "tests/a.py", path) == ["forks"]
    assert noticing(range(2, 3), path) == ["runs", "forks"]
    assert noticing(range(2, 3), other) == ["else", "forks"]
    assert noticing(range(2, 3), "tests/a.py") == ["runs", "else", "forks"]
    assert noticing(range(2, 3)) == ["forks"]


def test_a_mutant_knows_the_lines_of_its_statement(tree: Path) -> None:
    lines = {m.before: m.lines for group in all_mutants(tree, ["maps"]) for m in group}
    at = dict(enumerate(SOURCE.splitlines(), start=1))
    for before, (first, last) in lines.items():
        assert first == last
        assert at[first].strip() == before.replace("'", '"')


def test_a_named_change_is_found_wherever_it_stands_and_however_it_is_spaced(tree: Path) -> None:
    path = tree / "cadtof_cli" / "maps" / "deep" / "thing.py"
    change = Change("no wrap", (("x %= LIMIT return", "return"), ("LIMIT = 2.5", "LIMIT = 9.0")))
    ((found, text),) = changed_files(tree, change, kernel=False).items()
    assert found == path
    assert text == SOURCE.replace("x %= LIMIT\n        return", "return").replace("LIMIT = 2.5", "LIMIT = 9.0")
    moved = path.rename(tree / "cadtof_cli" / "maps" / "moved.py")
    assert list(changed_files(tree, change, kernel=False)) == [moved]


@pytest.mark.parametrize(("text", "times"), [("LIMIT = 2.4", 0), ("x < y", 1), ("return", 3)])
def test_a_named_change_whose_text_does_not_occur_once_is_an_error(tree: Path, text: str, times: int) -> None:
    change = Change("some change", ((text, "pass"),))
    if times == 1:
        assert changed_files(tree, change, kernel=False)
        return
    with pytest.raises(GoneError, match=f"some change: '{text}' stands in the package {times} times, expected once"):
        changed_files(tree, change, kernel=False)


def test_the_texts_that_named_changes_replace_are_in_the_package() -> None:
    root = Path(__file__).parents[1]
    changes = read_changes(root / "scripts" / "mutation" / "named.toml")
    assert len([change for change in changes if " (" not in change.name]) == 17
    for change in changes:
        assert changed_files(root, change, kernel=False)
        assert bool(changed_files(root, change, kernel=True)) == bool(change.kernel)


def test_the_tests_that_notice_named_changes_exist() -> None:
    root = Path(__file__).parents[1]
    for change in read_changes(root / "scripts" / "mutation" / "named.toml"):
        if change.test:
            file, _, name = change.test.partition("::")
            assert f"def {name}(" in (root / file).read_text()


def imported(path: Path, source: str) -> ModuleType:
    path.write_text(source)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_change_is_put_into_functions_that_others_hold_already(tmp_path: Path) -> None:
    path = tmp_path / "thing.py"
    source = (
        "from functools import lru_cache\n\n\nclass Thing:\n    @property\n    def size(self):\n        return 2\n\n\n"
        "@lru_cache(maxsize=7)\ndef part(x):\n    return [x + y for y in (1, 2)]\n"
    )
    module = imported(path, source)
    thing, part = module.Thing(), module.part
    changed = source.replace("return 2", "return 3").replace("x + y", "x - y")
    put_in(path, ast.parse(changed))
    assert thing.size == 3
    assert part(5) == [4, 3]


def test_of_two_functions_in_one_line_none_is_guessed(tmp_path: Path) -> None:
    path = tmp_path / "thing.py"
    source = "both = (lambda x: x + 1, lambda x: x - 1)\n"
    module = imported(path, source)
    with pytest.raises(NotPutInError):
        put_in(path, ast.parse(source.replace("x + 1", "x * 1")))
    assert [one(4) for one in module.both] == [5, 3]


def test_what_runs_on_import_is_not_put_in() -> None:
    path = "cadtof_cli/maps/deep/thing.py"
    calls = Calls({}, {path: frozenset({1, 2})}) | Calls({}, {path: frozenset({9}), "other.py": frozenset({4})})
    assert [calls.may_be_put_in(path, range(line, line + 1)) for line in (1, 4, 9)] == [False, True, False]
    assert not calls.may_be_put_in(path, range(2, 5))


def test_lines_of_functions_that_call_the_compiled_kernel_are_found() -> None:
    source = "LIMIT = 1\n\ndef front(x):\n    if x:\n        return 0\n    extension().search(x)\n\ndef plain(x):\n    return x\n"
    assert [line for line in range(1, 10) if hands_to_kernel(source, line)] == [3, 4, 5, 6]
    source = (
        "def ends(compiled, x):\n    compiled.solve(x)\n    return x\n\ndef plain(x):\n    return x.solve(compiled)\n"
    )
    assert [line for line in range(1, 7) if hands_to_kernel(source, line)] == [1, 2, 3]


BENCH = """
import sys
from pathlib import Path
from mutation.mutants import all_mutants
from mutation.runs import Bench

tree, places = Path(sys.argv[1]), [Path(sys.argv[2]) / name for name in ("watched", "tried")]
calls = Bench(tree, places[0]).watched(("maps",))
(tree / "broken").touch()
bench = Bench(tree, places[1], calls)
for group in all_mutants(tree, ["maps"]):
    print(group[0].path, bench.tried(group[0], quick=True).verdict)
"""


def test_a_mutant_is_killed_neither_by_the_one_before_nor_by_a_test_that_fails_without_it(tmp_path: Path) -> None:
    """One file is tested, and all its mutants are killed. The other is called, but nothing is asked of what it returns."""
    tree, files = (
        tmp_path / "tree",
        {"a.py": "def double(x):\n    return 2 * x\n", "b.py": "def half(x):\n    return x / 2\n"},
    )
    for folder in ("cadtof_cli/maps", "tests/maps", "tests/contracts"):
        (tree / folder).mkdir(parents=True)
        for package in (tree / folder, (tree / folder).parent):
            (package / "__init__.py").touch()
    for name, text in files.items():
        (tree / "cadtof_cli" / "maps" / name).write_text(text)
    (tree / "tests" / "contracts" / "test_nothing.py").write_text("def test_nothing():\n    pass\n")
    (tree / "tests" / "maps" / "test_both.py").write_text(
        "from pathlib import Path\n\nfrom cadtof_cli.maps.a import double\nfrom cadtof_cli.maps.b import half\n\n\n"
        "def test_double():\n    half(3.0)\n    assert double(3.0) == 6.0\n\n\n"
        f"def test_broken():\n    half(3.0)\n    assert not Path({str(tree / 'broken')!r}).exists()\n"
    )
    for name in ("watched", "tried"):
        (tmp_path / name).mkdir()
    done = subprocess.run(
        [sys.executable, "-c", BENCH, str(tree), str(tmp_path)],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1] / "scripts")},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    verdicts = dict.fromkeys(line.replace("cadtof_cli/maps/", "") for line in done.stdout.splitlines())
    assert list(verdicts) == ["a.py killed", "b.py survived"], done.stdout + done.stderr
    assert "fails without any mutant, too: tests/maps/test_both.py::test_broken\n" in done.stderr
