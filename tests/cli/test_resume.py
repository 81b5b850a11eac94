"""`--resume`: only the same run goes on, only unchanged frames keep their maps, and the record is that of one run."""

import json
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cadtof_cli.capture.frames import FrameSource
from cadtof_cli.files.layers import write_layers
from cadtof_cli.pipeline.plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.workflows.recording import FrameReader, Recording
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from tests.support.captures import TOML, Recorded, counts_of, layers_of, record, write_frame, write_pages
from tests.support.forward import step_frame
from tests.support.run_cadtof import Finished, cadtof, program, without_privilege
from tests.support.runs import lines_of, maps_of, require_same_run, run_of


def _resolve(*arguments: object) -> Finished:
    return cadtof("resolve", *arguments, "-j", 1)


def _skipped(done: Finished) -> int:
    return sum(json.loads(line)["status"] == "skipped" for line in done.out.splitlines())


def test_a_capture_is_known_by_where_it_is_not_by_how_it_was_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture, out = record(tmp_path / "A", frames=3), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    monkeypatch.chdir(tmp_path)
    done = _resolve("./A", "-o", "out", "--resume", "--periods-ns", "30,15")
    assert done.status == 2
    assert "modulation.periods_ns was [40.0, 20.0] and is [30.0, 15.0] now" in done.err
    done = _resolve("A", "-o", "out", "--resume", "--json")
    assert (done.status, _skipped(done)) == (0, 3)
    assert _resolve("A", "-o", "fresh").status == 0
    require_same_run(Path("out"), Path("fresh"))


def test_the_record_holds_every_setting_that_changes_maps(tmp_path: Path) -> None:
    """--resume compares what is recorded, so a setting that is not recorded could be changed unnoticed."""
    assert _resolve(record(tmp_path / "A").folder, "-o", tmp_path / "out").status == 0
    records = {"maps", "resolver"}
    under_other_names = {"settings_file", "min_confidence_v"}
    change_no_map = {"out", "workers", "overwrite", "resume", "dry_run"}
    every = {one.name for record in (ResolveSettings, MapSettings, ResolverSettings) for one in fields(record)}
    lost = every - records - under_other_names - change_no_map - run_of(tmp_path / "out")["arguments"].keys()
    assert not lost, (
        f"workflows/resolve/run_document.py: `arguments` lacks {lost}; or name it here if it changes no map"
    )


def test_another_capture_with_the_same_names(tmp_path: Path) -> None:
    a, b, out = record(tmp_path / "A", frames=2), record(tmp_path / "B", frames=2, seed=1), tmp_path / "out"
    assert _resolve(a.folder, "-o", out).status == 0
    done = _resolve(b.folder, "-o", out, "--resume")
    assert done.status == 2
    assert f"cannot resume: list of captures was [{str(a.folder)!r}] and is [{str(b.folder)!r}] now" in done.err
    (tmp_path / "link").symlink_to(a.folder)
    linked = tmp_path / "linked"
    assert _resolve(tmp_path / "link", "-o", linked).status == 0
    (tmp_path / "link").unlink()
    (tmp_path / "link").symlink_to(b.folder)
    assert _resolve(tmp_path / "link", "-o", linked, "--resume").status == 2


def test_a_run_of_other_inputs_cannot_be_resumed(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=3), tmp_path / "out"
    assert _resolve(*capture.files[:2], "-o", out).status == 0
    done = _resolve(*capture.files, "-o", out, "--resume")
    assert done.status == 2
    assert "cannot resume: resolved_inputs was" in done.err


def test_a_run_without_its_run_json(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=2), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    (out / "run.json").unlink()
    done = _resolve(capture.folder, "-o", out, "--resume")
    assert done.status == 2
    assert "found frame_0.tif, frame_1.tif, frames.jsonl and no run.json" in done.err
    assert _resolve(capture.folder, "-o", out, "--overwrite").status == 0


def _other_frame(capture: Recorded, _out: Path) -> None:
    write_frame(capture.files[1], step_frame(np.random.default_rng(99)))


def _other_frame_with_the_old_time(capture: Recorded, out: Path) -> None:
    before = capture.files[1].stat()
    _other_frame(capture, out)
    assert capture.files[1].stat().st_size == before.st_size
    os.utime(capture.files[1], ns=(before.st_atime_ns, before.st_mtime_ns))


def _truncated(capture: Recorded, _out: Path) -> None:
    os.truncate(capture.files[1], 1000)


def _emptied(capture: Recorded, _out: Path) -> None:
    os.truncate(capture.files[1], 0)


def _map_truncated(_capture: Recorded, out: Path) -> None:
    os.truncate(out / "frame_1.tif", 1000)


def _map_emptied(_capture: Recorded, out: Path) -> None:
    os.truncate(out / "frame_1.tif", 0)


def _map_changed(_capture: Recorded, out: Path) -> None:
    content, before = bytearray((out / "frame_1.tif").read_bytes()), (out / "frame_1.tif").stat()
    content[len(content) // 2] ^= 1
    (out / "frame_1.tif").write_bytes(content)
    os.utime(out / "frame_1.tif", ns=(before.st_atime_ns, before.st_mtime_ns))


def _map_gone(_capture: Recorded, out: Path) -> None:
    (out / "frame_1.tif").unlink()


def _line_lost(_capture: Recorded, out: Path) -> None:
    lines = (out / "frames.jsonl").read_text().splitlines(keepends=True)
    (out / "frames.jsonl").write_text("".join(lines[:1] + lines[2:]))


@pytest.mark.parametrize(
    ("fault", "message", "status"),
    [
        (_other_frame, "frame_1.tif: its recorded frame has changed since; made again", 0),
        (_other_frame_with_the_old_time, "frame_1.tif: its recorded frame has changed since; made again", 0),
        (_truncated, "frame_1.tif: removed, because its recorded frame cannot be resolved any more", 1),
        (_emptied, "frame_1.tif: removed, because its recorded frame cannot be resolved any more", 1),
        (_map_truncated, "frame_1.tif: changed since it was written; made again", 0),
        (_map_emptied, "frame_1.tif: changed since it was written; made again", 0),
        (_map_changed, "frame_1.tif: changed since it was written; made again", 0),
        (_map_gone, "frame_1.tif: is gone; made again", 0),
        (_line_lost, "frame_1.tif: has no line in frames.jsonl, probably because a run was stopped; made again", 0),
    ],
)
def test_what_changed_is_done_again(
    fault: Callable[[Recorded, Path], None], message: str, status: int, tmp_path: Path
) -> None:
    capture, out, fresh = record(tmp_path / "A", frames=3), tmp_path / "out", tmp_path / "fresh"
    assert _resolve(capture.folder, "-o", out).status == 0
    fault(capture, out)
    done = _resolve(capture.folder, "-o", out, "--resume", "--json")
    assert (done.status, _skipped(done)) == (status, 2)
    assert message in done.err
    assert _resolve(capture.folder, "-o", fresh).status == status
    require_same_run(out, fresh)


def test_maps_stay_while_their_frame_cannot_be_read(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=3), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    before = {name: (out / name).read_bytes() for name in ("frame_1.tif", "frames.jsonl")}
    # as on a disk or share that fails for a while: nothing is known about the content of the frame
    frame, elsewhere = capture.files[1], tmp_path / "elsewhere"
    frame.rename(elsewhere)
    frame.symlink_to(frame.name)
    done = _resolve(capture.folder, "-o", out, "--resume", "--json")
    assert (done.status, _skipped(done)) == (1, 2)
    assert f"failed: {frame}: cannot be read: Too many levels of symbolic links" in done.err
    assert f"{out / 'frame_1.tif'}: kept, because its recorded frame may be as it was" in done.err
    assert {name: (out / name).read_bytes() for name in before} == before
    elsewhere.replace(frame)
    done = _resolve(capture.folder, "-o", out, "--resume", "--json")
    assert (done.status, _skipped(done)) == (0, 3)
    assert (out / "frame_1.tif").read_bytes() == before["frame_1.tif"]


def test_a_frame_that_was_only_touched_is_kept(tmp_path: Path) -> None:
    capture, out, fresh = record(tmp_path / "A", frames=3), tmp_path / "out", tmp_path / "fresh"
    assert _resolve(capture.folder, "-o", out).status == 0
    capture.files[1].touch()
    done = _resolve(capture.folder, "-o", out, "--resume", "--json")
    assert (done.status, _skipped(done)) == (0, 3)
    assert _resolve(capture.folder, "-o", fresh).status == 0
    require_same_run(out, fresh)


def test_only_frames_that_were_touched_are_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To resume a run of thousands of frames must not take the time of reading them all."""
    capture, out = record(tmp_path / "A", frames=3), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    read: list[str] = []
    read_frame = FrameReader.read

    def counted(reader: FrameReader, sources: Sequence[FrameSource], /) -> Recording:
        read.append(sources[0].name)
        return read_frame(reader, sources)

    monkeypatch.setattr(FrameReader, "read", counted)
    assert _skipped(_resolve(capture.folder, "-o", out, "--resume", "--json")) == 3
    assert read == []
    capture.files[1].touch()
    assert _skipped(_resolve(capture.folder, "-o", out, "--resume", "--json")) == 3
    assert read == ["frame_1"]


def test_a_frame_that_changed_within_the_same_second_is_resolved_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """sshfs and exFAT cut the times of files to whole seconds: a frame that is replaced may keep its size and times."""
    capture, out, exact, cut_ns = record(tmp_path / "A", frames=2), tmp_path / "out", Path.stat, 10**18

    def cut(path: Path, **more: bool) -> os.stat_result | SimpleNamespace:
        found = exact(path, **more)
        times = {"st_mtime_ns": cut_ns, "st_ctime_ns": cut_ns}
        names = [name for name in dir(found) if name.startswith("st_")]
        return SimpleNamespace(**{n: getattr(found, n) for n in names} | times) if path in capture.files else found

    monkeypatch.setattr(Path, "stat", cut)
    assert _resolve(capture.folder, "-o", out).status == 0
    for place in out.glob("*.tif"):
        os.utime(place, ns=(cut_ns, cut_ns + 9 * 10**8))
    pixels = capture.files[0].read_bytes()
    assert len(pixels) == capture.files[1].stat().st_size
    capture.files[1].write_bytes(pixels)
    done = _resolve(capture.folder, "-o", out, "--resume", "--json")
    assert (done.status, _skipped(done)) == (0, 1)
    assert "its recorded frame has changed since; made again" in done.err


def test_maps_whose_lines_are_lost_are_made_again(tmp_path: Path) -> None:
    capture, out, fresh = record(tmp_path / "A", frames=5), tmp_path / "out", tmp_path / "fresh"
    assert _resolve(capture.folder, "-o", fresh).status == 0
    assert _resolve(capture.folder, "-o", out).status == 0
    (out / "frames.jsonl").unlink()
    done = _resolve(capture.folder, "-o", out, "--resume")
    assert done.status == 0
    # three maps are named, the other two are counted
    why = "has no line in frames.jsonl, probably because a run was stopped; made again"
    assert done.err.splitlines()[:-1] == [
        *(f"{out}/frame_{index}.tif: {why}" for index in range(3)),
        f"{out}: 2 more maps: {why}",
    ]
    require_same_run(out, fresh)


def test_the_record_of_a_resumed_run_is_that_of_one_run(tmp_path: Path) -> None:
    capture, out, fresh = record(tmp_path / "A", frames=5), tmp_path / "out", tmp_path / "fresh"
    content = capture.files[0].read_bytes()
    capture.files[0].write_bytes(content[:-50])
    assert _resolve(capture.folder, "-o", out, "--average", 2).status == 0
    capture.files[0].write_bytes(content)
    (out / "frame_2.tif").unlink()
    done = _resolve(capture.folder, "-o", out, "--average", 2, "--resume", "--json")
    assert [json.loads(line)["status"] for line in done.out.splitlines()] == ["ok", "ok", "skipped"]
    assert _resolve(capture.folder, "-o", fresh, "--average", 2).status == 0
    require_same_run(out, fresh)
    assert run_of(out)["totals"]["frames"] == 3


def test_maps_keep_their_lines_if_their_frames_do_not_come_again(tmp_path: Path) -> None:
    """A run that follows a camera is started again, and gets only the paths of new frames."""
    capture, out = record(tmp_path / "capture", frames=4), tmp_path / "out"
    paths = sorted(map(str, capture.folder.glob("*.tif")))
    words = ("resolve", "-", "-o", out, "-j", 1)
    assert program(*words, stdin="\n".join(paths[:2])).status == 0
    before = (out / "frames.jsonl").read_text()
    assert program(*words, "--resume", stdin="\n".join(paths[2:])).status == 0
    lines = (out / "frames.jsonl").read_text()
    assert lines.startswith(before)
    assert [Path(json.loads(line)["source"]).name for line in lines.splitlines()] == [
        f"frame_{i}.tif" for i in range(4)
    ]
    assert json.loads((out / "run.json").read_text())["totals"]["ok"] == 4
    # the maps of a frame that is gone keep their line, too; a map that is gone has none
    Path(paths[0]).unlink()
    (out / "frame_3.tif").unlink()
    assert program(*words, "--resume", stdin=paths[2]).status == 0
    lines = (out / "frames.jsonl").read_text()
    assert [Path(json.loads(line)["source"]).name for line in lines.splitlines()] == [
        f"frame_{i}.tif" for i in range(3)
    ]


@pytest.mark.parametrize("arriving", [False, True])
@pytest.mark.parametrize("change", ["added", "first removed", "removed"])
def test_means_of_other_frames_replace_those_of_the_earlier_run(tmp_path: Path, change: str, arriving: bool) -> None:
    """With another first frame, all means are of other frames; the earlier ones would count each frame twice."""
    capture, out, fresh = record(tmp_path / "A", frames=7), tmp_path / "out", tmp_path / "fresh"

    def resolve(folder: Path, *more: str) -> Finished:
        if not arriving:
            return _resolve(capture.folder, "-o", folder, "--average", 2, *more)
        paths = "\n".join(sorted(map(str, capture.folder.glob("*.tif"))))
        return program("resolve", "-", "-o", folder, "--average", 2, "-j", 1, *more, stdin=paths)

    assert resolve(out).status == 0
    if change == "added":
        shutil.copy(record(tmp_path / "B", seed=9).files[0], capture.folder / "a_frame.tif")
    else:
        capture.files[0 if change == "first removed" else 3].unlink()
    done = resolve(out, "--resume")
    assert (done.status, "because other maps show their recorded frames now" in done.err) == (0, True)
    assert resolve(fresh).status == 0
    assert (maps_of(out), lines_of(out)) == (maps_of(fresh), lines_of(fresh))
    assert run_of(out)["totals"] == run_of(fresh)["totals"]
    if not arriving:
        require_same_run(out, fresh)


def test_a_run_that_resolved_nothing_is_resumed(tmp_path: Path) -> None:
    """Its `frames.jsonl` is empty, and stays so until there is a frame."""
    capture, out = record(tmp_path / "A", frames=1), tmp_path / "out"
    for resume in ([], ["--resume"]):
        done = _resolve(capture.folder, "-o", out, "--frames", "1:", *resume)
        told = "no frame was resolved: no capture has a frame in the range of --frames\n"
        assert (done.status, done.err, lines_of(out), run_of(out)["finished"]) == (1, told, [], True)
    write_frame(capture.folder / "frame_1.tif", step_frame(np.random.default_rng(1)))
    assert _resolve(capture.folder, "-o", out, "--frames", "1:", "--resume").status == 0
    assert len(lines_of(out)) == 1


@pytest.mark.parametrize("last", [b"{}\n", b'{"source": "fr'])
def test_a_moved_run_whose_last_line_is_no_report(last: bytes, tmp_path: Path) -> None:
    """A line that was cut off is left out; any other is refused, and then nothing has been changed."""
    capture, out, moved = record(tmp_path / "A"), tmp_path / "out", tmp_path / "moved"
    assert _resolve(capture.folder, "-o", out).status == 0
    out.rename(moved)
    for whole in ((moved / "frames.jsonl").read_bytes(), b""):
        (moved / "frames.jsonl").write_bytes(whole + last)
        done = _resolve(capture.folder, "-o", moved, "--resume")
        if last.endswith(b"\n"):
            assert (done.status, (moved / "frames.jsonl").read_bytes()) == (2, whole + last)
        else:
            assert (done.status, len(lines_of(moved))) == (0, 1)


def test_a_folder_in_the_place_of_a_map_is_not_said_to_be_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture, out = record(tmp_path / "A", frames=2), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    (out / "frame_0.tif").unlink()
    (out / "frame_0.tif").mkdir()
    monkeypatch.chdir(tmp_path)
    done = _resolve("A", "-o", out, "--resume")
    assert (done.status, "failed: " in done.err, "removed" in done.err) == (1, True, False)


def test_a_folder_that_was_moved_and_copied_is_the_same_run(tmp_path: Path) -> None:
    capture, out, other = record(tmp_path / "A", frames=3), tmp_path / "out", tmp_path / "other"
    assert _resolve(capture.folder, "-o", out).status == 0
    shutil.copytree(out, other)
    done = _resolve(capture.folder, "-o", other, "--resume", "--json")
    assert (done.status, _skipped(done)) == (0, 3)
    require_same_run(other, out)


def test_what_is_recorded_of_a_frame(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A", frames=2), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    lines = lines_of(out)
    for line, file in zip(lines, capture.files, strict=True):
        now = file.stat()
        assert line["files"] == [{"name": file.name, "bytes": now.st_size, "mtime_ns": now.st_mtime_ns}]
        assert line["output_bytes"] == (out / file.name).stat().st_size
    assert len({line["digest"] for line in lines} | {line["output_digest"] for line in lines}) == 4
    assert run_of(out)["captures"][0]["resolved_root"] == str(capture.folder.resolve())


def test_links_are_replaced_not_written_through(tmp_path: Path) -> None:
    capture, out, mine = record(tmp_path / "A", frames=2), tmp_path / "out", tmp_path / "mine"
    mine.write_text("mine")
    out.mkdir()
    for name in ("run.json", "frames.jsonl", "frame_0.tif"):
        (out / name).symlink_to(mine)
    assert _resolve(capture.folder, "-o", out, "--overwrite").status == 0
    assert mine.read_text() == "mine"
    assert not any(path.is_symlink() for path in out.iterdir())
    (out / "frames.jsonl").rename(tmp_path / "lines")
    (out / "frames.jsonl").symlink_to(tmp_path / "lines")
    done = _resolve(capture.folder, "-o", out, "--resume")
    assert done.status == 2
    assert f"{out / 'frames.jsonl'}: cannot be written: Too many levels of symbolic links" in done.err


@pytest.mark.parametrize("name", ["run.json", "frames.jsonl"])
def test_a_pipe_in_place_of_a_record_is_refused(name: str, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    (out / name).unlink()
    os.mkfifo(out / name)
    assert _resolve(capture.folder, "-o", out, "--resume").status == 2


def test_stacks_do_not_take_the_names_of_others(tmp_path: Path) -> None:
    frames = [step_frame(np.random.default_rng(index)) for index in range(2)]
    stack, single, out = tmp_path / "A" / "st.tif", tmp_path / "A" / "st_0000.tif", tmp_path / "out"
    record(tmp_path / "A", frames=0, toml=TOML["tif"] + "[layout]\nframes = 2\n")
    write_pages(stack, np.concatenate([counts_of(frame) for frame in frames]))
    write_pages(single, np.concatenate([counts_of(frame) for frame in frames]))
    other = record(tmp_path / "B")
    for inputs in ((stack, other.folder, single), (single, other.folder, stack)):
        assert _resolve(*inputs, "-o", out, "--overwrite").status == 0
        names = ["st_00000.tif", "st_00001.tif", "st_0000_0000.tif", "st_0000_0001.tif"]
        assert sorted(path.name for path in (out / "A").iterdir()) == names
        assert len(lines_of(out)) == 5
        shutil.rmtree(out)


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_names_as_long_as_they_can_be(form: str, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    for name in ("x" * 251 + ".tif", "ä" * 125 + ".tif"):
        capture.files[0].rename(capture.folder / name)
        done = _resolve(capture.folder / name, "-o", out, "--format", form)
        assert (done.status, "failed" in done.err) == (0, False)
        (capture.folder / name).rename(capture.files[0])
        shutil.rmtree(out)


def test_exr_files_in_folders_whose_names_are_no_utf_8(tmp_path: Path) -> None:
    """The library takes no such paths: frames were called damaged, and maps could not be written."""
    folder = tmp_path / os.fsdecode(b"lat\xe4")
    capture, plain, out = record(tmp_path / "A", form="exr"), tmp_path / "plain", folder / "out"
    shutil.copytree(capture.folder, folder / "A")
    for source, maps in ((capture.folder, plain), (folder / "A", out)):
        done = _resolve(source, "-o", maps)
        assert (done.status, "failed" in done.err) == (0, False)
    assert maps_of(out) == maps_of(plain)
    assert cadtof("evaluate", out, "--truth", plain / "frame_0.exr").status == 0
    (out / "frame_0.exr").write_bytes((plain / "frame_0.exr").read_bytes()[:3000])
    done = cadtof("evaluate", out, "--truth", plain / "frame_0.exr")
    assert "frame_0.exr: damaged EXR: " in done.err
    assert "python_buffer" not in done.err


def test_names_that_are_no_utf_8(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    name = os.fsdecode(b"frame_\xff\xfe.tif")
    capture.files[0].rename(capture.folder / name)
    done = _resolve(capture.folder, "-o", out, "--json")
    assert (done.status, json.loads(done.out)["source"]) == (0, str(capture.folder / name))
    assert (out / name).exists()
    for arguments in (("info", capture.folder), ("info", out), ("preview", out / name, "-o", tmp_path / "a.png")):
        done = cadtof(*arguments)
        assert done.status == 0
        assert "unexpected" not in done.err
    assert _resolve(capture.folder, "-o", out, "--resume").status == 0


def test_errors_of_maps_whose_names_are_no_utf_8_are_written(tmp_path: Path) -> None:
    """Such a name ended `evaluate --csv` with an unexpected error."""
    capture, table = record(tmp_path / "A"), tmp_path / "errors.csv"
    capture.files[0].rename(capture.folder / os.fsdecode(b"frame_\xff.tif"))
    assert _resolve(capture.folder, "-o", tmp_path / "out").status == 0
    truth = tmp_path / "truth.exr"
    write_layers(truth, {"direct.depth": layers_of(next((tmp_path / "out").glob("*.tif")))["direct.depth"]})
    assert cadtof("evaluate", tmp_path / "out", "--truth", truth, "--csv", table).status == 0
    assert r"frame_\udcff," in table.read_text()


def test_records_with_numbers_that_are_too_large_for_arithmetic(tmp_path: Path) -> None:
    """They ended `report`, `info` and `resolve --resume` with an unexpected OverflowError."""
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    line, run = json.loads((out / "frames.jsonl").read_text()), json.loads((out / "run.json").read_text())
    huge = 10**400
    (out / "frames.jsonl").write_text(json.dumps({**line, "seconds": huge}) + "\n")
    assert cadtof("report", out, "-o", tmp_path / "a.html").status == 0
    (out / "frames.jsonl").write_text(json.dumps(line) + "\n")
    for spoiled in (
        {**run, "totals": {**run["totals"], "seconds": huge}},
        {**run, "arguments": {**run["arguments"], "out": {}}},
        {**run, "arguments": {**run["arguments"], "frames": [0, huge]}},
    ):
        (out / "run.json").write_text(json.dumps(spoiled))
        for arguments in (("info", out), ("report", out, "-o", tmp_path / "a.html", "--overwrite")):
            assert "unexpected" not in cadtof(*arguments).err
        assert "unexpected" not in _resolve(capture.folder, "-o", out, "--resume").err


@pytest.mark.parametrize("frames", [[1], [0, 1, 1], 5, ["a", "b"]])
def test_a_range_of_frames_that_is_none_is_not_resumed(frames: object, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    run = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps({**run, "arguments": {**run["arguments"], "frames": frames}}))
    again = _resolve(capture.folder, "-o", out, "--resume")
    assert again.status == 2
    assert "not the record of a run, so it cannot be resumed" in again.err


def test_records_that_say_nonsense(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    readers = (
        ("evaluate", out, "--truth", out / "frame_0.tif"),
        ("info", out),
        ("preview", out, "-o", tmp_path / "a.png"),
    )
    sound = json.loads((out / "run.json").read_text())
    for key, value in (("inputs", 5), ("absolute_inputs", 5), ("overrides", 5), ("depth", []), ("inputs", [None])):
        nonsense = {**sound["arguments"], key: value}
        if key == "inputs":
            del nonsense["absolute_inputs"]
        (out / "run.json").write_text(json.dumps({**sound, "arguments": nonsense}))
        for arguments in readers:
            assert "unexpected" not in cadtof(*arguments).err
    for content in ('{"arguments": 5}', "[]", "5", '{"arguments": {}}', '{"arguments": null, "captures": 3}'):
        (out / "run.json").write_text(content)
        for arguments in readers:
            assert "unexpected" not in cadtof(*arguments).err
        done = _resolve(capture.folder, "-o", out, "--resume")
        assert done.status == 2
        assert "not the record of a run" in done.err


@pytest.mark.parametrize("output", ["", ".", "/"])
def test_lines_that_name_no_file_are_no_record_of_a_run(output: str, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out).status == 0
    line = json.loads((out / "frames.jsonl").read_text())
    (out / "frames.jsonl").write_text(json.dumps({**line, "output": output}) + "\n")
    assert cadtof("report", out, "-o", tmp_path / "page.html").err == ""
    assert "not the record of a run" in _resolve(capture.folder, "-o", out, "--resume").err


def test_folders_that_cannot_be_searched_are_reported(tmp_path: Path) -> None:
    capture = record(tmp_path / "A")
    closed = tmp_path / "closed"
    closed.mkdir()
    (closed / "deep").mkdir()
    closed.chmod(0o000)
    try:
        for arguments in (
            ("resolve", capture.folder, "-o", closed / "out"),
            ("resolve", capture.folder, "-o", closed),
            ("resolve", closed, "-o", tmp_path / "out"),
            ("resolve", closed / "deep", "-o", tmp_path / "out"),
            ("info", closed),
            ("info", closed / "deep"),
            ("preview", closed / "deep", "-o", tmp_path / "a.png"),
            ("preview", "/dev/null", "-o", tmp_path / "a.png"),
            ("evaluate", closed / "deep", "--truth", closed / "truth.exr"),
        ):
            done = without_privilege(*arguments)
            assert done.status in {1, 2}
            assert "Error: " in done.err
            assert "unexpected" not in done.err
            assert "Traceback" not in done.err
    finally:
        closed.chmod(0o755)


def test_a_name_with_nul_on_stdin(tmp_path: Path) -> None:
    capture = record(tmp_path / "A")
    done = program("resolve", "-", "-o", tmp_path / "out", stdin=f"{capture.files[0]}\0x\n")
    assert done.status == 2
    assert done.err.startswith(f"Error: {capture.files[0]}: this is not a possible file name (")
    assert done.err.endswith("need `resolve -0`\n")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("principal_point_px", [1.0]),
        ("principal_point_px", [1, 2, 3]),
        ("principal_point_px", "16,12"),
        ("principal_point_px", [float("inf"), 0]),
        ("focal_length_px", [28]),
        ("focal_length_px", -28),
    ],
)
def test_optics_that_no_camera_has_are_unknown(key: str, value: object, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "A"), tmp_path / "out"
    assert _resolve(capture.folder, "-o", out, "--focal-length", 28).status == 0
    run = json.loads((out / "run.json").read_text())
    run["captures"][0]["metadata"]["optics"][key] = value
    (out / "run.json").write_text(json.dumps(run))
    done = cadtof("export", out, "-o", tmp_path / "out.ply")
    assert (done.status, "its optics are unknown" in done.err) == (2, True)
    assert cadtof("export", out, "-o", tmp_path / "out.ply", "--focal-length", 28).status == 0
