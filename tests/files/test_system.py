"""On systems that lack functions of POSIX, the program works and writes the same maps and records.

These tests do not run on Windows. `tests/support/without_posix` takes away from every process what Windows lacks, and has a
stand-in for its locks.
"""

import codecs
import errno
import json
import ntpath
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from io import FileIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.discovery import steps_below
from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.commands.arrival import paths_as_they_arrive
from cadtof_cli.errors import CadtofError, FrameError, PlaceError
from cadtof_cli.files import system
from cadtof_cli.files.atomic import PartialFile
from cadtof_cli.files.frames import FrameLayout, RawLayout
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.files.system import (
    BLOCK_BYTES,
    OPEN_OR_CREATE_FLAGS,
    common_folder,
    expanded,
    path_from,
    path_of,
    read_at,
    read_parts,
    remove_and_close,
    write_parts,
)
from cadtof_cli.workflows.resolve.output import locked
from tests.support.captures import record
from tests.support.run_cadtof import PROGRAM, ROOT, Finished, program
from tests.support.runs import require_same_run

fcntl, termios = pytest.importorskip("fcntl"), pytest.importorskip("termios")

WITHOUT_POSIX = {
    **os.environ,
    "PYTHONPATH": os.pathsep.join([str(ROOT / "tests" / "support" / "without_posix"), str(ROOT)]),
}

_HOLD = """
import sys
from pathlib import Path
from cadtof_cli.workflows.resolve.output import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def program_without_posix(*arguments: object, stdin: str = "") -> Finished:
    """Run `cadtof` as a program on a system that lacks what only POSIX has."""
    done = subprocess.run(
        [*PROGRAM, *map(str, arguments)],
        input=stdin, env=WITHOUT_POSIX, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    return Finished(done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_a_run_without_posix_is_the_same_run(form: str, tmp_path: Path) -> None:
    capture = record(tmp_path / "A", frames=5, form="tif" if form == "tif" else "exr")
    for out, run in ((tmp_path / "here", program), (tmp_path / "without", program_without_posix)):
        done = run("resolve", capture.folder, "-o", out, "-j", 2, "--start-method", "spawn")
        assert (done.status, "resolved 5 of 5 frames" in done.err) == (0, True), done.err
    require_same_run(tmp_path / "without", tmp_path / "here")


def test_a_run_without_posix_goes_on_where_it_stopped(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=4), tmp_path / "out"
    for options in ((), ("--resume",)):
        assert program_without_posix("resolve", capture.folder, "-o", out, "-j", 1, *options).status == 0
        lines = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
        assert [line["status"] for line in lines] == ["ok"] * 4
        (out / "frame_1.tif").unlink()
    assert program_without_posix("resolve", capture.folder, "-o", out, "-j", 1, "--resume").status == 0
    assert program("resolve", capture.folder, "-o", tmp_path / "whole", "-j", 1).status == 0
    require_same_run(out, tmp_path / "whole")


def test_paths_on_stdin_are_resolved_without_posix(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=3), tmp_path / "out"
    done = program_without_posix("resolve", "-", "-o", out, stdin="".join(f"{path}\n" for path in capture.files))
    assert done.status == 0, done.err
    assert len(list(out.glob("*.tif"))) == 3


def test_a_folder_is_locked_without_posix(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=1), tmp_path / "out"
    out.mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(out)], env=WITHOUT_POSIX, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        done = program_without_posix("resolve", capture.folder, "-o", out, "-j", 1)
        assert done.status == 2
        assert f"{out}: process {holder.pid} on " in done.err
        holder.communicate()
    assert program_without_posix("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    assert not (out / ".cadtof.lock").exists()


def test_a_start_method_that_a_system_lacks(tmp_path: Path) -> None:
    done = program_without_posix("resolve", tmp_path, "-o", tmp_path / "out", "--start-method", "fork")
    assert done.status == 2
    assert "--start-method: found fork, which this system does not have; expected spawn" in done.err


@pytest.mark.parametrize("removes", [True, False])
def test_a_file_is_removed_and_closed_in_either_order(
    removes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(system, "REMOVES_OPEN_FILES", removes)
    path = tmp_path / "lock"
    descriptor = os.open(path, OPEN_OR_CREATE_FLAGS, 0o666)
    remove_and_close(path, descriptor)
    assert not path.exists()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)


def test_closing_a_file_on_a_share_that_is_gone_hides_no_other_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    close = os.close

    def close_and_fail(descriptor: int) -> None:
        close(descriptor)
        raise OSError(errno.ENOTCONN, "Transport endpoint is not connected")

    def write_and_fail(_descriptor: int, _parts: object) -> None:
        raise OSError(errno.ENOTCONN, "Transport endpoint is not connected")

    monkeypatch.setattr("cadtof_cli.files.atomic.write_parts", write_and_fail)
    with locked(tmp_path):
        file = PartialFile(tmp_path / "maps")
        file.parts = [memoryview(b"maps")]
        monkeypatch.setattr(os, "close", close_and_fail)
        # no other file can be written there either, so this is a PlaceError: the run stops at once
        with pytest.raises(PlaceError, match="maps: cannot be written: Transport endpoint is not connected"):
            file.commit()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("vectors", [True, False])
def test_parts_are_written_and_read_as_one_file(vectors: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not vectors:
        for name in ("readv", "pread"):
            monkeypatch.delattr(os, name, raising=False)
    path, pieces = tmp_path / "file", (b"head", b"", bytes(range(256)) * 300, b"t")
    with FileIO(path, "wb") as file:
        write_parts(file.fileno(), [memoryview(piece) for piece in pieces])
    assert path.read_bytes() == b"".join(pieces)
    found = [bytearray(len(piece)) for piece in pieces]
    with FileIO(path) as file:
        assert read_parts(file.fileno(), [memoryview(one) for one in found])
        place = file.tell()
        assert read_at(file.fileno(), 6, 2) == b"ad\x00\x01\x02\x03"
        assert file.tell() == place
    assert found == [bytearray(piece) for piece in pieces]
    with FileIO(path) as file:
        assert not read_parts(file.fileno(), [memoryview(bytearray(path.stat().st_size + 1))])


def test_a_system_that_moves_a_few_bytes_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole_write, whole_read = os.write, os.readv
    monkeypatch.setattr(os, "write", lambda file, part: whole_write(file, part[:7]))
    monkeypatch.setattr(os, "readv", lambda file, parts: whole_read(file, [parts[0][:5], *parts[1:1]]))
    values, path = np.arange(100, dtype=np.uint8), tmp_path / "file"
    with FileIO(path, "wb") as file:
        write_parts(file.fileno(), [memoryview(b"before"), values.data, memoryview(b"after")])
    assert path.read_bytes() == b"before" + values.tobytes() + b"after"
    out = np.zeros(105, np.uint8)
    with FileIO(path) as file:
        assert read_parts(file.fileno(), [memoryview(bytearray(6)), out.data])
    assert out.tobytes() == values.tobytes() + b"after"


def blocks(count: int, more: int = 0) -> NDArray[np.float32]:
    """Return values whose memory begins at a block boundary and takes `count` blocks and `more` values."""
    values = DepthMaps.empty((), (1, count * BLOCK_BYTES // 4 + more)).pages.reshape(-1)
    values[:] = np.random.default_rng(5).random(values.shape)
    return values


Write = Callable[[int, memoryview], int]


def refuse_direct_writes(write: Write, descriptor: int, part: memoryview) -> int:
    """Write as a file system that lets a file be opened with O_DIRECT, but refuses to write to it."""
    if fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_DIRECT:
        raise OSError(errno.EINVAL, "Invalid argument")
    return write(descriptor, part)


def write_in_pieces(write: Write, descriptor: int, part: memoryview) -> int:
    """Write as a file system that takes 128 KiB at a time at most."""
    return write(descriptor, part[: 2**17])


@pytest.mark.parametrize("file_system", [None, refuse_direct_writes, write_in_pieces])
@pytest.mark.parametrize("head", [BLOCK_BYTES, BLOCK_BYTES - 4])
@pytest.mark.parametrize("more", [0, 300])
def test_whole_blocks_are_written_past_the_cache(
    file_system: Callable[..., int] | None, head: int, more: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if file_system is not None:
        monkeypatch.setattr(os, "write", partial(file_system, os.write))
    values, path = blocks(100, more), tmp_path / "file"
    with FileIO(path, "wb") as file:
        write_parts(file.fileno(), [memoryview(b"h" * head), values.data.cast("B"), memoryview(b"tail")])
        # later writes go through the cache again
        assert not fcntl.fcntl(file.fileno(), fcntl.F_GETFL) & os.O_DIRECT
    assert path.read_bytes() == b"h" * head + values.tobytes() + b"tail"


def test_a_full_disk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_descriptor: int, _part: memoryview) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    path = tmp_path / "maps.tif"
    held = PartialFile(path)
    held.parts = [blocks(100).data.cast("B")]
    with pytest.raises(PlaceError, match="cannot be written: No space left on device"):
        held.commit()
    assert list(tmp_path.iterdir()) == []


POSIX_ALONE = (
    r"\b(fcntl|O_NOFOLLOW|O_CLOEXEC|O_NONBLOCK|O_DIRECTORY|O_DIRECT|pread|pwrite|readv|writev|uname"
    r"|SIGHUP|SIGKILL|pthread_sigmask)\b"
)


def test_names_that_only_posix_has_are_used_in_three_modules() -> None:
    package = ROOT / "cadtof_cli"
    asking = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if re.search(POSIX_ALONE, re.sub(r'"""[\s\S]*?"""|#.*', "", path.read_text()))
    }
    # two more modules handle signals; one of them also ends workers with their parent, as only Linux can
    assert asking == {"files/system.py", "execution/starting.py", "cli.py"}


_IMPORT_ALL = """
import importlib, pkgutil
import cadtof_cli
names = [found.name for found in pkgutil.walk_packages(cadtof_cli.__path__, "cadtof_cli.")]
kept = [name for name in names if not name.endswith("__main__") and ".execution.cluster" not in name]
for name in kept:
    importlib.import_module(name)
print(len(kept))
"""


def test_every_module_is_imported_without_posix() -> None:
    """Modules of the cluster are left out: the package distributed decides where they can be imported."""
    done = subprocess.run(
        [sys.executable, "-c", _IMPORT_ALL], env=WITHOUT_POSIX, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 150


def test_commands_work_without_posix(tmp_path: Path) -> None:
    capture, maps = tmp_path / "capture", tmp_path / "maps"
    size = ("--frames", 2, "--width", 32, "--height", 24)
    for arguments in (
        ("--help",),
        ("simulate", "--scene", "card", "-o", capture, *size),
        ("resolve", capture, "-o", maps, "-j", 2),
        ("info", capture, maps),
        ("evaluate", maps, "--truth", capture / "truth.exr"),
        ("report", maps, "-o", tmp_path / "page.html"),
        ("export", maps, "-o", tmp_path / "points.ply"),
    ):
        done = program_without_posix(*arguments)
        assert done.status == 0, done.err
    assert len(list(maps.glob("*.tif"))) == 2


def test_paths_on_different_drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture, out = record(tmp_path / "A", frames=1), tmp_path / "out"
    assert path_from(out, capture.folder) == "../A"
    assert common_folder([capture.folder, out / "B"]) == tmp_path

    def other_drive(*_paths: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(os.path, "relpath", other_drive)
    assert path_from(out, capture.folder) == str(capture.folder)
    assert steps_below(capture.folder, out) == capture.folder.parts[1:]
    monkeypatch.setattr(os.path, "commonpath", other_drive)
    with pytest.raises(CadtofError, match=r"no folder holds both .*A and .*out; expected inputs on one drive"):
        common_folder([out, capture.folder])


def test_an_empty_folder_becomes_a_capture_without_posix(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    done = program_without_posix("simulate", "--scene", "wall", "--width", 4, "--height", 3, "-o", out)
    assert done.status == 0, done.err
    assert (out / "capture.toml").is_file()


@pytest.mark.parametrize("name", ["frame.npy", "frame.raw"])
def test_no_file_stays_mapped_while_an_error_is_kept(name: str, tmp_path: Path) -> None:
    """Python shells keep the last error and all that its traceback holds. Windows cannot replace a mapped file."""
    path, layout = tmp_path / name, FrameLayout((1, 2, 3), raw=RawLayout("uint16", (4, 24, 32)))
    planes = np.zeros((4, 24, 32), np.uint16)
    path.write_bytes(planes.tobytes())
    if name.endswith(".npy"):
        np.save(path, planes)
    with pytest.raises(FrameError) as kept, open_frames(FrameSource("frame", (path,)), layout):
        pass
    assert "found 4 planes" in str(kept.value)
    assert name not in Path("/proc/self/maps").read_text()
    assert path not in [one.resolve() for one in Path("/proc/self/fd").iterdir()]


def test_patterns_that_the_shell_leaves_to_programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("b", "a", "[c]", ".hidden"):
        (tmp_path / name).mkdir()
    every, typed = str(tmp_path / "*"), ["resolve", "-o", "*", str(tmp_path / "?x"), "[a]", "--log=*", r"\\?\C:\a"]
    assert expanded(["resolve", every]) == ["resolve", every]
    monkeypatch.setattr(system, "SHELL_LEAVES_PATTERNS", True)
    monkeypatch.setattr(os.path, "splitdrive", ntpath.splitdrive)
    monkeypatch.chdir(tmp_path / "a")
    assert expanded(typed) == typed
    assert expanded(["resolve", every, "-r"]) == [
        "resolve",
        *(str(tmp_path / name) for name in ("[c]", "a", "b")),
        "-r",
    ]
    assert expanded([str(tmp_path / "[*")]) == [str(tmp_path / "[c]")]


def test_names_in_the_code_page_of_the_console(monkeypatch: pytest.MonkeyPatch) -> None:
    def as_on_windows(name: bytes) -> str:
        return name.decode()

    def find(encoding: str) -> codecs.CodecInfo | None:
        return codecs.lookup("cp850") if encoding == "oem" else None

    monkeypatch.setattr(os, "fsdecode", as_on_windows)
    codecs.register(find)
    try:
        assert path_of("größe/深度.tif".encode()) == Path("größe/深度.tif")
        assert path_of("größe.tif".encode("cp850")) == Path("größe.tif")
    finally:
        codecs.unregister(find)


def test_a_pipe_that_select_cannot_wait_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first batch of paths on stdin decides where maps lie, so it must not be just what the first read found."""
    reader, writer = os.pipe()
    (tmp_path / "list").write_text("a\nb\n")

    def no_pipes(*_: object) -> None:
        raise OSError(errno.ENOTSOCK, "not a socket")

    def peek(pipe: int, _size: int) -> tuple[int, int]:
        if pipe != reader:
            raise OSError(errno.EINVAL, "Incorrect function")
        waiting = int.from_bytes(fcntl.ioctl(reader, termios.FIONREAD, bytes(4)), sys.byteorder)
        if not waiting and written.is_set():
            raise BrokenPipeError(errno.EPIPE, "The pipe has been ended")
        return waiting, 0

    def write() -> None:
        for line in (b"a\n", b"b\n", b"c\n"):
            time.sleep(0.05)
            os.write(writer, line)
        os.close(writer)
        written.set()

    written = threading.Event()
    monkeypatch.setattr("select.select", no_pipes)
    monkeypatch.setitem(sys.modules, "_winapi", SimpleNamespace(PeekNamedPipe=peek))
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(get_osfhandle=int))
    threading.Thread(target=write).start()
    with os.fdopen(reader, "rb"):
        assert list(paths_as_they_arrive(reader, separator=b"\n")) == [(Path("a"), Path("b"), Path("c"))]
    with (tmp_path / "list").open("rb") as file:
        assert list(paths_as_they_arrive(file.fileno(), separator=b"\n")) == [(Path("a"), Path("b"))]
