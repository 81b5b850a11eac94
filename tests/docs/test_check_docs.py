"""`scripts/check_docs` finds mistakes on pages that have some, and its quick checks find none on our own pages."""

import re
from pathlib import Path

import pytest
from check_docs import CHECKS, PAGES
from docs_checks.console import check_commands
from docs_checks.numbers import stale_options, unsourced
from docs_checks.pages import commands, sections
from docs_checks.tables import Table, check_table

from cadtof_cli.capture.metadata import KEYS
from cadtof_cli.capture.toml import load_metadata
from tests.support.needed import needed_module
from tests.support.run_cadtof import ROOT

PAGE = """\
# Title

Nothing measured here, in 3 harmonics.

## One

It takes 1.5 ns, `2.5 ns` in code.

    $ cadtof --version  # which one
    cadtof, version …

<!-- slow -->

    $ cadtof info nowhere

## Two

```toml
# not = "a heading"
depth = 3.5
```

| capture | cm |
|---|---|
| `sample_data/card` | .23 |
| wall | 1.69 (asked ≤ 2.0) |
"""


@pytest.fixture
def page(tmp_path: Path) -> Path:
    file = tmp_path / "page.md"
    file.write_text(PAGE)
    return file


@pytest.mark.parametrize("name", ["numbers", "options", "messages"])
def test_nothing_is_wrong_with_our_pages(name: str) -> None:
    needed_module("click_man")
    wrong = list(CHECKS[name](False))
    assert not wrong, "\n".join(wrong)


def test_the_readme_is_checked_first() -> None:
    assert PAGES[0].name == "README.md"


def test_a_script_that_is_asked_for_help_does_nothing_else() -> None:
    """Without a parser, `--help` would run the script: one writes a page of docs, another the pictures of the docs."""
    mains = {
        path.name: path.read_text() for path in (ROOT / "scripts").glob("*.py") if "\ndef main(" in path.read_text()
    }
    assert len(mains) > 20
    assert not [name for name, text in mains.items() if "parse_args(" not in text and "parse_known_args(" not in text]


def test_the_settings_of_the_readme_can_be_copied_and_are_all_there(tmp_path: Path) -> None:
    settings = (ROOT / "README.md").read_text().partition("```toml\n")[2].partition("```")[0]
    known = {key.name for key in KEYS.values() if not key.name.startswith("raw_")}
    named = set(re.findall(r"(?m)^(?:# )?(\w+) =", settings))
    assert named == known, "the capture.toml of README.md has to show every key of capture/metadata.py"
    (tmp_path / "capture.toml").write_text(settings)
    found = load_metadata(tmp_path / "capture.toml").metadata
    corner = load_metadata(ROOT / "sample_data" / "corner" / "capture.toml").metadata
    assert found == corner


def test_the_commands_of_the_readme_print_what_it_says(tmp_path: Path) -> None:
    wrong = list(check_commands(ROOT / "README.md", ROOT, tmp_path, slow=False))
    assert not wrong, "\n".join(wrong)


def test_prose_of_a_section_leaves_out_code(page: Path) -> None:
    found = list(sections(page))
    assert [section.heading for section in found] == ["Title", "One", "Two"]
    assert "1.5 ns" in found[1].prose
    assert "2.5" not in found[1].prose
    assert "3.5" not in found[2].prose


def test_commands_with_what_they_print(page: Path) -> None:
    first, second = commands(page)
    assert (first.words, first.printed, first.slow) == ("cadtof --version  # which one", "cadtof, version …\n", False)
    assert (second.words, second.slow) == ("cadtof info nowhere", True)


def test_commands_are_run_and_their_output_is_compared(page: Path, tmp_path: Path) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    assert not list(check_commands(page, ROOT, folder, slow=False))
    (problem,) = check_commands(page, ROOT, folder, slow=True)
    assert problem.startswith("page.md: $ cadtof info nowhere: ends with status 2")
    page.write_text(PAGE.replace("cadtof, version …", "cadtof, release …"))
    (problem,) = check_commands(page, ROOT, folder, slow=False)
    assert "expected 'cadtof, release …', found 'cadtof, version" in problem
    page.write_text("    $ rm -rf /nowhere\n")
    assert list(check_commands(page, ROOT, folder, slow=False)) == [
        "page.md: $ rm -rf /nowhere: only `cadtof` is run here"
    ]


def test_numbers_without_a_source_are_found(page: Path) -> None:
    (problem,) = unsourced(page, ROOT)
    assert problem.startswith("page.md: “Two” has numbers (.23, 1.69, 2.0)")
    for source in ("`scripts/accuracy` prints it", "see `tests/test_imports.py`", "<!-- numbers: chosen -->"):
        page.write_text(f"{PAGE}\n{source}\n")
        assert not list(unsourced(page, ROOT))
    page.write_text(f"{PAGE}\n`scripts/gone` prints it\n")
    assert list(unsourced(page, ROOT)) == ["page.md: “Two”: scripts/gone is not there"]
    page.write_text(PAGE.replace("Nothing", "Made by `scripts/accuracy`. Nothing"))
    assert not list(unsourced(page, ROOT))


def test_an_option_that_does_not_exist_is_found(page: Path) -> None:
    page.write_text("`cadtof resolve --pool 3 --puddle 4` and --prose\n\n    $ cadtof info --jsn\n")
    assert list(stale_options(page, frozenset({"--pool"}))) == [
        "page.md: no command or script has the option --puddle",
        "page.md: no command or script has the option --jsn",
    ]


def test_rows_that_differ_from_those_of_a_script_are_found(page: Path, tmp_path: Path) -> None:
    table = Table("page.md", "Two", "scripts/x.py")
    printed = "| capture | cm |\n|---|---|\n| card | 0.23 | 99% |\n| wall | 1.70 |\n"
    assert not list(check_table(table, tmp_path, printed=printed))
    (problem,) = check_table(table, tmp_path, printed=printed.replace("0.23", "0.31"))
    assert problem == "page.md, “Two”: | `sample_data/card` | .23 |: scripts/x.py prints | card | 0.31 | 99% |"
    (problem,) = check_table(table, tmp_path, printed=printed.replace("wall", "hall"))
    assert problem == "page.md, “Two”: scripts/x.py prints no row like | wall | 1.69 (asked ≤ 2.0) |"
    assert list(check_table(Table("page.md", "Three", "scripts/x.py"), tmp_path, printed=printed)) == [
        "page.md, “Three”: no rows of scripts/x.py"
    ]
