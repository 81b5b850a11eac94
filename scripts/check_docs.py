"""Hold the documentation against what the programs do: see `scripts/check_docs --help`."""

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from docs_checks.notebook import check_notebook, write_notebook
from docs_checks.python_page import check_python

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


def python() -> Iterator[str]:
    """The examples of docs/python.md and docs/physics.md, and the notebook, print what they say that they print."""
    for page in ("python.md", "physics.md"):
        yield from check_python(DOCS / page, ROOT)
    yield from check_notebook(DOCS / "python.ipynb")


CHECKS: dict[str, Callable[[], Iterator[str]]] = {"python": python}


def main() -> None:
    """Run the checks that are named, or all."""
    about = "\n".join(f"  {name:10} {check.__doc__}" for name, check in CHECKS.items())
    parser = argparse.ArgumentParser(
        prog="scripts/check_docs",
        description=f"Hold the documentation against what the programs do.\n\n{about}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("checks", nargs="*", metavar="CHECK", help="which; all if none is named")
    parser.add_argument("--write", action="store_true", help="store what the notebook shows, instead of checking it")
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
        for difference in CHECKS[name]():
            print(f"  {difference}", flush=True)
            wrong += 1
    print("all as the pages say" if not wrong else f"{wrong} differences")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
