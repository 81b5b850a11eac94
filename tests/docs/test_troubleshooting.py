"""docs/troubleshooting.md says what to do about every error message in the source."""

from pathlib import Path

import pytest
from docs_checks.messages import REASONS, entries, messages, unexplained

from tests.support.run_cadtof import ROOT, cadtof

PACKAGE, PAGE = ROOT / "cadtof_cli", ROOT / "docs" / "troubleshooting.md"


def test_every_message_has_an_entry_and_every_entry_a_message() -> None:
    wrong = list(unexplained(PACKAGE, PAGE))
    told = "docs/troubleshooting.md needs a row for each message, with what to do, and no row without a message:\n"
    assert not wrong, told + "\n".join(wrong)


def test_messages_are_found_in_the_source() -> None:
    found = {message.text for message in messages(PACKAGE)}
    assert len(found) > 250
    # an example of each way in which the source makes a message
    assert "--pool: found …, expected an odd number of pixels such as 3 or 5, at most …" in found
    assert "tilt: found …, expected angles below 60°" in found
    assert "they look like millivolts: give --volts-per-count 0.001" in found
    assert any(text.startswith("…: the worker process died twice") for text in found)
    assert "No such command '…': did you mean …?" in found


def test_functions_that_return_messages_exist() -> None:
    source = "".join(file.read_text(encoding="utf-8") for file in PACKAGE.rglob("*.py"))
    gone = [name for name in REASONS if f"def {name}(" not in source]
    assert not gone, f"scripts/docs_checks/messages.py, REASONS, names {', '.join(gone)}, which the package has no more"


def test_every_doubt_about_a_recording_is_a_message(tmp_path: Path) -> None:
    (tmp_path / "doubts").mkdir()
    (tmp_path / "doubts" / "lens.py").write_text(
        "def dirty(x) -> str | None:\n    return f'the lens is dirty by {x}'\n"
    )
    assert [message.text for message in messages(tmp_path)] == ["the lens is dirty by …"]


def test_a_message_that_a_user_sees_has_an_entry(tmp_path: Path) -> None:
    seen = cadtof("resolve", tmp_path / "nowhere", "-o", tmp_path / "out").err.strip().removeprefix("Error: ")
    assert any(entry.holds(seen) for entry in entries(PAGE))


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package with a single message."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "errors.py").write_text("class CadtofError(Exception): ...\nclass LensError(CadtofError): ...\n")
    (folder / "lens.py").write_text("def f(x):\n    raise LensError(f'{x}: the lens is dirty, clean it')\n")
    return folder


def test_missing_and_stale_entries_are_found(package: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("| message | what to do |\n|---|---|\n| `the sensor is cold` | warm it up slowly |\n")
    missing, stale = unexplained(package, page)
    assert missing.endswith("'…: the lens is dirty, clean it' has no entry")
    assert stale == "page.md: no message is like 'the sensor is cold' any more"
    page.write_text("| `…: the lens is dirty, …` | wipe the lens with a cloth |\n")
    assert not list(unexplained(package, page))
    page.write_text("| `…: the LENS` or `…: the NAME is dirty, …` with NAME one of lens, `mirror` | wipe it |\n")
    assert [entry.pattern for entry in entries(page)] == [
        "…: the LENS",
        "…: the lens is dirty, …",
        "…: the mirror is dirty, …",
    ]


def test_an_entry_that_fits_any_message_or_has_no_cure_is_found(package: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("| `…: …` | wipe the lens with a cloth |\n")
    assert list(unexplained(package, page)) == ["page.md: '…: …' is like anything"]
    page.write_text("| `…: the lens is dirty, …` | wipe it |\n")
    assert list(unexplained(package, page)) == ["page.md: '…: the lens is dirty, …' has no cure"]
