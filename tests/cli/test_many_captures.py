"""Several captures in one run, however a shell names them: there is one record, and OUT mirrors their folders."""

import csv
import json
import os
import re
import select
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.files.layers import write_layers
from tests.support.captures import TOML, counts_of, layers_of, record, write_frame
from tests.support.forward import step_frame
from tests.support.needed import needed_program
from tests.support.run_cadtof import ENVIRONMENT, PROGRAM, cadtof, without_privilege
from tests.support.runs import require_same_run
from tests.support.shell import shell


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """rec/a, rec/b/one and rec/b/two with a frame of the same name each; a folder without frames; a hidden capture."""
    for index, place in enumerate(("a", "b/one", "b/two")):
        record(tmp_path / "rec" / place, seed=index)
    (tmp_path / "rec" / "notes").mkdir()
    (tmp_path / "rec" / "notes" / "readme.txt").write_text("nothing")
    record(tmp_path / "rec" / ".trash", seed=5)
    return tmp_path


MIRRORED = ["a/frame_0.tif", "b/one/frame_0.tif", "b/two/frame_0.tif"]


def _maps(out: Path) -> list[str]:
    return sorted(path.relative_to(out).as_posix() for path in out.rglob("*.tif"))


def test_a_stack_that_cannot_be_counted_fails_the_capture_of_chosen_frames(tmp_path: Path) -> None:
    """Counted as one frame, a damaged stack of three would shift the frames of `--frames` by two."""
    rng = np.random.default_rng(0)
    for name in "ab":
        folder = record(tmp_path / "rec" / name, frames=0).folder
        for stack in range(3):
            np.save(folder / f"r_{stack}.npy", np.stack([counts_of(step_frame(rng)) for _ in range(3)]))
    damaged = tmp_path / "rec" / "a" / "r_1.npy"
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[:-100])
    command = "cadtof resolve --recursive rec -o out -j 1 --frames 6:8"
    done = shell(command, tmp_path)
    assert done.status == 1
    assert "failed: --frames: the frames of this stack cannot be counted: rec/a/r_1.npy: damaged NPY: " in done.err
    of_b = ["b/r_2_0000.tif", "b/r_2_0001.tif"]
    assert _maps(tmp_path / "out") == of_b
    damaged.write_bytes(whole)
    assert shell(f"{command} --resume", tmp_path).status == 0
    assert _maps(tmp_path / "out") == ["a/r_2_0000.tif", "a/r_2_0001.tif", *of_b]


def test_a_capture_that_is_resolved_again_into_a_folder_of_the_run_is_not_left_out_in_silence(tree: Path) -> None:
    """The run in b/two replaced maps of the run of all. `evaluate out` then counted two frames of three, and said nothing."""
    every = "cadtof resolve --recursive rec -o out -j 1 -q"
    assert shell(every, tree).status == 0
    assert shell("cadtof resolve rec/b/two -o out/b/two -j 1 -q --overwrite --order 1", tree).status == 0
    for command in ("evaluate out --truth out/a/frame_0.tif", "report out -o page.html"):
        done = shell(f"cadtof {command}", tree)
        assert (done.status, done.out) == (2, "")
        expected = (
            "Error: out/b/two: another run replaced maps of the run in out; move it elsewhere, then use --resume\n"
        )
        assert done.err == expected
    for option in ("--resume", "--overwrite"):
        done = shell(f"{every} {option}", tree)
        assert (done.status, done.err) == (
            2,
            "Error: out/b/two: holds a run of its own; move it elsewhere, or choose another folder with -o\n",
        )
    # such folders with other maps, and of other runs, are no fault
    (tree / "out" / "b" / "two").rename(tree / "out" / "b" / "before")
    assert shell(f"{every} --resume", tree).status == 0
    done = shell("cadtof evaluate out --truth out/a/frame_0.tif --json", tree)
    assert (done.status, json.loads(done.out)["frames"]) == (0, 3)


@pytest.mark.parametrize("arriving", [False, True])
def test_no_map_is_written_through_a_link_that_leads_out_of_out(tree: Path, *, arriving: bool) -> None:
    """A folder from somebody else may hold such a link: `--overwrite` replaced files of the same names there."""
    (tree / "elsewhere").mkdir()
    (tree / "elsewhere" / "frame_0.tif").write_text("precious")
    (tree / "out").mkdir()
    (tree / "out" / "one").symlink_to("../elsewhere")
    given = (
        "{ echo rec/b/two/frame_0.tif; sleep 2; echo rec/b/one/frame_0.tif; } | cadtof resolve -"
        if arriving
        else "cadtof resolve rec/b/two rec/b/one"
    )
    done = shell(f"{given} -o out --overwrite", tree)
    assert done.status == 2
    assert f"is a link to {tree / 'elsewhere'}, and maps are written only inside out" in done.err
    assert (tree / "elsewhere" / "frame_0.tif").read_text() == "precious"
    # captures that are known when the run begins are looked at before anything is written
    assert arriving or not (tree / "out" / "two").exists()


def test_a_link_within_out_is_followed(tree: Path) -> None:
    (tree / "out" / "other").mkdir(parents=True)
    (tree / "out" / "one").symlink_to("other")
    assert shell("cadtof resolve rec/b/* -o out", tree).status == 0
    assert (tree / "out" / "other" / "frame_0.tif").is_file()


def test_recursive_mirrors_the_tree(tree: Path) -> None:
    done = shell("cadtof resolve --recursive rec -o out -j 1 --json", tree)
    assert done.status == 0, done.err
    assert _maps(tree / "out") == MIRRORED
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert [line["output"] for line in lines] == [f"out/{name}" for name in MIRRORED]
    assert (tree / "out" / "frames.jsonl").read_text() == done.out
    run = json.loads((tree / "out" / "run.json").read_text())
    assert [capture["root"] for capture in run["captures"]] == ["rec/a", "rec/b/one", "rec/b/two"]
    assert run["totals"]["ok"] == 3
    # a run on one capture alone gives the same maps
    assert shell("cadtof resolve rec/b/two -o alone -j 1", tree).status == 0
    for name, layer in layers_of(tree / "alone" / "frame_0.tif").items():
        np.testing.assert_array_equal(layer, layers_of(tree / "out" / "b/two/frame_0.tif")[name])


def test_a_folder_in_out_that_cannot_be_listed_matters_only_if_maps_of_the_run_lie_in_it(tree: Path) -> None:
    """As `lost+found`, if OUT is a disk of its own."""
    out, found = tree / "out", tree / "out" / "lost+found"
    assert cadtof("resolve", "--recursive", tree / "rec", "-o", out, "-j", 1).status == 0
    found.mkdir()
    found.chmod(0)
    (out / "b").chmod(0)
    told = f"Error: {out / 'b'}: cannot be listed: Permission denied\n"
    try:
        done = without_privilege("report", out, "-o", tree / "page.html")
        assert (done.status, done.err) == (2, told)
        (out / "b").chmod(0o755)
        assert without_privilege("report", out, "-o", tree / "page.html").status == 0
        assert without_privilege("info", out).status == 0
    finally:
        (out / "b").chmod(0o755)
        found.chmod(0o755)


def test_a_folder_that_cannot_be_listed_fails_alone(tree: Path) -> None:
    closed, out = tree / "rec" / "b", tree / "out"
    closed.chmod(0)
    told = f"{closed}: no permission to list this folder; expected one that can be read"
    try:
        done = without_privilege("resolve", "--recursive", tree / "rec", "-o", out, "-j", 1)
        assert done.status == 1
        assert f"failed: {told}\n" in done.err
        assert _maps(out) == MIRRORED[:1]
        assert [json.loads(line)["reason"] for line in (out / "frames.jsonl").read_text().splitlines()] == [told, None]
        done = without_privilege("resolve", "--recursive", tree / "rec", "-o", tree / "none", "--dry-run")
        assert (done.status, done.out.splitlines()[0]) == (1, f"{closed} → nothing, it cannot be read")
        done = without_privilege("info", "--recursive", tree / "rec", "-j", 1)
        assert (done.status, done.err) == (1, f"wrong: {told}\n")
        # the folder that was named is another matter: nothing else is there to be resolved
        done = without_privilege("resolve", "--recursive", closed, "-o", tree / "none", "-j", 1)
        assert (done.status, done.err) == (2, f"Error: {told}\n")
        # nor is it enough that other folders are there, without frames
        shutil.move(tree / "rec" / "a", tree / "a")
        done = without_privilege("resolve", "--recursive", tree / "rec", "-o", tree / "none", "-j", 1)
        assert (done.status, done.err) == (2, f"Error: {told}\n")
        shutil.move(tree / "a", tree / "rec" / "a")
    finally:
        closed.chmod(0o755)
    assert without_privilege("resolve", "--recursive", tree / "rec", "-o", out, "-j", 1, "--resume").status == 0
    assert cadtof("resolve", "--recursive", tree / "rec", "-o", tree / "fresh", "-j", 1).status == 0
    require_same_run(out, tree / "fresh")


def test_maps_of_removed_frames_keep_their_folders_in_a_run_that_was_moved(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their lines are those of the earlier run, which called the folder of the run otherwise."""
    command, moved = ("resolve", "--recursive", tree / "rec", "-j", 1, "-o"), tree / "moved"
    write_frame(tree / "rec/b/one/frame_9.tif", step_frame(np.random.default_rng(9)))
    monkeypatch.chdir(tree)
    assert cadtof(*command, "out").status == 0
    (tree / "out").rename(moved)
    (tree / "rec/b/one/frame_9.tif").unlink()
    for _ in range(2):
        assert cadtof(*command, moved, "--resume").status == 0
        lines = [json.loads(line)["output"] for line in (moved / "frames.jsonl").read_text().splitlines()]
        assert sorted(lines) == [f"{moved}/{name}" for name in sorted([*MIRRORED, "b/one/frame_9.tif"])]
    assert cadtof(*command, moved, "--overwrite").status == 0
    assert _maps(moved) == MIRRORED


def test_a_tree_that_has_grown_is_resumed(tree: Path) -> None:
    command = ("resolve", "--recursive", tree / "rec", "-j", 1, "-o")
    assert cadtof(*command, tree / "out").status == 0
    record(tree / "rec" / "a2", seed=7)
    done = cadtof(*command, tree / "out", "--resume")
    assert done.status == 0, done.err
    assert "resolved 1 of 4 frames" in done.err
    assert cadtof(*command, tree / "fresh").status == 0
    require_same_run(tree / "out", tree / "fresh")
    # a tree that has lost a capture is another one
    shutil.rmtree(tree / "rec" / "a")
    assert "cannot resume: list of captures was " in cadtof(*command, tree / "out", "--resume").err


@pytest.mark.parametrize(
    "command",
    [
        "cadtof resolve rec/a rec/b/* -o out -j 1",
        "cadtof resolve rec/a/*.tif rec/b/*/*.tif -o out -j 1",
        "cd rec; cadtof resolve a b/one b/two -o ../out -j 1",
        "find rec -name .trash -prune -o -name '*.tif' -print | sort | cadtof resolve - -o out -j 1",
        "find rec -name .trash -prune -o -name '*.tif' -print0 | sort -z | cadtof resolve - -0 -o out -j 1",
        "find \"$PWD\"/rec -name .trash -prune -o -name '*.tif' -print | cadtof resolve - -o out -j 2",
        "mv rec/b 'rec/b c'; mkdir b; cadtof resolve -r rec -o out -j 1; mv 'out/b c' out/b",
    ],
)
def test_captures_can_be_named_in_any_way_of_a_shell(command: str, tree: Path) -> None:
    done = shell(command, tree)
    assert done.status == 0, done.err
    assert _maps(tree / "out") == MIRRORED


@pytest.mark.parametrize(
    "inputs",
    [
        "-r rec rec/a",
        "rec/a -r rec rec/b",
        "rec/a rec/b/* rec/a",
        'rec/a/frame_0.tif rec/b/one rec/a "$PWD"/rec/b/two rec/x/../b/two',
        "rec/a/frame_0.tif rec/b/*/*.tif rec/b/../a/frame_0.tif",
    ],
)
def test_inputs_named_twice_are_resolved_once(inputs: str, tree: Path) -> None:
    (tree / "rec" / "x").mkdir()
    done = shell(f"cadtof resolve {inputs} -o out -j 1 --json", tree)
    assert done.status == 0, done.err
    assert _maps(tree / "out") == MIRRORED
    assert len(done.out.splitlines()) == len(MIRRORED)
    assert "resolved 3 of 3 frames" in done.err
    assert shell(f"cadtof resolve {inputs} -o out -j 1 --resume", tree).status == 0


def test_files_named_twice_keep_the_order_of_their_first_naming(tmp_path: Path) -> None:
    record(tmp_path / "a", frames=3)
    record(tmp_path / "b")
    done = shell("cadtof resolve a/frame_0.tif b/frame_0.tif a/frame_1.tif a/frame_0.tif -o out -j 1 --json", tmp_path)
    assert done.status == 0, done.err
    sources = [json.loads(line)["source"] for line in done.out.splitlines()]
    assert sources == ["a/frame_0.tif", "b/frame_0.tif", "a/frame_1.tif"]


def test_names_with_line_breaks_arrive_between_zero_bytes(tmp_path: Path) -> None:
    capture = record(tmp_path / "cap\nture")
    capture.files[0].rename(capture.folder / "frame\n0.tif")
    done = shell("find . -name '*.tif' -print0 | cadtof resolve - -0 -o out -j 1", tmp_path)
    assert done.status == 0, done.err
    assert (tmp_path / "out" / "frame\n0.tif").exists()
    told = shell("find . -name '*.tif' -print0 | cadtof info - -0 --json", tmp_path)
    assert told.status == 0, told.err
    assert sorted(json.loads(line)["kind"] for line in told.out.splitlines()) == ["capture", "maps"]


def test_maps_of_a_lone_capture_lie_in_out_itself(tree: Path) -> None:
    assert shell("cadtof resolve rec/b/one -o out -j 1; cadtof resolve -r rec/a -o below -j 1", tree).status == 0
    assert _maps(tree / "out") == _maps(tree / "below") == ["frame_0.tif"]


def test_a_folder_of_captures_names_them(tree: Path) -> None:
    done = shell("cadtof resolve rec -o out", tree)
    assert (done.status, done.out) == (2, "")
    assert "captures below it: rec/a, rec/b/one, rec/b/two; name one of them" in done.err
    done = shell("cadtof resolve -r rec/notes -o out", tree)
    assert done.status == 2
    assert "no frames in it or in any folder below it" in done.err


def test_maps_and_calibrations_are_no_captures(tree: Path) -> None:
    assert shell("cadtof resolve -r rec -o rec/maps -j 1", tree).status == 0
    shutil.copytree(tree / "rec" / "a", tree / "rec" / "camera")
    (tree / "rec" / "camera" / "capture.toml").rename(tree / "rec" / "camera" / "dark.toml")
    done = shell("cadtof resolve -r rec -o out -j 1", tree)
    assert done.status == 0, done.err
    assert _maps(tree / "out") == MIRRORED


def test_a_run_of_many_captures_is_resumed_evaluated_and_drawn(tree: Path) -> None:
    assert shell("cadtof resolve -r rec -o out -j 1", tree).status == 0
    kept = (tree / "out" / "a" / "frame_0.tif").stat().st_mtime_ns
    (tree / "out" / "b" / "one" / "frame_0.tif").unlink()
    done = shell("cadtof resolve -r rec -o out -j 1 --resume", tree)
    assert done.status == 0, done.err
    assert _maps(tree / "out") == MIRRORED
    assert (tree / "out" / "a" / "frame_0.tif").stat().st_mtime_ns == kept
    truth = tree / "out" / "a" / "frame_0.tif"
    done = cadtof("evaluate", tree / "out", "--truth", truth, "--json")
    assert done.status == 0, done.err
    evaluation = json.loads(done.out)
    assert evaluation["frames"] == 3
    assert evaluation["first_phasor"] is not None
    done = cadtof("preview", tree / "out" / "b" / "two" / "frame_0.tif", "--truth", truth, "-o", tree / "x.png")
    assert (done.status, done.err) == (0, "")
    done = shell("cadtof resolve -r rec -o out -j 1", tree)
    assert done.status == 2
    assert "would be replaced; add --overwrite" in done.err


def test_frames_are_resolved_as_they_arrive(tmp_path: Path) -> None:
    """A camera writes frames into two folders during the run. A frame's line comes before the next frame is written."""
    rng = np.random.default_rng(3)
    for place in ("cam", "cam/night"):
        (tmp_path / place).mkdir(parents=True)
    (tmp_path / "cam" / "capture.toml").write_text(TOML["tif"])
    command = [*PROGRAM, "resolve", "-", "-o", "live", "--json", "-j", "2"]
    names = ["cam/f_0.tif", "cam/f_1.tif", "cam/gone.tif", "cam/night/f_0.tif", "cam/f_2.tif"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for name in names:
            if "gone" not in name:
                write_frame(tmp_path / name, step_frame(rng))
            process.stdin.write(f"{name}\n".encode())
            process.stdin.flush()
            assert select.select([process.stdout], [], [], 60)[0]
            line = json.loads(os.read(process.stdout.fileno(), 65536))
            assert line["source"] == name
            assert line["status"] == ("failed" if "gone" in name else "ok"), line
        process.stdin.close()
        assert process.wait(60) == 1
    assert _maps(tmp_path / "live") == ["f_0.tif", "f_1.tif", "f_2.tif", "night/f_0.tif"]
    run = json.loads((tmp_path / "live" / "run.json").read_text())
    assert run["finished"]
    assert run["arguments"]["inputs"] == names
    assert [(one["root"], one["files"]) for one in run["captures"]] == [("cam", 3), ("cam/night", 1)]


def test_planes_that_arrive_one_by_one_wait_for_their_frame(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    volts = step_frame(rng)
    record(tmp_path / "whole", seed=4)
    write_frame(tmp_path / "whole" / "frame_0.tif", volts)
    (tmp_path / "cam").mkdir()
    planes = "[layout]\npattern = '{frame}_h{harmonic}_sc{channel}.tif'\n"
    (tmp_path / "cam" / "capture.toml").write_text(TOML["tif"] + planes)
    script = """
    { for f in 0 1; do for p in h1_sc1 h1_sc2 h2_sc1 h2_sc2; do
        tiffcp_page "$f" "$p"; echo cam/f${f}_$p.tif; sleep 0.7; done; done; } | cadtof resolve - -o live --json -j 1
    """
    cut = f"tiffcp_page() {{ mv source/f${{1}}_$2.tif cam/; }}\n{script}"
    (tmp_path / "source").mkdir()
    pages = tifffile.imread(tmp_path / "whole" / "frame_0.tif")
    for frame in (0, 1):
        for name, page in zip(("h1_sc1", "h1_sc2", "h2_sc1", "h2_sc2"), pages, strict=True):
            tifffile.imwrite(tmp_path / "source" / f"f{frame}_{name}.tif", page)
    done = shell(cut, tmp_path)
    assert done.status == 0, done.err
    assert [json.loads(line)["status"] for line in done.out.splitlines()] == ["ok", "ok"]
    assert shell("cadtof resolve whole -o out -j 1", tmp_path).status == 0
    for name, layer in layers_of(tmp_path / "out" / "frame_0.tif").items():
        np.testing.assert_array_equal(layer, layers_of(tmp_path / "live" / "f1.tif")[name])


def test_inotifywait_follows_a_camera(tmp_path: Path) -> None:
    needed_program("inotifywait")
    record(tmp_path / "cam")
    record(tmp_path / "next", frames=3, seed=2)
    script = """
    set -o pipefail
    (sleep 1.5; for n in 1 2; do cp next/frame_$n.tif cam/; sleep 0.3; done) &
    timeout 6 inotifywait -q -m -e close_write --format %w%f cam | cadtof resolve - -o live --json -j 1
    """
    done = shell(script, tmp_path)
    assert [json.loads(line)["source"] for line in done.out.splitlines()] == ["cam/frame_1.tif", "cam/frame_2.tif"]
    assert _maps(tmp_path / "live") == ["frame_1.tif", "frame_2.tif"]


def test_each_capture_is_compared_with_its_own_truth(tree: Path) -> None:
    assert shell("cadtof resolve -r rec -o out -j 1", tree).status == 0
    # the truth in rec/b holds for both captures below it
    for place, map_of, error_m in (("a", "a/frame_0.tif", 0.01), ("b", "b/one/frame_0.tif", 0.03)):
        depth = layers_of(tree / "out" / map_of)["direct.depth"]
        write_layers(tree / "rec" / place / "truth.exr", {"direct.depth": depth - np.float32(error_m)})
    done = shell("cadtof evaluate out --truth rec --csv errors.csv", tree)
    assert (done.status, done.err) == (0, "")
    with (tree / "errors.csv").open() as file:
        medians = {line["frame"]: float(line["median_cm"]) for line in csv.DictReader(file)}
    assert [medians["a/frame_0"], medians["b/one/frame_0"]] == pytest.approx([1.0, 3.0], abs=1e-3)
    # the same scene, other noise
    assert medians["b/two/frame_0"] == pytest.approx(3.0, abs=0.1)
    one = shell("cadtof evaluate out --truth rec/a/truth.exr", tree)
    assert "rec/a/truth.exr: the frames of 3 captures are compared with this one truth" in one.err
    two = shell("cadtof evaluate out/b --truth rec/b/truth.exr --over-time b.exr", tree)
    assert "rec/b/truth.exr: the frames of 2 captures are compared with this one truth" in two.err
    assert "out/b: --over-time takes the maps of 2 captures for one scene at rest; the folder of one capture" in two.err
    alone = shell("cadtof evaluate out/b/one --truth rec/b/truth.exr --over-time one.exr", tree)
    assert (alone.status, alone.err) == (0, "")
    _require_same_pages_and_pictures(tree)
    (tree / "rec" / "a" / "truth.exr").unlink()
    done = shell("cadtof report out -o none.html --truth rec", tree)
    assert (done.status, (tree / "none.html").exists()) == (2, False)
    assert "rec/a: found no truth of a/frame_0, expected a file truth.exr there" in done.err
    done = shell("cadtof evaluate out --truth rec", tree)
    assert done.status == 2
    assert "rec/a: found no truth of a/frame_0, expected a file truth.exr there" in done.err


def _require_same_pages_and_pictures(tree: Path) -> None:
    """Check that a folder of truths is drawn and reported like the file in it that holds for the frame."""
    for frame, place in ((0, "a"), (1, "b"), (2, "b")):
        for name, truth in (("folder", "rec"), ("file", f"rec/{place}/truth.exr")):
            done = shell(f"cadtof preview out -o {name}{frame}.png --frame {frame} --truth {truth}", tree)
            assert (done.status, done.err) == (0, "")
        assert (tree / f"folder{frame}.png").read_bytes() == (tree / f"file{frame}.png").read_bytes()
    done = shell("cadtof report out -o page.html --truth rec", tree)
    assert (done.status, done.err) == (0, "")
    page = (tree / "page.html").read_text()
    figures = json.loads(cadtof("evaluate", tree / "out", "--truth", tree / "rec", "--json").out)["direct"]
    assert f"{figures['median_cm']:.2f}{figures['p90_cm']:.2f}{figures['rmse_cm']:.2f}" in re.sub("<[^>]*>", "", page)
    (run,) = re.findall(r'<script type="application/json" id="run">(.*?)</script>', page, re.DOTALL)
    document = json.loads(run)
    # rec/b has two captures, and one truth
    assert [len(document["truth"]), [frame["truth"] for frame in document["frames"]]] == [2, [0, 1, 1]]
    one = shell("cadtof report out -o page.html --overwrite --truth rec/a/truth.exr", tree)
    assert "rec/a/truth.exr: the frames of 3 captures are compared with this one truth" in one.err


def test_info_searches_a_tree(tree: Path) -> None:
    done = shell("cadtof info -r rec --json", tree)
    assert done.status == 0, done.err
    assert [json.loads(line)["root"] for line in done.out.splitlines()] == ["rec/a", "rec/b/one", "rec/b/two"]
