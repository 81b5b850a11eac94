"""All that CI runs is pinned, writes nothing, and fits the ranges of pyproject.toml; the source archive is complete."""

import os
import re
import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from tests.support.needed import miss, needed_program

ROOT = Path(__file__).parents[1]

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

PYTHONS = tuple(
    found[1]
    for one in PROJECT["classifiers"]
    if (found := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", one))
)


def constraints(python: str) -> dict[str, Version]:
    """Return the versions that are pinned for a Python like 3.11, by name."""
    here = {"python_version": python, "python_full_version": f"{python}.0"}
    pinned = (
        Requirement(line) for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")
    )
    return {
        _plain(one.name): Version(str(one.specifier).removeprefix("=="))
        for one in pinned
        if one.marker is None or one.marker.evaluate(here)
    }


def requirements() -> Iterator[Requirement]:
    for text in (
        *PROJECT["dependencies"],
        *(one for extra in PROJECT["optional-dependencies"].values() for one in extra),
    ):
        requirement = Requirement(text)
        if requirement.name != "cadtof":
            yield requirement


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_pins_its_actions_by_digest_and_may_only_read(path: Path) -> None:
    document: dict[str, Any] = yaml.safe_load(path.read_text())
    assert document["permissions"] == "read-all"
    for name, job in document["jobs"].items():
        assert "permissions" not in job, name
        for action in (step["uses"] for step in job["steps"] if "uses" in step):
            assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action), action


def test_one_action_has_one_digest_everywhere() -> None:
    used = {line for path in WORKFLOWS for line in re.findall(r"uses: (\S+@.*)", path.read_text())}
    assert len({line.split("@")[0] for line in used}) == len(used) > 0
    assert all(re.search(r"# v\d+\.\d+\.\d+$", line) for line in used)


def test_ci_audits_and_tries_the_newest_weekly() -> None:
    assert "run: scripts/audit" in (ROOT / ".github/workflows/ci.yml").read_text()
    newest = yaml.safe_load((ROOT / ".github/workflows/newest.yml").read_text())
    # YAML 1.1 takes the key "on" for true
    assert [len(one["cron"].split()) for one in newest[True]["schedule"]] == [5]
    assert all(job["env"] == {"CADTOF_CONSTRAINTS": "none"} for job in newest["jobs"].values())


@pytest.mark.parametrize("python", PYTHONS)
def test_what_is_required_has_a_range_and_a_pinned_version_in_it(python: str) -> None:
    pinned = constraints(python)
    for requirement in requirements():
        assert requirement.specifier, requirement
        assert requirement.specifier.contains(pinned[_plain(requirement.name)]), requirement


def test_what_is_pinned_installs_with_the_oldest_python() -> None:
    """Debian 12 has Python 3.11.2. If a pinned version needs 3.11.5, pip tries every version before it says so."""
    oldest = PROJECT["requires-python"].removeprefix(">=")
    pinned = constraints(oldest)
    for package in distributions():
        if pinned.get(_plain(package.name)) == Version(package.version) and "Requires-Python" in package.metadata:
            assert SpecifierSet(package.metadata["Requires-Python"]).contains(f"{oldest}.0"), package.name


def test_every_extra_that_is_asked_for_exists() -> None:
    """If an extra does not exist, pip only warns, and installs the rest."""
    pages = [ROOT / "README.md", ROOT / ".ci" / "run", *(ROOT / "docs").rglob("*"), *(ROOT / "scripts").glob("*")]
    texts = (page.read_text(encoding="utf-8", errors="ignore") for page in pages if page.is_file())
    asked = {found for text in texts for found in re.findall(r"""(?:cadtof|['"]\.|setup ")\[([\w,-]+)\]""", text)}
    assert {one for extras in asked for one in extras.split(",")} == PROJECT["optional-dependencies"].keys() - {"docs"}


def test_the_citation_names_this_version() -> None:
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == PROJECT["version"]


def test_the_scripts_install_what_is_pinned() -> None:
    setup = (ROOT / "scripts" / "setup.sh").read_text()
    assert '--constraint "$root/constraints.txt"' in setup
    assert {_plain(name) for name in ("numpy", "tifffile", "OpenEXR", "pytest", "distributed")} <= constraints(
        PYTHONS[0]
    ).keys()


_UV = """#!/bin/sh
echo "$1" >> calls
[ "$1" != venv ] || { mkdir -p .venv/bin; echo '#!/bin/sh' > .venv/bin/python; chmod +x .venv/bin/python; }
"""
"""A stand-in for uv, which installs nothing."""


def test_a_checkout_that_was_moved_gets_an_environment_of_its_own(tmp_path: Path) -> None:
    """Commands of the old one would run the Python and the code of the old place, if there still is one."""
    first, moved = tmp_path / "first", tmp_path / "moved"
    for name in ("cadtof_cli/a.c", "pyproject.toml", "constraints.txt", "setup.py", "scripts/setup.sh", "bin/uv"):
        (first / name).parent.mkdir(parents=True, exist_ok=True)
        (first / name).touch()
    (first / "bin" / "uv").write_text(_UV)
    (first / "bin" / "uv").chmod(0o755)
    shutil.copyfile(ROOT / "scripts" / "setup.sh", first / "scripts" / "setup.sh")
    # settings of a user, too, that would change what `cd` prints and what Python imports
    settings = {"CDPATH": ".", "PYTHONPATH": "/nowhere", "PYTHONOPTIMIZE": "2"}
    script = (
        'PATH=$PWD/bin:$PATH; . scripts/setup.sh; setup ""; echo "$root ${PYTHONPATH-} ${PYTHONOPTIMIZE-}" >> calls'
    )
    for place in (first, first, moved, moved):
        if place == moved and first.exists():
            first.rename(moved)
        words = [needed_program("bash"), "-euc", script]
        subprocess.run(words, cwd=place, env={**os.environ, **settings, "CC": "cc"}, check=True)
    once = ["--version", "venv", "pip"]
    expected = [*once, f"{first}  ", f"{first}  ", *once, f"{moved}  ", f"{moved}  "]
    assert (moved / "calls").read_text().splitlines() == expected


def test_the_source_archive_holds_all_that_scripts_and_tests_need() -> None:
    """It holds scripts, whose setup needs constraints.txt, and tests, which compare the docs with the code."""
    if not (ROOT / ".git").exists():
        miss("this is no checkout of git")
    # the checkout may belong to another user, and in a hook of git, variables name another one
    command = [needed_program("git"), "-c", "safe.directory=*", "ls-files"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    listed = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True).stdout
    tracked = {name.partition("/")[0] for name in listed.splitlines()}
    lines = map(str.split, (ROOT / "MANIFEST.in").read_text(encoding="utf-8").splitlines())
    named = {name for kind, *names in lines if kind in {"graft", "include"} for name in names}
    by_itself = {"LICENSE", "MANIFEST.in", "README.md", "pyproject.toml", "setup.py"}
    assert tracked == named | by_itself
