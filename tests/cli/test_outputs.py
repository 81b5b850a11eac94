"""Where maps go: which folders are refused, what a full or read-only disk costs, and how a stopped run is resumed."""

import errno
import json
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.captures import MAP_LAYERS, Form, record
from tests.support.run_cadtof import Finished, cadtof, program, with_small_files, without_privilege


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def _lines(out: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]


def _require_refused(done: Finished, message: str) -> None:
    assert done.err.startswith(f"Error: {message}")
    assert (done.status, done.out) == (2, "")
    assert "Traceback" not in done.err


def test_an_out_that_is_a_file_is_refused(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    (tmp_path / "out").write_text("mine")
    out = tmp_path / "out"
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1)
    _require_refused(done, f"{out}: found a file, expected a folder that can be written into\n")
    done = cadtof("resolve", capture.folder, "-o", out / "deeper", "-j", 1)
    _require_refused(done, f"{out / 'deeper'}: expected a folder that can be written into: Not a directory")
    assert (tmp_path / "out").read_text() == "mine"


def test_an_out_without_permission_is_refused(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    out = tmp_path / "out"
    out.mkdir(mode=0o555)
    done = without_privilege("resolve", capture.folder, "-o", out)
    _require_refused(done, f"{out}: expected a folder that can be written into: Permission denied")
    done = without_privilege("resolve", capture.folder, "-o", out / "deeper")
    _require_refused(done, f"{out / 'deeper'}: expected a folder that can be written into: Permission denied")
    assert not list(out.iterdir())


def test_an_out_with_recorded_frames_is_refused(tmp_path: Path) -> None:
    a, b = record(tmp_path / "a"), record(tmp_path / "b", seed=1)
    before = _files(a.folder)
    message = f"{a.folder}: the maps would be written among recorded frames; choose another folder with -o"
    for inputs in ((a.folder,), (a.files[0],), (b.folder,)):
        for extra in ((), ("--overwrite",), ("--resume",)):
            _require_refused(cadtof("resolve", *inputs, "-o", a.folder, "-j", 1, *extra), message)
    (a.folder / "capture.toml").unlink()
    _require_refused(
        cadtof("resolve", a.folder, "-o", a.folder, "-j", 1, "--volts-per-count", 6e-5, "--zero-counts", 8192), message
    )
    for extra in ((), ("--overwrite",), ("--resume",)):
        _require_refused(
            cadtof("resolve", b.folder, "-o", a.folder, "-j", 1, *extra),
            f"{a.folder}: would replace frame_0.tif, which no run made; choose another folder with -o",
        )
    assert _files(a.folder) == {name: content for name, content in before.items() if name != "capture.toml"}


def test_maps_are_replaced_only_with_overwrite(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=4), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--order", 1).status == 0
    before = _files(out)
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1)
    _require_refused(
        done, f"{out}: frame_0.tif, frame_1.tif, frame_2.tif and 3 more would be replaced; add --overwrite"
    )
    assert _files(out) == before
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--overwrite").status == 0
    after = _files(out)
    assert after.keys() == before.keys()
    assert all(after[name] != before[name] for name in before)


def test_maps_without_their_record_and_files_that_nobody_can_read_are_replaced_with_overwrite(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    (out / "run.json").unlink()
    (out / "frame_1.tif").write_bytes(b"II*")
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1)
    _require_refused(done, f"{out}: frame_0.tif, frame_1.tif, frames.jsonl would be replaced; add --overwrite")
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--overwrite").status == 0


def test_nothing_of_the_run_that_is_overwritten_stays(tmp_path: Path) -> None:
    """An old map would be taken for one of the new run.

    The old maps are of frames that are not resolved again, fail now, or get another format now.
    """
    capture, out = record(tmp_path / "capture", frames=4), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    moved = out.rename(tmp_path / "moved")
    capture.files[3].write_bytes(b"II*")
    again = ("resolve", capture.folder, "-o", moved, "-j", 1, "--overwrite", "--frames", "1:4", "--format", "exr")
    assert cadtof(*again, "--dry-run").status == 0
    assert len(_files(moved)) == 6
    assert cadtof(*again).status == 1
    assert sorted(_files(moved)) == ["frame_1.exr", "frame_2.exr", "frames.jsonl", "run.json"]


def test_a_map_that_cannot_be_removed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder with the sticky bit, maps of another user stay."""
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    unlink = Path.unlink

    def not_that_one(path: Path, missing_ok: bool = False) -> None:
        if path == out / "frame_1.tif":
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(path))
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", not_that_one)
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--overwrite")
    _require_refused(done, f"{out / 'frame_1.tif'}: cannot be written: {os.strerror(errno.EPERM)}")


def test_what_only_looks_like_a_map_of_the_earlier_run_stays(tmp_path: Path) -> None:
    capture, out, mine = record(tmp_path / "capture"), tmp_path / "out", tmp_path / "mine"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    (line,) = (out / "frames.jsonl").read_text().splitlines()
    mine.mkdir()
    (out / "below").symlink_to(mine)
    of_others = [mine / "a.tif", mine / "b.tif", out / "longer.tif", out / "notes.txt"]
    for path in of_others:
        path.write_bytes((out / "frame_0.tif").read_bytes() + b"." * path.match("longer.tif"))
    called = json.dumps(str(out / "frame_0.tif"))
    for place in ("../mine/a.tif", "below/b.tif", "longer.tif", "notes.txt", "gone.tif", "x\0.tif"):
        with (out / "frames.jsonl").open("a") as lines:
            lines.write(line.replace(called, json.dumps(f"{out}/{place}")) + "\n")
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--overwrite").status == 0
    assert all(path.exists() for path in of_others)


def test_a_map_of_a_stack_is_replaced_only_with_overwrite(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    out.mkdir()
    (out / "frame_0_0001.tif").write_text("mine")
    _require_refused(
        cadtof("resolve", capture.folder, "-o", out, "-j", 1), f"{out}: frame_0_0001.tif would be replaced"
    )
    assert _files(out) == {"frame_0_0001.tif": b"mine"}


def test_other_files_in_out_stay(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    out.mkdir()
    for name in ("notes.txt", "frame_1.tif", ".frame_0.tif.99.partial"):
        (out / name).write_text(name)
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--overwrite").status == 0
    assert sorted(_files(out)) == ["frame_0.tif", "frame_1.tif", "frames.jsonl", "notes.txt", "run.json"]
    assert (out / "frame_1.tif").read_text() == "frame_1.tif"


def test_resume_resolves_the_missing_frames(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=5), tmp_path / "out"
    content = capture.files[3].read_bytes()
    capture.files[3].write_bytes(content[:-50])
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 1
    capture.files[3].write_bytes(content)
    (out / "frame_1.tif").unlink()
    kept = {name: (out / name).stat().st_mtime_ns for name in ("frame_0.tif", "frame_2.tif", "frame_4.tif")}
    # as a kill or a full disk may leave it
    with (out / "frames.jsonl").open("a") as lines:
        lines.write('{"source": "torn')
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--resume", "--json")
    assert done.status == 0
    told = [json.loads(line) for line in done.out.splitlines()]
    assert [line["status"] for line in told] == ["skipped", "ok", "skipped", "ok", "skipped"]
    assert told[0]["reason"] == f"{out / 'frame_0.tif'} exists already"
    assert "resolved 2 of 5 frames" in done.err
    assert {name: (out / name).stat().st_mtime_ns for name in kept} == kept
    fresh = tmp_path / "fresh"
    assert cadtof("resolve", capture.folder, "-o", fresh, "-j", 1).status == 0
    for file in fresh.glob("*.tif"):
        assert (out / file.name).read_bytes() == file.read_bytes()
    assert [(Path(str(line["source"])).name, line["status"]) for line in _lines(out)] == [
        (f"frame_{index}.tif", "ok") for index in range(5)
    ]


def test_resume_takes_the_same_frames_or_more(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=5), tmp_path / "out"
    resolve = ("resolve", capture.folder, "-o", out, "-j", 1)
    assert cadtof(*resolve, "--frames", "1:3").status == 0
    before = _files(out)
    for fewer in ("2:3", "1:2", "2:", "0:2", "4:5"):
        refused = cadtof(*resolve, "--resume", "--frames", fewer)
        _require_refused(
            refused, f"{out / 'run.json'}: cannot resume: --frames may leave out frames of the earlier run"
        )
        assert _files(out) == before
    for more in (("--frames", "1:4"), ("--frames", "0:4"), ("--frames", "0:"), ()):
        assert cadtof(*resolve, "--resume", *more).status == 0
    assert len(_lines(out)) == 5


def test_resume_in_an_empty_folder_is_a_run(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--resume").status == 0
    assert [line["status"] for line in _lines(out)] == ["ok", "ok"]


def test_resume_needs_the_same_version(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    record_file = out / "run.json"
    document = json.loads(record_file.read_text())
    record_file.write_text(json.dumps(document | {"cadtof": "0.0.1"}))
    before = _files(out)
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--resume")
    _require_refused(
        done, f"{record_file}: cannot resume: version of cadtof was '0.0.1' and is '{document['cadtof']}' now"
    )
    assert "use that version, or --overwrite" in done.err
    assert _files(out) == before


def test_resume_needs_the_same_settings(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    before = _files(out)
    for options, message in (
        (("--order", "1"), "order was 'auto' and is '1' now; give the same options and settings, or --overwrite"),
        (("--depth", "z"), "depth was 'range' and is 'z' now"),
        (("--format", "exr"), "map_format was 'same' and is 'exr' now"),
        (("--amplitude", "0.3"), f"{capture.folder}: modulation.amplitude_v was 0.2746 and is 0.3 now"),
    ):
        done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--resume", *options)
        _require_refused(done, f"{out / 'run.json'}: cannot resume: {message}")
    assert _files(out) == before
    toml = capture.folder / "capture.toml"
    toml.write_text(toml.read_text().replace("0.2746", "0.3"))
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--resume")
    _require_refused(
        done, f"{out / 'run.json'}: cannot resume: {capture.folder}: modulation.amplitude_v was 0.2746 and is 0.3"
    )


@pytest.mark.parametrize("name", ["run.json", "frames.jsonl"])
@pytest.mark.parametrize("content", ["[]\n", "{\n", "3\n"])
def test_resume_refuses_a_record_that_is_none_of_a_run(name: str, content: str, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    (out / name).write_text(content)
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--resume")
    _require_refused(done, f"{out / name}: not the record of a run, so it cannot be resumed")


@pytest.mark.parametrize("map_format", ["tif", "exr"])
@pytest.mark.parametrize("jobs", [1, 2])
def test_maps_beyond_the_limit_of_file_sizes_leave_nothing_behind(map_format: str, jobs: int, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=3), tmp_path / "out"
    words = ("resolve", capture.folder, "-o", out, "-j", jobs, "--format", map_format)
    done = with_small_files(16_000, *words)
    failed, stopped = done.err.splitlines()
    assert failed == (
        f"failed: {out / f'frame_0.{map_format}'}: cannot be written: File too large for {len(MAP_LAYERS) * 4 * 24 * 32:,} bytes;"
        " here a file may have 16,000 (ulimit -f)"
    )
    assert stopped.startswith(
        f"Error: {out}: no more maps can be written there, so the run stopped with 0 frames resolved"
    )
    assert done.status == 1
    assert sorted(path.name for path in out.iterdir()) == ["frames.jsonl", "run.json"]
    assert [line["status"] for line in _lines(out)] == ["failed"]
    # without the limit the run goes on
    assert program(*words, "--resume").status == 0
    assert len(list(out.glob(f"frame_?.{map_format}"))) == 3


def test_a_record_that_takes_no_more_lines_ends_the_run_like_a_map_that_cannot_be_written(tmp_path: Path) -> None:
    """Maps of a few pixels fit below the limit, and a line per frame does not."""
    capture, out = record(tmp_path / "capture", frames=30), tmp_path / "out"
    words = ("resolve", capture.folder, "-o", out, "-j", 1, "--roi", "0,0,4,4")
    done = with_small_files(9_000, *words)
    lines = len(_lines(out))
    assert 0 < lines < 30
    assert done.err == (
        f"Error: {out / 'frames.jsonl'}: cannot be written: File too large; here a file may have 9,000 (ulimit -f), so the run"
        f" stopped with {lines} frames resolved; remove the cause, then the same command with --resume goes on\n"
    )
    assert done.status == 1
    assert program(*words, "--resume").status == 0
    assert len(_lines(out)) == 30


def test_a_scene_beyond_the_limit_of_file_sizes_names_the_file(tmp_path: Path) -> None:
    for frame_format in ("tif", "exr"):
        out = tmp_path / frame_format
        done = with_small_files(
            9_000,
            "simulate",
            "--scene",
            "corner",
            "-o",
            out,
            "--frames",
            1,
            "--width",
            64,
            "--height",
            48,
            "--format",
            frame_format,
        )
        assert done.status == 2
        message = r"cannot be written: File too large; here a file may have 9,000 \(ulimit -f\)"
        assert re.fullmatch(rf"Error: {re.escape(str(out))}(/[\w.]+)?: {message}\n", done.err), done.err
        assert not list(tmp_path.iterdir())


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 300 kB; only root can make one."""
    place = tmp_path / "small"
    place.mkdir()
    # room for about eleven maps of `record`
    mount = ("mount", "-t", "tmpfs", "-o", f"size={38_400 * len(MAP_LAYERS)}", "tmpfs", str(place))
    if os.geteuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode != 0:
        pytest.skip("nothing can be mounted here")
    yield place
    subprocess.run(("umount", str(place)), check=True)


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_a_full_disk_leaves_whole_maps_and_ends_the_run(small_disk: Path, form: Form, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=16, form=form), small_disk / "out"
    # 16 maps do not fit; the rest, which is less than a map, has room for the lines
    done = program("resolve", capture.folder, "-o", out, "-j", 2)
    assert done.status in {1, 2}
    assert "No space left on device" in done.err
    assert "Traceback" not in done.err
    assert "unexpected" not in done.err
    names = sorted(path.name for path in out.iterdir())
    assert not [name for name in names if name.endswith(".partial")]
    written = [name for name in names if name.startswith("frame_")]
    assert 5 <= len(written) < 16
    # no frame is computed whose maps cannot be written
    assert done.err.count("No space left") <= 2
    assert len([line for line in _lines(out) if line["status"] == "failed"]) <= 1
    subprocess.run(("mount", "-o", "remount,size=2m", str(small_disk)), check=True)
    done = program("resolve", capture.folder, "-o", out, "-j", 2, "--resume")
    assert (done.status, len(list(out.glob("frame_*")))) == (0, 16)
    fresh = tmp_path / "fresh"
    assert program("resolve", capture.folder, "-o", fresh, "-j", 2).status == 0
    for name in written:
        assert (out / name).read_bytes() == (fresh / name).read_bytes()
    last = {line["source"]: line["status"] for line in _lines(out)}
    assert last == dict.fromkeys(map(str, capture.files), "ok")


def test_a_read_only_disk_is_refused(small_disk: Path, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    subprocess.run(("mount", "-o", "remount,ro", str(small_disk)), check=True)
    out = small_disk / "out"
    done = cadtof("resolve", capture.folder, "-o", out, "-j", 1)
    _require_refused(done, f"{out}: expected a folder that can be written into: Read-only file system")
    assert not out.exists()
