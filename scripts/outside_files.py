"""Write a frame by every program in tests/outside, read it, and put the table of results into docs/formats.md."""

import argparse
import importlib.metadata
import subprocess
import sys
import tempfile
import textwrap
import warnings
from itertools import groupby
from pathlib import Path

from tests.outside.cases import Case, MissingWriterError
from tests.outside.matrix import CASES, tried

PAGE = Path(__file__).parents[1] / "docs" / "formats.md"
BEGIN, END = "<!-- table: scripts/outside_files -->\n", "<!-- end of table -->\n"

LINE = 140
"""Largest number of characters on a line of the page."""

PACKAGES = (
    "tifffile",
    "imagecodecs",
    "opencv-python-headless",
    "scikit-image",
    "imageio",
    "pillow",
    "rasterio",
    "pyvips-binary",
    "OpenEXR",
)
PROGRAMS = (("tiffcp", "-h"), ("convert", "-version"))


def row(case: Case) -> tuple[str, bool]:
    """Return a row of the table, and whether the result is the expected one."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            told = tried(case, Path(folder))
        except MissingWriterError as missing:
            return f"| {case.writer} | {case.form} | not tried: {missing} |", False
        except AssertionError as wrong:
            return f"| {case.writer} | {case.form} | **read wrong**: {wrong} |", False
    if told is None:
        return f"| {case.writer} | {case.form} | read |", case.refused is None
    if case.refused is None or case.refused not in told:
        return f"| {case.writer} | {case.form} | **refused wrongly**: {told} |", False
    return f"| {case.writer} | {case.form} | refused: {case.refused} |", True


def versions() -> str:
    """Return the versions of the packages and programs with which the table is made."""
    found = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    for program, option in PROGRAMS:
        told = subprocess.run([program, option], capture_output=True, text=True, check=False)
        first = (told.stdout or told.stderr).strip().splitlines()[:1]
        found += [line.removeprefix("Version: ").partition(" http")[0] for line in first]
    return ", ".join(found)


def main() -> int:
    """Try all cases, and write the table; return 1 if a result is not the expected one."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    warnings.simplefilter("ignore")
    rows = [row(case) for case in CASES]
    read = sum(case.refused is None for case in CASES)
    counts = ", ".join(f"{writer} {len(list(cases))}" for writer, cases in groupby(CASES, key=lambda case: case.writer))
    said = (
        f"{len(CASES)} files or sets of files: {read} to be read bit for bit, {len(CASES) - read} to be refused with the reason;"
        f" {sum(good for _, good in rows)} came out so. By writer: {counts}.",
        f"Tried with {versions()}.",
    )
    text = [
        *(f"{textwrap.fill(one, LINE)}\n\n" for one in said),
        "| writer | file | cadtof |\n|---|---|---|\n",
        *(f"{line}\n" for line, _ in rows),
    ]
    page = PAGE.read_text(encoding="utf-8")
    before, after = page.split(BEGIN)[0], page.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}{''.join(text)}{END}{after}", encoding="utf-8")
    for line, good in rows:
        if not good:
            print(line)
    return 0 if all(good for _, good in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
