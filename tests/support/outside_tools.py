"""Programs of other makers: one on PATH is taken only if its version text says that it is of the expected maker."""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path


@dataclass(frozen=True)
class Maker:
    """A maker of programs: with the argument `question`, or none if it is empty, they print text that matches `answer`."""

    name: str
    question: str
    answer: str


LIBTIFF = Maker("libtiff", "-h", r"LIBTIFF, Version \d")
IMAGEMAGICK = Maker("ImageMagick", "-version", r"Version: ImageMagick \d")
OPENEXR = Maker("OpenEXR", "-h", r"(?i)OpenEXR image|usage: .*(imagefile|infile|input\.exr)")

JAVA = Maker("Java", "-version", r"(openjdk|java) version")

MAKERS = {
    "tiffcp": LIBTIFF,
    "tiffinfo": LIBTIFF,
    "tiffset": replace(LIBTIFF, question=""),
    "tiffsplit": LIBTIFF,
    "raw2tiff": LIBTIFF,
    "convert": IMAGEMAGICK,
    "identify": IMAGEMAGICK,
    "exrheader": OPENEXR,
    "exrmaketiled": OPENEXR,
    "exrmultipart": OPENEXR,
    "exrstdattr": OPENEXR,
    "java": JAVA,
}


@lru_cache(maxsize=64)
def outside_tool(name: str, path: str, /) -> str | None:
    """Return the first program of this name in the folders of `path` that is its maker's, or None.

    Other programs have the same names: `convert` is also a program of Windows, a converter of units, or a stand-in.
    """
    maker = MAKERS[name]
    for folder in path.split(os.pathsep):
        program = shutil.which(name, path=folder)
        if program and re.search(maker.answer, _version_text(program, maker.question)):
            return program
    return None


def _version_text(program: str, question: str) -> str:
    try:
        done = subprocess.run([program, *question.split()], capture_output=True, text=True, timeout=20, check=False)
    except (OSError, UnicodeDecodeError, subprocess.TimeoutExpired):
        return ""
    return done.stdout + done.stderr


def plain_environment() -> dict[str, str]:
    """Return the environment for such a program: in a Turkish locale, ImageMagick finds no format with an i in its name."""
    return {**os.environ, "LC_ALL": "C"}


def run_among(program: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a program in the folder that holds all of its files, which it gets by their names from there.

    For ImageMagick, a % in a path begins a number of the page.
    """
    paths = [one for one in arguments if isinstance(one, Path)]
    folder = Path(os.path.commonpath([path.parent for path in paths])) if paths else None
    names = [one.relative_to(folder) if folder and isinstance(one, Path) else one for one in arguments]
    return subprocess.run(
        [program, *names],
        cwd=folder,
        env=plain_environment(),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def run_tool(name: str, *arguments: str | Path) -> str | None:
    """Run a program of another maker and return what it prints; None where it is not installed."""
    program = outside_tool(name, os.environ.get("PATH", os.defpath))
    if program is None:
        return None
    done = run_among(program, *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout
