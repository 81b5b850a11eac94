"""A FIFO, device, socket, folder or circular link in place of a file is refused at once, by name, and fails alone."""

import contextlib
import os
import shutil
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn

import numpy as np
import pytest
import tifffile

from tests.support.captures import record, write_exr, write_frame, write_pages
from tests.support.forward import step_truth
from tests.support.run_cadtof import Finished, cadtof, program

AT_ONCE_S = 10


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _device(path: Path) -> None:
    # reading it never ends
    path.symlink_to("/dev/zero")


def _socket(path: Path) -> None:
    listening = socket.socket(socket.AF_UNIX)
    # the path of a socket must be short
    with contextlib.chdir(path.parent), contextlib.closing(listening):
        listening.bind(path.name)


def _folder(path: Path) -> None:
    path.mkdir()


def _loop(path: Path) -> None:
    path.symlink_to(path.name)


KINDS: dict[str, tuple[Callable[[Path], None], str]] = {
    "fifo": (_fifo, "found a FIFO, expected a file"),
    "device": (_device, "found a device, expected a file"),
    "socket": (_socket, "found a socket, expected a file"),
    "folder": (_folder, "Is a directory"),
    "loop": (_loop, "Too many levels of symbolic links"),
}

FRAME, FIRST, TOML = "cap/frame_1.tif", "cap/frame_0.tif", "cap/capture.toml"

REFUSED: list[tuple[str, tuple[str, ...]]] = [
    (FRAME, ("calibrate dark cap -o new", "inspect cap --pixel 1,1 --frame 1")),
    (FIRST, ("calibrate dark cap -o new", "inspect cap --pixel 1,1")),
    (TOML, ("resolve cap -o new -j 1", "info cap -j 1", "calibrate dark cap -o new", "inspect cap --pixel 1,1")),
    (
        "out/frame_0.tif",
        ("evaluate out --truth truth.exr", "export out -o new.npz"),
    ),
    ("truth.exr", ("evaluate out --truth truth.exr", "preview out/frame_1.tif -o new.png --truth truth.exr")),
    ("cal/dark.toml", ("resolve cap -o new -j 1 --calibration cal", "calibrate response cap -o cal --distance 1")),
    ("cal/dark.exr", ("resolve cap -o new -j 1 --calibration cal", "inspect cap --pixel 1,1 --calibration cal")),
    (
        "out/run.json",
        (
            "resolve cap -o out -j 1 --resume",
            "preview out -o new.png",
            "evaluate out --truth truth.exr",
            "export out -o new.npz",
        ),
    ),
    ("out/frames.jsonl", ("report out -o new.html",)),
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture of three frames, its maps, a truth and a calibration."""
    place = tmp_path_factory.mktemp("odd") / "place"
    capture = record(place / "cap", frames=3)
    assert cadtof("resolve", capture.folder, "-o", place / "out", "-j", 1).status == 0
    dark, rng = record(place.parent / "dark", frames=2), np.random.default_rng(1)
    for file in dark.files:
        write_frame(file, rng.normal(scale=4e-4, size=(2, 2, 24, 32)))
    assert cadtof("calibrate", "dark", dark.folder, "-o", place / "cal").status == 0
    write_exr(place / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    return place


@pytest.fixture
def here(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of `whole`, which is the current folder."""
    shutil.copytree(whole, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return Path()


@pytest.fixture(autouse=True)
def time_limit() -> Iterator[None]:
    """Fail a test that waits for something that never comes."""

    def late(_number: int, _frame: FrameType | None) -> NoReturn:
        raise TimeoutError(f"still waiting after {AT_ONCE_S} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(AT_ONCE_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def _put(kind: str, path: Path) -> str:
    path.unlink(missing_ok=True)
    make, message = KINDS[kind]
    make(path)
    return message


def _require_refused(done: Finished, path: Path, message: str) -> None:
    assert done.status in {1, 2}
    assert f"{path}: cannot be read: {message}" in done.err
    assert done.err.startswith("Error: ") or "\nError: " in done.err
    assert "unexpected" not in done.err


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("name", "commands"), REFUSED, ids=[name for name, _ in REFUSED])
def test_what_is_no_file_is_refused_by_name(name: str, commands: tuple[str, ...], kind: str, here: Path) -> None:
    message = _put(kind, here / name)
    for command in commands:
        done = cadtof(*command.split())
        if (name, kind) == ("truth.exr", "folder"):
            # truth may be a folder that holds the truth of every capture
            assert done.status in {1, 2}
            assert f"Error: {here / name}: found no truth of frame_" in done.err
        else:
            _require_refused(done, here / name, message)
    assert not (here / "new").exists()
    assert not (here / "new.png").exists()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", [FIRST, FRAME])
def test_in_place_of_a_frame_it_fails_alone(name: str, kind: str, here: Path) -> None:
    message = _put(kind, here / name)
    done = cadtof("resolve", "cap", "-o", "new", "-j", 1)
    assert done.status == 1
    assert f"failed: {here / name}: cannot be read: {message}\n" in done.err
    assert "resolved 2 of 3 frames" in done.err
    done = cadtof("info", "cap", "-j", 1)
    assert done.status == 1
    assert f"wrong: {here / name}: cannot be read: {message}\n" in done.err
    assert "3 (2 tif, 2 uint16)" in done.out


@pytest.mark.parametrize("kind", KINDS)
def test_in_place_of_a_map_it_is_reported_and_made_again(kind: str, here: Path) -> None:
    assert cadtof("resolve", "cap", "-o", "again", "-j", 1).status == 0
    message = _put(kind, here / "again" / "frame_1.tif")
    done = cadtof("info", "again", "-j", 1)
    assert (done.status, done.err) == (1, f"wrong: again/frame_1.tif: cannot be read: {message}\n")
    assert f"again/frame_1.tif: cannot be read: {message}\n" in cadtof("preview", "again", "-o", "all.png").err
    done = cadtof("resolve", "cap", "-o", "again", "-j", 1, "--resume")
    if kind == "folder":
        assert "failed: again/frame_1.tif: cannot be written: Is a directory" in done.err
        return
    assert done.status == 0
    assert (here / "again" / "frame_1.tif").read_bytes() == (here / "out" / "frame_1.tif").read_bytes()
    assert not (here / "again" / "frame_1.tif").is_symlink()


@pytest.mark.parametrize("kind", KINDS)
def test_in_place_of_frames_jsonl_it_is_refused(kind: str, here: Path) -> None:
    assert cadtof("resolve", "cap", "-o", "again", "-j", 1).status == 0
    _put(kind, here / "again" / "frames.jsonl")
    done = cadtof("resolve", "cap", "-o", "again", "-j", 1, "--resume")
    assert done.status == 2
    assert done.err.startswith("Error: again/frames.jsonl: cannot be written: ")


@pytest.mark.parametrize("kind", KINDS)
def test_in_place_of_a_raw_dump_and_of_a_plane(kind: str, here: Path) -> None:
    counts = ("--volts-per-count", 6e-5, "--zero-counts", 8192)
    described = ("--raw-dtype", "uint16", "--raw-shape", "2,2,24,32")
    (here / "dumps").mkdir()
    message = _put(kind, here / "dumps" / "dump.raw")
    done = cadtof("resolve", "dumps/dump.raw", "-o", "new", "-j", 1, *described, *counts)
    assert done.status in {1, 2}
    assert ("dumps/dump.raw: no frames" if kind == "folder" else message) in done.err
    (here / "planes").mkdir()
    for name in ("h1_c1", "h1_c2", "h2_c1", "h2_c2"):
        write_pages(here / "planes" / f"{name}.tif", np.full((1, 24, 32), 9000, np.uint16))
    message = _put(kind, here / "planes" / "h1_c2.tif")
    done = cadtof("resolve", "planes", "-o", "new_planes", "-j", 1, "--pattern", "h{harmonic}_c{channel}.tif", *counts)
    assert done.status == 1
    assert f"failed: planes/h1_c2.tif: cannot be read: {message}" in done.err


@pytest.mark.parametrize("kind", KINDS)
def test_as_the_input_of_a_command_it_is_named(kind: str, here: Path) -> None:
    _put(kind, here / "thing")
    for command in (
        "resolve thing -o new -j 1",
        "info thing -j 1",
        "preview thing -o new.png",
        "evaluate thing --truth truth.exr",
        "export thing -o new.npz",
        "inspect thing --pixel 1,1",
        "calibrate dark thing -o new",
        "info cap --settings thing",
    ):
        done = cadtof(*command.split())
        assert done.status in {1, 2}, command
        assert "thing" in done.err
        assert "unexpected" not in done.err


def test_a_first_frame_of_another_size_fails_alone(here: Path) -> None:
    shutil.copy(here / FIRST, here / "kept.tif")
    small = record(here / "small", frames=1)
    for name in (FIRST, FRAME):
        shutil.copy(here / "kept.tif", here / FIRST)
        shutil.copy(here / "kept.tif", here / FRAME)
        _shrunk(small.files[0], here / name)
        done = cadtof("resolve", "cap", "-o", f"new_{Path(name).stem}", "-j", 1)
        assert done.status == 1
        message = f"{name}: found 32 × 20 pixels, expected 32 × 24 as most frames of the capture have"
        assert f"failed: {message}\n" in done.err
        assert "resolved 2 of 3 frames" in done.err
        assert f"wrong: {message}\n" in cadtof("info", "cap", "-j", 1).err
        assert f"Error: {message}\n" in cadtof("calibrate", "dark", "cap", "-o", "new").err


def test_sizes_of_compressed_frames_are_counted_too(tmp_path: Path) -> None:
    capture = record(tmp_path / "cap", frames=7)
    for file in capture.files:
        rows = 20 if file == capture.files[0] else 24
        pages = tifffile.imread(file)[:, :rows]
        tifffile.imwrite(file, pages, photometric="minisblack", metadata=None, compression="zlib")
    assert len({file.stat().st_size for file in capture.files}) > 3
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1)
    assert "resolved 6 of 7 frames" in done.err
    assert f"failed: {capture.files[0]}: found 32 × 20 pixels, expected 32 × 24" in done.err


def _shrunk(source: Path, target: Path) -> None:
    """Write the frame in a file without its last four rows."""
    write_pages(target, tifffile.imread(source)[:, :20])


def test_a_folder_named_like_a_frame_may_hold_a_capture(here: Path) -> None:
    (here / "all").mkdir()
    shutil.copytree(here / "cap", here / "all" / "day.exr")
    done = cadtof("resolve", "all", "-r", "-o", "new", "-j", 1)
    assert done.status == 0
    assert "resolved 3 of 3 frames" in done.err


def test_a_run_of_its_own_process_does_not_wait_for_a_fifo(here: Path) -> None:
    _put("fifo", here / FRAME)
    done = program("resolve", "cap", "-o", "new", "-j", 2)
    assert f"failed: {FRAME}: cannot be read: found a FIFO, expected a file" in done.err
