"""Check the documentation against what the programs do: see `scripts/check_docs --help`."""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from docs_checks.console import check_commands
from docs_checks.messages import unexplained
from docs_checks.notebook import check_notebook, write_notebook
from docs_checks.numbers import stale_options, unsourced
from docs_checks.python_page import check_python
from docs_checks.tables import TABLES, check_table, printed_by
from man_pages import contexts

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


PAGES = (ROOT / "README.md", ROOT / "SECURITY.md", *sorted(DOCS.rglob("*.md")))
"""The pages that are checked. CHANGELOG.md is not among them: what it says of earlier versions is history."""

OTHERS = frozenset(
    (
        "--against",
        "--cost",
        "--count",
        "--cpus",
        "--cpuset-cpus",
        "--even-lamp",
        "--figure",
        "--first",
        "--harmonics",
        "--keep",
        "--kills",
        "--lifetime",
        "--list",
        "--memory",
        "--named",
        "--no-build-isolation",
        "--no-deps",
        "--place",
        "--quick",
        "--room",
        "--samples",
        "--scipy-pixels",
        "--seeds",
        "--shm-size",
        "--shown",
        "--tmpfs",
    )
)
"""Options on the pages that belong to scripts or to other programs."""


def python(_full: bool) -> Iterator[str]:
    """The examples of docs/python.md and docs/physics.md, and of the notebook, print what the pages show."""
    for page in ("python.md", "physics.md"):
        yield from check_python(DOCS / page, ROOT)
    yield from check_notebook(DOCS / "python.ipynb")


def commands(full: bool) -> Iterator[str]:
    """Commands on the pages print what the page shows: the same words, and numbers within 2 % or one in the last digit."""
    for page in PAGES:
        is_calibration = page.name == "calibration.md"
        if is_calibration and not full:
            continue
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "here"
            if is_calibration:
                printed_by(f"scripts/calibration_walkthrough.py --keep {folder}", ROOT)
            folder.mkdir(exist_ok=True)
            yield from check_commands(page, ROOT, folder, slow=full)


def tables(full: bool) -> Iterator[str]:
    """Rows of tables are what the script below them prints, within 2 % or one in the last digit, residuals within 10 ×."""
    asked = [table for table in TABLES if full or not table.slow]
    printed = {script: printed_by(script, ROOT) for script in dict.fromkeys(table.script for table in asked)}
    for table in asked:
        yield from check_table(table, ROOT, printed[table.script])


def numbers(_full: bool) -> Iterator[str]:
    """Every section with measured numbers names the script or test that makes them, and that file exists."""
    for page in PAGES:
        yield from unsourced(page, ROOT)


def options(_full: bool) -> Iterator[str]:
    """Every option on the pages exists in a command, a script or another program."""
    params = [param for context in contexts() for param in context.command.params]
    known = frozenset(option for param in params for option in (*param.opts, *param.secondary_opts))
    for page in PAGES:
        yield from stale_options(page, known | OTHERS | {"--help", "--version"})


def messages(_full: bool) -> Iterator[str]:
    """docs/troubleshooting.md says what to do about every error message in the source."""
    yield from unexplained(ROOT / "cadtof_cli", DOCS / "troubleshooting.md")


CHECKS: dict[str, Callable[[bool], Iterator[str]]] = {
    check.__name__: check for check in (python, commands, tables, numbers, options, messages)
}
"""The checks by name. Each is told whether to run everything, or only what takes no more than two minutes in all."""


def main() -> None:
    """Run the named checks, or all."""
    about = "\n".join(f"  {name:10} {check.__doc__}" for name, check in CHECKS.items())
    parser = argparse.ArgumentParser(
        prog="scripts/check_docs",
        description=f"Check the documentation against what the programs do.\n\n{about}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("checks", nargs="*", metavar="CHECK", help="which checks to run [default: all]")
    parser.add_argument(
        "--full",
        action="store_true",
        help="also run what takes long: rooms and boxes that are rendered, the calibration page",
    )
    parser.add_argument(
        "--write", action="store_true", help="store the output of the notebook instead of running checks"
    )
    asked = parser.parse_args()
    unknown = set(asked.checks) - set(CHECKS)
    if unknown:
        parser.error(f"no such check: {', '.join(sorted(unknown))}; there are {', '.join(CHECKS)}")
    if asked.write:
        write_notebook(DOCS / "python.ipynb")
        return
    os.environ.setdefault("NO_COLOR", "1")
    wrong = 0
    for name in asked.checks or CHECKS:
        print(f"{name}: {CHECKS[name].__doc__}", flush=True)
        for difference in CHECKS[name](asked.full):
            print(f"  {difference}", flush=True)
            wrong += 1
    print("all as the pages say" if not wrong else f"{wrong} differences")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
