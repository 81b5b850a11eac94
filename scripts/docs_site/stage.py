"""Write the pages that Sphinx reads: the pages of docs, the README cut into pages, and a page for every command."""

import re
import shutil
from pathlib import Path

from docs_site.commands import write_command_pages

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"

OF_README = {
    "tour": ("Tour", ("Two commands", "Five minutes")),
    "capture": ("Captures and maps", ("The capture format", "What comes out")),
    "accuracy": ("Accuracy and limits", ("How it works", "Accuracy", "Speed", "Limits")),
}
"""Pages made of sections of the README, by name: title, and headings of the sections. The index is the text above them."""

CHAPTERS = {
    "Begin": ("tour", "install", "capture", "commands/index", "troubleshooting", "glossary"),
    "Use": (
        "looking",
        "report",
        "formats",
        "calibration",
        "solvers",
        "diffuse",
        "cluster",
        "reliability",
        "python",
        "shells",
    ),
    "Understand": ("accuracy", "physics", "simulation", "paper/README", "diffuse_study", "speed", "architecture"),
    "Limits": (
        "limits/README",
        "limits/separation",
        "limits/false_alarm",
        "limits/motion",
        "limits/light",
        "limits/stages",
    ),
}
"""Chapters of the site with their pages. Pages of docs that no chapter names stand under “More”."""

SHORT = {
    "looking": "Looking at results",
    "report": "The page of a run",
    "formats": "File formats",
    "calibration": "Calibration",
    "solvers": "Solvers",
    "diffuse": "Diffuse MPI",
    "diffuse_study": "Diffuse MPI: the study",
    "cluster": "Clusters",
    "reliability": "Reliability",
    "python": "Python",
    "shells": "Shells and man pages",
    "physics": "Physics",
    "limits/README": "Overview",
    "limits/separation": "Close paths",
    "limits/false_alarm": "False alarms",
    "limits/motion": "Motion",
    "limits/light": "Fog, wax, lamps",
    "limits/stages": "Switched stages",
    "simulation": "Simulation",
    "paper/README": "The paper, reproduced",
    "architecture": "Architecture",
    "glossary": "Glossary",
}
"""Names of pages in the contents, if they differ from the title."""

_LINK = re.compile(r"(?<!`)(!?\[[^\]\n]*\])\(([^)\s]+)\)")
_FENCE = re.compile(r"(^```[\s\S]*?^```$|(?:^ {4}.*\n?)+)", re.MULTILINE)


def stage(folder: Path, /) -> None:
    """Write everything that Sphinx reads into a new folder.

    Raises:
        LookupError: the README has no section with a heading that a page is made of.
        FileNotFoundError: a link leads to a file that does not exist.
    """
    shutil.copytree(DOCS, folder, ignore=shutil.ignore_patterns("__pycache__"))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    before, sections = _sections(readme)
    homes = {anchor(heading): page for page, (_, headings) in OF_README.items() for heading in headings}
    for page, (title, headings) in OF_README.items():
        missing = [heading for heading in headings if heading not in sections]
        if missing:
            raise LookupError(f"README.md has no section {', '.join(missing)}, which the page {page} is made of")
        body = "\n".join(f"## {heading}\n{sections[heading]}" for heading in headings)
        text = _relinked(f"# {title}\n\n{body}", ROOT, homes, from_readme=True)
        (folder / f"{page}.md").write_text(text, encoding="utf-8")
    for file in sorted(DOCS.rglob("*.md")):
        text = _relinked(file.read_text(encoding="utf-8"), file.parent, homes)
        (folder / file.relative_to(DOCS)).write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "SECURITY.md", folder / "security.md")
    write_command_pages(folder / "commands")
    (folder / "index.md").write_text(
        _relinked(before, ROOT, homes, from_readme=True) + _contents(folder), encoding="utf-8"
    )


def anchor(heading: str, /) -> str:
    """Return the anchor that GitHub and MyST give a heading."""
    plain = re.sub(r"[`*]", "", heading.strip().lower())
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


def _sections(readme: str) -> tuple[str, dict[str, str]]:
    """Return the text before the first section, and the sections by heading."""
    before, *rest = re.split(r"(?m)^## ", readme)
    return before, {heading: text for heading, _, text in (part.partition("\n") for part in rest)}


def _relinked(text: str, folder: Path, homes: dict[str, str], *, from_readme: bool = False) -> str:
    """Return a page whose links lead to pages of the site; a link to another file of the repository becomes its words."""

    def moved(match: re.Match[str]) -> str:
        words, target = match.groups()
        if words.endswith(".md]"):
            words = "[]"  # an empty text becomes the title of the linked page
        path, _, heading = target.partition("#")
        if "://" in target or not path:
            return match.group(0)
        there = (folder / path).resolve()
        if not there.exists():
            raise FileNotFoundError(f"{folder}: a link leads to {target}, which is not there")
        if there == ROOT / "README.md":
            page = homes.get(heading, "index")
            prefix = "../" * (len(folder.relative_to(ROOT).parts) - 1)
            return f"{words}({prefix}{page}.md{'#' + heading if heading in homes else ''})"
        if there == ROOT / "SECURITY.md":
            return f"{words}(security.md)"
        if DOCS not in there.parents:
            named = match.group(1).strip("![]")
            return named if named.startswith("`") else f"`{named}`"
        return f"{words}({target.removeprefix('docs/') if from_readme else target})"

    # pieces with odd numbers are code
    return "".join(piece if place % 2 else _LINK.sub(moved, piece) for place, piece in enumerate(_FENCE.split(text)))


def _contents(folder: Path) -> str:
    """Return the contents of the site, which list all its pages."""
    listed = {page for pages in CHAPTERS.values() for page in pages}
    there = {path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.md")}
    more = sorted(page for page in there - listed - {"index"} if not page.startswith("commands/"))
    chapters = {**CHAPTERS, **({"More": tuple(more)} if more else {})}
    trees = [
        "\n".join((f"```{{toctree}}\n:caption: {name}\n:hidden:", *map(_entry, pages), "```"))
        for name, pages in chapters.items()
    ]
    first = "[Tour](tour.md) · [Commands](commands/index.md) · [Accuracy and limits](accuracy.md)"
    return f"\n{first}\n\n" + "\n\n".join(trees) + "\n"


def _entry(page: str) -> str:
    return f"{SHORT[page]} <{page}>" if page in SHORT else page
