"""docs/reliability.md: every promise names a test or script that holds it, and these exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]

PAGE = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")


def _rows() -> list[tuple[str, str]]:
    """Return each promise, and the text that says what holds it."""
    tables = re.findall(r"^\| promise \| held by \|\n\|---\|---\|\n((?:\|.*\|\n)+)", PAGE, re.MULTILINE)
    rows = [re.split(r" *(?<!\\)\| *", line.strip("| ")) for table in tables for line in table.splitlines()]
    assert all(len(row) == 2 for row in rows)
    return [(row[0], row[1]) for row in rows]


def _tests() -> set[str]:
    sources = (path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    return {name for source in sources for name in re.findall(r"^def (test_\w+)\(", source, re.MULTILINE)}


def test_every_promise_names_tests_or_scripts_that_exist() -> None:
    rows, tests = _rows(), _tests()
    assert len(rows) > 30
    for promise, held in rows:
        named = re.findall(r"`(?:tests/[\w/]+\.py: )?(test_\w+)`", held)
        files = re.findall(r"`((?:tests|scripts)/[\w/.]+)(?=[ :`])", held)
        assert named or files, f"nothing holds: {promise}"
        assert not set(named) - tests, promise
        assert all((ROOT / file).is_file() for file in files), promise


def test_a_test_lies_where_the_page_says() -> None:
    placed = re.findall(r"`(tests/[\w/]+\.py): (test_\w+)`", PAGE)
    assert len(placed) > 10
    for file, test in placed:
        assert re.search(rf"^def {test}\(", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), f"{file}: {test}"


def test_the_scripts_that_repeat_figures_exist() -> None:
    scripts = set(re.findall(r"`(scripts/\w+)", PAGE))
    assert {"scripts/fuzz", "scripts/kills", "scripts/memory"} <= scripts
    assert all((ROOT / script).is_file() for script in scripts)
