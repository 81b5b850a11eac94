"""Files appear whole or not at all."""

import errno
import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cadtof_cli.errors import OutputError, PlaceError
from cadtof_cli.files.atomic import (
    PartialFile,
    atomic_write,
    make_folder,
    new_folder,
    remove_partial_files,
    write_json,
    write_text,
)
from cadtof_cli.files.system import codes_of_the_system
from tests.support.needed import needed_module


def test_what_is_written_appears_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "maps.exr"
    path.write_text("before")
    with atomic_write(path) as temporary:
        temporary.write_text("after")
        assert path.read_text() == "before"
    assert path.read_text() == "after"
    assert list(tmp_path.iterdir()) == [path]


def test_a_partial_file_gets_its_final_name_on_commit(tmp_path: Path) -> None:
    path = tmp_path / "maps.exr"
    partial, other = (PartialFile(path, token=token) for token in ("mark", "other"))
    assert re.fullmatch(r"\.maps\.exr\.[0-9a-f]{16}\.mark\.partial", partial.temporary.name)
    partial.temporary.write_text("all")
    other.discard()
    assert [one.name for one in tmp_path.iterdir()] == [partial.temporary.name]
    assert partial.commit() == 3
    assert [one.name for one in tmp_path.iterdir()] == ["maps.exr"]


def test_a_partial_file_without_content_cannot_be_committed(tmp_path: Path) -> None:
    partial = PartialFile(tmp_path / "maps.exr")
    with pytest.raises(OutputError, match="nothing was written"):
        partial.commit()
    assert list(tmp_path.iterdir()) == []


def _begin(path: Path, raised: BaseException) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text("half")
        raise raised


@pytest.mark.parametrize("raised", [ValueError("no"), KeyboardInterrupt(), SystemExit(143)])
def test_an_error_leaves_the_file_that_was_there(raised: BaseException, tmp_path: Path) -> None:
    path = tmp_path / "maps.exr"
    path.write_text("before")
    with pytest.raises(type(raised)):
        _begin(path, raised)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "cannot be written: No space left on device"),
        (OSError("6144 requested and 712 written"), "cannot be written: 6144 requested and 712 written"),
    ],
)
def test_an_error_of_the_system_names_the_file(error: OSError, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "maps.exr"
    with pytest.raises(OutputError) as caught, atomic_write(path):
        raise error
    assert str(caught.value) == f"{path}: {expected}"


def test_a_writer_that_wrote_nothing_is_an_error(tmp_path: Path) -> None:
    with (
        pytest.raises(OutputError, match="cannot be written: nothing was written"),
        atomic_write(tmp_path / "maps.exr"),
    ):
        pass
    with pytest.raises(OutputError, match="cannot be written: No such file"):
        write_json(tmp_path / "gone" / "run.json", {})


def test_only_partial_files_with_the_token_are_removed(tmp_path: Path) -> None:
    names = [".a.tif.one.partial", ".a.tif.two.partial", "a.tif", "a.one.partial"]
    for name in names:
        (tmp_path / name).touch()
    remove_partial_files(tmp_path, tokens={"one"})
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names[1:])
    remove_partial_files(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.one.partial", "a.tif"]


def test_a_text_keeps_its_line_ends_and_replaces_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("longer than what comes")
    write_text(tmp_path / "a.csv", "µ\n1\r\n")
    assert (tmp_path / "a.csv").read_bytes() == b"\xc2\xb5\n1\r\n"
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


def test_json_can_be_read_back(tmp_path: Path) -> None:
    write_json(tmp_path / "run.json", {"µ": [1.5, None], "path": Path("a \udcff")})
    assert json.loads((tmp_path / "run.json").read_text()) == {"µ": [1.5, None], "path": "a \udcff"}


def test_a_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    make_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_folder_whose_disk_fails_on_closing_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    close = os.close

    def failing(descriptor: int) -> None:
        close(descriptor)
        raise OSError(errno.ESTALE, "Stale file handle")

    monkeypatch.setattr(os, "close", failing)
    with pytest.raises(OutputError, match="expected a folder that can be written into: Stale file handle"):
        make_folder(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("write", [make_folder, lambda path: write_text(path / "a.txt", "text")])
def test_a_signal_while_a_file_is_created_leaves_no_file(
    write: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python handles a signal when the call of the system returns: the file is there, and nobody has its descriptor yet."""
    create = os.open

    def interrupted(*arguments: Any) -> int:
        create(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "open", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file may grow beyond 100 kB."""
    resource = needed_module("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def _library_fails(path: Path, size: int) -> None:
    """Fail as numpy and OpenEXR do: without the error number of the system."""
    with atomic_write(path) as temporary, codes_of_the_system(temporary, size):
        temporary.write_bytes(b"half")
        raise OSError("could not write 17 bytes")


@pytest.mark.usefixtures("small_files")
def test_an_error_without_a_code_gets_the_message_of_the_system(tmp_path: Path) -> None:
    path = tmp_path / "maps.exr"
    with pytest.raises(PlaceError) as caught:
        _library_fails(path, 100_001)
    assert str(caught.value) == f"{path}: cannot be written: File too large; here a file may have 100,000 (ulimit -f)"
    with pytest.raises(OutputError, match="cannot be written: could not write 17 bytes"):
        _library_fails(path, 100_000)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("small_files")
def test_the_message_for_a_file_that_is_too_large_says_its_size(tmp_path: Path) -> None:
    file = PartialFile(tmp_path / "maps.tif")
    file.parts = (memoryview(bytes(99_000)), memoryview(bytes(1_001)))
    with pytest.raises(
        PlaceError, match=r"File too large for 100,001 bytes; here a file may have 100,000 \(ulimit -f\)$"
    ):
        file.commit()
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("small_files")
def test_an_error_in_a_new_folder_names_the_file_by_its_final_path(tmp_path: Path) -> None:
    with pytest.raises(
        OutputError, match=f"{re.escape(str(tmp_path))}/capture/truth.exr: cannot be written: File too large"
    ):
        _new_folder_fails(tmp_path / "capture")
    assert not list(tmp_path.iterdir())


def _new_folder_fails(path: Path) -> None:
    with new_folder(path) as partial:
        _library_fails(partial / "truth.exr", 10**6)


def test_a_new_folder_appears_at_the_end_with_the_usual_permissions(tmp_path: Path) -> None:
    longest = "c" * 255
    path, usual = tmp_path / "sub" / longest, tmp_path / "usual"
    usual.mkdir()
    with new_folder(path) as partial:
        (partial / "frame").write_text("all of it")
        assert not path.exists()
    assert (path / "frame").read_text() == "all of it"
    assert [entry.name for entry in path.parent.iterdir()] == [longest]
    assert path.stat().st_mode == usual.stat().st_mode


def _begin_folder(path: Path) -> None:
    with new_folder(path) as partial:
        (partial / "frame").write_text("half")
        raise KeyboardInterrupt


def test_a_new_folder_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        _begin_folder(tmp_path / "capture")
    assert not list(tmp_path.iterdir())


def test_a_new_folder_replaces_nothing_but_an_empty_one(tmp_path: Path) -> None:
    with new_folder(tmp_path) as partial:
        (partial / "frame").write_text("x")
    with pytest.raises(OutputError, match="found a folder with files, expected nothing there"):
        new_folder(tmp_path).__enter__()
    with pytest.raises(OutputError, match="found a file, expected nothing there"):
        new_folder(tmp_path / "frame").__enter__()
    with pytest.raises(OutputError, match="cannot be created: File exists; choose another name"):
        new_folder(tmp_path / "frame" / "capture").__enter__()
