"""Frames whose paths arrive on stdin while a camera records: some are gone again, some are named twice, and the program that
watches the camera is started again."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.workflows.resolve.output import LOCK_FILE
from tests.support.captures import layers_of, record, write_frame
from tests.support.forward import step_frame
from tests.support.runs import lines_of, require_same_run, run_of
from tests.support.shell import shell

WATCH = "cadtof resolve - -o live -j 1 --json"


def _until(file: str) -> str:
    """Commands of a shell that wait for a file with something in it, so that what follows arrives during the run."""
    return f"for i in $(seq 300); do [ -s {file} ] && break; sleep 0.1; done;"


UNTIL_RECORDED = _until("live/frames.jsonl")


def _sources(text: str) -> list[tuple[str, str]]:
    return [(line["source"], line["status"]) for line in map(json.loads, text.splitlines())]


@pytest.mark.parametrize("before", ["", "echo cam/frame_0.tif; " + UNTIL_RECORDED])
def test_a_frame_that_is_gone_takes_no_other_frame_with_it(before: str, tmp_path: Path) -> None:
    """The three paths come together, at the beginning of the run or later. Only the frame that is gone fails."""
    record(tmp_path / "cam", frames=3)
    done = shell(f"{{ {before} printf 'cam/frame_1.tif\\ncam/gone.tif\\ncam/frame_2.tif\\n'; }} | {WATCH}", tmp_path)
    assert done.status == 1
    found = dict(_sources(done.out))
    assert found.pop("cam/gone.tif") == "failed"
    assert "cam/gone.tif: no such file or folder" in done.err
    assert set(found.values()) == {"ok"}
    assert {"cam/frame_1.tif", "cam/frame_2.tif"} <= found.keys()


def test_only_frames_that_are_gone(tmp_path: Path) -> None:
    done = shell(f"echo cam/gone.tif | {WATCH}", tmp_path)
    assert done.status == 2
    assert "cam/gone.tif: no such file or folder" in done.err
    record(tmp_path / "cam")
    done = shell(f"printf 'cam/frame_0.tif\\ncam/gone.tif\\n' | {WATCH} --dry-run", tmp_path)
    assert (done.status, sorted(_sources(done.out))) == (1, [("cam/frame_0.tif", "ok"), ("cam/gone.tif", "failed")])


def test_a_frame_that_is_gone_before_any_other_arrives_fails_alone(tmp_path: Path) -> None:
    record(tmp_path / "cam")
    done = shell(f"{{ echo cam/gone.tif; sleep 2; echo cam/frame_0.tif; }} | {WATCH}", tmp_path)
    assert done.status == 1
    assert "failed: cam/gone.tif: no such file or folder" in done.err
    assert (tmp_path / "live" / "frame_0.tif").is_file()


def test_a_dry_run_lists_the_paths_that_arrive_late(tmp_path: Path) -> None:
    record(tmp_path / "cam", frames=2)
    done = shell(f"{{ echo cam/frame_0.tif; sleep 2; echo cam/frame_1.tif; }} | {WATCH} --dry-run", tmp_path)
    assert (done.status, _sources(done.out)) == (0, [("cam/frame_0.tif", "ok"), ("cam/frame_1.tif", "ok")])


def test_a_frame_that_would_replace_another_takes_no_other_frame_with_it(tmp_path: Path) -> None:
    capture = record(tmp_path / "cam", frames=3)
    (tmp_path / "cam" / "frame_0.tiff").write_bytes(capture.files[1].read_bytes())
    later = f"printf '%s\\n' cam/frame_0.tiff cam/frame_2.tif '{capture.files[0]}'"
    done = shell(f"{{ echo cam/frame_0.tif; {UNTIL_RECORDED} {later}; }} | {WATCH}", tmp_path)
    assert done.status == 1
    assert "cam/frame_0.tiff would be written as live/frame_0, as" in done.err
    assert sorted(_sources(done.out))[-4:] == [
        (str(capture.files[0]), "ok"),
        ("cam/frame_0.tif", "ok"),
        ("cam/frame_0.tiff", "failed"),
        ("cam/frame_2.tif", "ok"),
    ]


def test_names_that_differ_only_in_case_share_no_map(tmp_path: Path) -> None:
    """As on exFAT and NTFS, where capital and small letters are the same: there the second map would replace the first."""
    capture = record(tmp_path / "cam", frames=2)
    capture.files[0].rename(tmp_path / "cam" / "a.tif")
    capture.files[1].rename(tmp_path / "cam" / "A.tif")
    # the lock is found under both names there
    (tmp_path / "live").mkdir()
    (tmp_path / "live" / LOCK_FILE.upper()).touch()
    done = shell("cadtof resolve cam -o live -j 1", tmp_path)
    assert done.status == 2
    assert "cam/A.tif and cam/a.tif would both be written as live/a, because capital and small letters" in done.err
    done = shell(f"{{ echo cam/a.tif; {UNTIL_RECORDED} echo cam/A.tif; }} | {WATCH}", tmp_path)
    assert done.status == 1
    assert "cam/A.tif would be written as live/A, as cam/a.tif was" in done.err
    assert [path.name for path in (tmp_path / "live").glob("*.tif")] == ["a.tif"]
    # elsewhere, the two names are those of two files
    assert shell("cadtof resolve cam -o other -j 1", tmp_path).status == 0
    assert sorted(path.name for path in (tmp_path / "other").glob("*.tif")) == ["A.tif", "a.tif"]


def test_names_in_other_case_share_no_map_if_they_arrive_together_or_are_of_a_stack(tmp_path: Path) -> None:
    capture = record(tmp_path / "cam", frames=4)
    for file, name in zip(capture.files, ("first", "a", "A", "S_0000"), strict=True):
        file.rename(tmp_path / "cam" / f"{name}.tif")
    pages = np.stack([tifffile.imread(tmp_path / "cam" / f"{name}.tif") for name in "aA"])
    tifffile.imwrite(tmp_path / "cam" / "s.tif", pages.reshape(2, 2, 2, *pages.shape[-2:]), metadata={"axes": "THCYX"})
    (tmp_path / "live").mkdir()
    (tmp_path / "live" / LOCK_FILE.upper()).touch()
    later = "printf 'cam/a.tif\\ncam/A.tif\\ncam/S_0000.tif\\ncam/s.tif\\n'"
    done = shell(f"{{ echo cam/first.tif; {UNTIL_RECORDED} {later}; }} | {WATCH}", tmp_path)
    assert done.status == 1
    assert "cam/A.tif would be written as live/A, as cam/a.tif was" in done.err
    names = [path.stem for path in (tmp_path / "live").glob("*.tif")]
    assert sorted(names) == ["S_0000", "a", "first", "s_00000", "s_00001"]
    # the record of the run tells which frames they show
    done = shell("cadtof evaluate live --truth live/first.tif --json", tmp_path)
    assert (done.status, "recorded frame" in done.err) == (0, False)
    assert json.loads(done.out)["first_phasor"] is not None
    assert "inspect the recorded frame: " in (
        told := shell("cadtof inspect live/s_00001.tif --pixel 3,3", tmp_path).err
    )
    assert told.endswith("cam/s.tif --frame 1\n")


def test_a_watcher_that_is_started_again_keeps_what_is_recorded(tmp_path: Path) -> None:
    """After a restart, only new frames are named. The record is then that of a run without a restart."""
    record(tmp_path / "cam", frames=4)
    first = "cam/frame_0.tif\\ncam/gone.tif\\ncam/frame_1.tif\\n"
    assert shell(f"printf '{first}' | {WATCH}", tmp_path).status == 1
    done = shell(
        f"{{ echo cam/frame_2.tif; {_until('live/frame_2.tif')} echo cam/frame_3.tif; }} | {WATCH} --resume", tmp_path
    )
    assert done.status == 0, done.err
    undisturbed = WATCH.replace("live", "fresh")
    assert shell(f"printf '{first}cam/frame_2.tif\\ncam/frame_3.tif\\n' | {undisturbed}", tmp_path).status == 1
    require_same_run(tmp_path / "live", tmp_path / "fresh")
    assert run_of(tmp_path / "live")["totals"]["frames"] == 5
    assert run_of(tmp_path / "live")["captures"][0]["files"] == 4


def test_a_watcher_that_is_started_elsewhere_keeps_what_is_recorded(tmp_path: Path) -> None:
    record(tmp_path / "cam", frames=3)
    assert shell(f"printf 'cam/frame_0.tif\\ncam/frame_1.tif\\n' | {WATCH}", tmp_path).status == 0
    again = "cadtof resolve - -o ../live -j 1 --resume"
    done = shell(f"printf 'frame_2.tif\\nframe_1.tif\\n' | {again}", tmp_path / "cam")
    assert done.status == 0, done.err
    assert [line["output"] for line in lines_of(tmp_path / "live")] == ["frame_0.tif", "frame_1.tif", "frame_2.tif"]
    assert {Path(line["source"]).name for line in lines_of(tmp_path / "live")} == {f"frame_{n}.tif" for n in range(3)}
    run = run_of(tmp_path / "live")
    assert run["arguments"]["inputs"][:2] == [str(tmp_path / "cam" / f"frame_{index}.tif") for index in (0, 1)]
    assert run["totals"]["ok"] == 3
    done = shell("cadtof export live -o points.ply; cadtof evaluate live --truth live/frame_0.tif --json", tmp_path)
    assert done.status == 0, done.err
    assert len(list(tmp_path.glob("points_*.ply"))) == 3


def test_a_frame_that_is_named_again_has_one_line(tmp_path: Path) -> None:
    """The camera is still writing a frame when it is named first. Then it is whole, and is named again."""
    capture = record(tmp_path / "cam", frames=3)
    whole = capture.files[1].read_bytes()
    capture.files[1].write_bytes(whole[:-50])
    (tmp_path / "whole.tif").write_bytes(whole)
    script = f"cat cam.txt; {UNTIL_RECORDED} cp whole.tif cam/frame_1.tif; echo cam/frame_1.tif; echo cam/frame_2.tif"
    (tmp_path / "cam.txt").write_text("cam/frame_0.tif\ncam/frame_1.tif\n")
    done = shell(f"{{ {script}; }} | {WATCH}", tmp_path)
    assert done.status == 1
    assert ("cam/frame_1.tif", "failed") in _sources(done.out)
    names = [f"cam/frame_{index}.tif" for index in range(3)]
    assert [(line["source"], line["status"]) for line in lines_of(tmp_path / "live")] == [
        (name, "ok") for name in names
    ]
    run = run_of(tmp_path / "live")
    assert run["arguments"]["inputs"] == names
    assert (run["totals"]["frames"], run["totals"]["ok"], run["totals"]["failed"]) == (3, 3, 0)


def test_a_watcher_that_is_started_again_writes_into_the_same_folders(tmp_path: Path) -> None:
    """Two cameras write frames of the same names. Which of them comes first decides the folders only once."""
    rng = np.random.default_rng(4)
    for place in ("left", "right"):
        record(tmp_path / "cam" / place)
    write_frame(tmp_path / "cam" / "right" / "frame_0.tif", step_frame(rng))
    assert shell(f"echo cam/left/frame_0.tif | {WATCH}", tmp_path).status == 0
    kept = (tmp_path / "live" / "frame_0.tif").read_bytes()
    done = shell(
        f"{{ echo cam/right/frame_0.tif; sleep 1.2; echo cam/left/frame_0.tif; }} | {WATCH} --resume", tmp_path
    )
    assert done.status == 0, done.err
    assert (tmp_path / "live" / "frame_0.tif").read_bytes() == kept
    assert shell("cadtof resolve cam/right -o right -j 1", tmp_path).status == 0
    for name, layer in layers_of(tmp_path / "right" / "frame_0.tif").items():
        np.testing.assert_array_equal(layer, layers_of(tmp_path / "live" / "right" / "frame_0.tif")[name])
    assert [line["status"] for line in lines_of(tmp_path / "live")] == ["ok", "ok"]
    done = shell("cadtof evaluate live --truth live/frame_0.tif --json", tmp_path)
    assert json.loads(done.out)["first_phasor"] is not None


def test_folders_stay_the_same_wherever_a_watcher_is_started_again(tmp_path: Path) -> None:
    """Started in other folders, and stopped in between, it puts the frames of two cameras where the first run put them."""
    for index, place in enumerate(("left", "right")):
        record(tmp_path / "cam" / place, frames=3, seed=index)
    both = "printf 'cam/left/frame_0.tif\\ncam/right/frame_0.tif\\n'"
    assert shell(f"{both} | {WATCH}", tmp_path).status == 0
    again = "cadtof resolve - -o ../live -j 1 --resume"
    holder = """$(sed 's/.*"pid": \\([0-9]*\\).*/\\1/' ../live/.cadtof.lock)"""
    stopped = f"echo right/frame_1.tif; {_until('../live/right/frame_1.tif')} kill -INT {holder}; sleep 1"
    assert shell(f"{{ {stopped}; }} | {again}", tmp_path / "cam").status == 130
    done = shell(f"printf 'frame_2.tif\\n' | {again.replace('..', '../..')}", tmp_path / "cam" / "left")
    assert done.status == 0, done.err
    maps = {path.relative_to(tmp_path / "live").as_posix() for path in (tmp_path / "live").rglob("*.tif")}
    assert maps == {f"{place}.tif" for place in ("left/frame_0", "left/frame_2", "right/frame_0", "right/frame_1")}
    lines = [json.loads(line) for line in (tmp_path / "live" / "frames.jsonl").read_text().splitlines()]
    assert {line["output"] for line in lines} == {f"../../live/{name}" for name in maps}
    done = shell("cadtof report live -o page.html; cadtof export live -o points.ply", tmp_path)
    assert (done.status, len(done.out.splitlines())) == (0, 5), done.err


def test_a_record_that_does_not_say_which_tree_its_run_mirrors(tmp_path: Path) -> None:
    """As of a version under development: the inputs of the second run say it."""
    for index, place in enumerate(("left", "right")):
        record(tmp_path / "cam" / place, seed=index)
    both = "printf 'cam/left/frame_0.tif\\ncam/right/frame_0.tif\\n'"
    assert shell(f"{both} | {WATCH}", tmp_path).status == 0
    record_file = tmp_path / "live" / "run.json"
    run = json.loads(record_file.read_text())
    del run["shared_folder"]
    record_file.write_text(json.dumps(run))
    done = shell(f"{both} | {WATCH} --resume", tmp_path)
    assert done.status == 0, done.err
    assert sorted(path.parent.name for path in (tmp_path / "live").rglob("*.tif")) == ["left", "right"]
    assert json.loads(record_file.read_text())["shared_folder"] == str(tmp_path / "cam")


def test_frames_that_wait_for_their_mean_keep_their_order_and_names(tmp_path: Path) -> None:
    """Frames 9 and 10 wait for frame 11. Their mean is named after frame 9, as in a run that knows all three at once."""
    rng = np.random.default_rng(5)
    record(tmp_path / "cam")
    for index in (7, 8, 9, 10, 11, 12):
        write_frame(tmp_path / "cam" / f"frame_{index}.tif", step_frame(rng))
    first = f"for i in 0 7 8 9 10; do echo cam/frame_$i.tif; done; {UNTIL_RECORDED}"
    done = shell(f"{{ {first} echo cam/frame_11.tif; echo cam/frame_12.tif; }} | {WATCH} --average 3", tmp_path)
    assert done.status == 0, done.err
    assert _sources(done.out) == [(f"cam/frame_{index}.tif", "ok") for index in (0, 9, 12)]


def test_a_record_without_inputs_is_not_continued(tmp_path: Path) -> None:
    record(tmp_path / "cam", frames=2)
    assert shell(f"echo cam/frame_0.tif | {WATCH}", tmp_path).status == 0
    path = tmp_path / "live" / "run.json"
    document = json.loads(path.read_text())
    del document["arguments"]["resolved_inputs"]
    path.write_text(json.dumps(document))
    done = shell(f"echo cam/frame_1.tif | {WATCH} --resume", tmp_path)
    assert done.status == 2
    assert "run.json: not the record of a run, so it cannot be resumed" in done.err
