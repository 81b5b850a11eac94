"""Compare tables of the documentation with what the script below them prints."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from docs_checks.pages import sections
from docs_checks.printed import NUMBER, RELATIVE, close


@dataclass(frozen=True)
class Table:
    """A script, and the section of a page that shows the rows that it prints.

    Attributes:
        page, heading: the page, and the heading of the section with the rows.
        script: the script with its arguments, to be run from the root of the repository.
        rows: regular expression that finds the rows of this script in the section.
        relative: how much a number may differ, as a share of it.
        slow: whether the script runs only with --full.
    """

    page: str
    heading: str
    script: str
    rows: str = ""
    relative: float = RELATIVE
    slow: bool = False


TABLES = (
    Table("README.md", "Accuracy", "scripts/accuracy.py", rows=r"^\| (5,|card|corner|inter-reflection|room|wall)"),
    Table("docs/solvers.md", "The closed form", "scripts/accuracy.py", rows=r"e[-+]\d\d \|", relative=0.9),
    Table(
        "docs/diffuse.md",
        "How good it is",
        "scripts/diffuse_accuracy.py sample_data/room sample_data/corner sample_data/inter-reflection sample_data/card",
        rows=r"^\| `sample_data/(room|corner|inter-reflection|card)`",
    ),
    Table(
        "docs/diffuse.md",
        "How good it is",
        "scripts/cornell.py",
        rows=r"^\| (`simulate --scene cornell`|the same box)",
        slow=True,
    ),
    Table("docs/diffuse.md", "Flat walls without MPI", "scripts/flat_walls.py", rows=r"^\| \d+ \|"),
    Table("docs/formats.md", "Lossy compression", "scripts/lossy_compressions.py"),
    Table("docs/solvers.md", "More harmonics", "scripts/benchmark_solvers.py harmonics"),
    Table("docs/solvers.md", "The paper's solver", "scripts/benchmark_solvers.py starts", rows="%, .*%"),
    Table("docs/solvers.md", "Pooling", "scripts/benchmark_solvers.py pooling", rows=r"× \d \|"),
    Table("docs/solvers.md", "Triangle waves", "scripts/benchmark_solvers.py triangles"),
    Table("docs/solvers.md", "Three paths", "scripts/benchmark_solvers.py paths"),
)
"""Which script prints which rows of the documentation. Residuals consist of the last bits, which differ between
machines, so they have a wide tolerance."""


_ASKED = re.compile(r"\(asked[^)]*\)")
"""The goal, beside a measured number."""


def check_table(table: Table, root: Path, /, printed: str) -> Iterator[str]:
    """Yield the rows of a section whose numbers differ from those of the printed line of the same name."""
    lines = {_name(line): line for line in printed.splitlines() if line.startswith("| ")}
    found = [section for section in sections(root / table.page) if section.heading == table.heading]
    rows = [row for section in found for row in _rows(section.text) if re.search(table.rows, row)]
    where = f"{table.page}, “{table.heading}”"
    if not rows:
        yield f"{where}: no rows of {table.script}"
    for row in rows:
        line = lines.get(_name(row))
        if line is None:
            yield f"{where}: {table.script} prints no row like {row}"
            continue
        expected, there = (NUMBER.findall(_ASKED.sub("", text.split("|", 2)[2])) for text in (row, line))
        pairs = list(zip(expected, there, strict=False))
        if len(pairs) < len(expected) or not all(close(a, b, relative=table.relative) for a, b in pairs):
            yield f"{where}: {row}: {table.script} prints {line}"


def _name(row: str) -> str:
    """Return the name of a row: its first cell; for a capture, the name of its folder."""
    cell = row.split("|")[1].strip()
    capture = re.match(r"`?(?:sample_data/|simulate --scene )([\w-]+)", cell)
    return capture[1] if capture else cell


def printed_by(script: str, root: Path, /) -> str:
    """Run a script of the repository, and return what it prints; empty if it fails."""
    done = subprocess.run(
        [sys.executable, *script.split()],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    return done.stdout if done.returncode == 0 else ""


def _rows(text: str) -> list[str]:
    """Return the rows of a section's tables, without their heads."""
    rows: list[str] = []
    lines = text.splitlines()
    for line, after in zip(lines, [*lines[1:], ""], strict=True):
        is_head = after.startswith("|---") or line.startswith("|---")
        if line.startswith("|") and not is_head:
            rows.append(line.strip())
    return rows
