"""Every command has a man page, made from its help; roff reads it without a warning, and the wheel has all pages."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest

from cadtof_cli.commands.help import SectionedCommand
from tests.support.commands import every_command
from tests.support.needed import needed_module, needed_program
from tests.support.run_cadtof import ENVIRONMENT, ROOT

COMMANDS = every_command()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the pages by the words that call their commands."""
    needed_module("click_man")
    from man_pages import write_man_pages

    written = write_man_pages(tmp_path_factory.mktemp("man"))
    return {file.stem.replace("-", " ").removeprefix("cadtof").strip(): file.read_text() for file in written}


ONLY_WHAT_BUILDING_REQUIRES = """
import re, sys
from importlib.metadata import packages_distributions
from pathlib import Path

sys.path[:0] = [sys.argv[1], sys.argv[1] + "/scripts"]
required = {name.lower() for name in sys.argv[3:]}

class Refused:
    def find_spec(self, name, path=None, target=None):
        owners = {owner.lower() for owner in PACKAGES.get(name, ())}
        if owners and not owners & required and name not in {"cadtof_cli", "man_pages"}:
            raise ModuleNotFoundError(f"{name} is not among what building requires")

PACKAGES = packages_distributions()
sys.meta_path.insert(0, Refused())
from man_pages import write_man_pages

print(len(write_man_pages(Path(sys.argv[2]))))
"""


def test_pages_are_made_with_nothing_but_what_building_requires(tmp_path: Path) -> None:
    needed_module("click_man")
    requires = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    names = [name for requirement in requires for name in re.findall(r"^[\w-]+", requirement)]
    words = [sys.executable, "-c", ONLY_WHAT_BUILDING_REQUIRES, str(ROOT), str(tmp_path), *names]
    done = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == 1 + len(COMMANDS)


def test_every_command_has_a_page(pages: dict[str, str]) -> None:
    assert pages.keys() == {"", *COMMANDS}


@pytest.mark.parametrize("words", COMMANDS)
def test_a_page_says_what_the_help_says(pages: dict[str, str], words: str) -> None:
    command, page = COMMANDS[words], pages[words].replace("\\-", "-")
    assert page.startswith(f'.TH "CADTOF {words.upper()}" "1"')
    sections = re.findall(r"(?m)^\.SH (.+)$", page)
    assert sections[:3] == ["NAME", "SYNOPSIS", "DESCRIPTION"]
    assert sections[-2:] == ["EXAMPLES", "SEE ALSO"]
    for option in (param for param in command.params if isinstance(param, click.Option)):
        assert option.opts[0] in page
    if isinstance(command, SectionedCommand):
        # options of no section are under OPTIONS, as in the help
        shown = [title for title in command.sections(command.params) if title != "Options"]
        assert re.findall(r"(?m)^\.SS (.+)$", page) == shown
    assert "\b" not in page
    for line in str(command.epilog).splitlines()[2:]:
        assert line.strip() in page


def test_roff_has_no_complaint(pages: dict[str, str]) -> None:
    groff = needed_program("groff")
    for words, page in pages.items():
        done = subprocess.run(
            [groff, "-man", "-ww", "-z", "-T", "utf8", "-K", "utf8"],
            input=page,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        complaints = [
            line for line in done.stderr.splitlines() if "cannot break line" not in line and "adjust" not in line
        ]
        assert (done.returncode, complaints) == (0, []), words


def test_an_installation_gets_the_man_pages(tmp_path: Path) -> None:
    needed_module("setuptools")
    needed_module("click_man")
    # setup.py writes the pages beside itself before it installs them, and the checkout may be read-only
    shutil.copy(ROOT / "setup.py", tmp_path)
    for name in ("pyproject.toml", "README.md", "LICENSE", "cadtof_cli", "scripts"):
        (tmp_path / name).symlink_to(ROOT / name)
    command = [sys.executable, "setup.py", "-q", "install_data", "--install-dir", str(tmp_path)]
    done = subprocess.run(
        command, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    installed = {file.name for file in (tmp_path / "share" / "man" / "man1").iterdir()}
    assert installed == {"cadtof.1", *(f"cadtof-{words.replace(' ', '-')}.1" for words in COMMANDS)}
