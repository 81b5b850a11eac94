"""`cadtof info`: what captures and maps hold, where values came from, and what is wrong."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from cadtof_cli.calibration.store import save_part
from cadtof_cli.capture.metadata import CaptureMetadata
from tests.support.calibrations import made_up_calibration
from tests.support.captures import (
    KNOWN_FORMATS,
    PLANE_NAMES,
    VOLTS_PER_COUNT,
    Form,
    layers_of,
    record,
    write_exr,
    write_pages,
)
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, step_frame, step_truth
from tests.support.run_cadtof import ROOT, cadtof


def _facts(*arguments: object) -> dict[str, Any]:
    done = cadtof("info", *arguments, "--json", "-j", 1)
    assert (done.status, done.err) == (0, "")
    facts: dict[str, Any] = json.loads(done.out, parse_constant=_refuse)
    return facts


def _refuse(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")


def test_every_key_is_in_the_documentation(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "looking.md").read_text()
    section = page.split("## What a capture or run holds, for programs")[1].split("\n## ")[0]
    capture = record(tmp_path / "capture")
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "maps", "-j", 1).status == 0
    dark = made_up_calibration(CaptureMetadata(), (24, 32), ("dark",)).dark
    assert dark is not None
    save_part(tmp_path / "calibration", dark)
    for name in ("capture", "maps", "calibration"):
        facts = _facts(tmp_path / name)
        assert facts["kind"] == name
        assert {key for key in facts if f"`{key}`" not in section} == set()


def test_a_capture_of_counts(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3)
    pages = [tifffile.imread(file) for file in capture.files]
    pages[1][0, 2, 3], pages[1][3, 4, 5] = 16383, 0
    write_pages(capture.files[1], pages[1])
    facts = _facts(capture.folder)
    assert facts["kind"] == "capture"
    assert facts["root"] == str(capture.folder)
    assert (facts["frames"], facts["containers"], facts["types"]) == (3, {"tif": 3}, {"uint16": 3})
    assert facts["shape"] == [2, 2, 24, 32]
    assert facts["saturated"] == pytest.approx(2 / (3 * 24 * 32))
    assert facts["not_finite"] == 0
    for index, name in enumerate(PLANE_NAMES):
        values = np.stack(pages)[:, index]
        assert facts["planes"][name] == [values.min(), values.max()]
    assert facts["unambiguous_range_m"] == pytest.approx(C_M_PER_NS * 20)
    # the variance of a sine is half of its squared amplitude, and a mean has that of 2·n_av − 1 samples
    assert facts["noise_mv"] == pytest.approx(1e3 * AMPLITUDE_V * (0.5 / (2e5 - 1)) ** 0.5)
    assert facts["integration_length_seen"] == pytest.approx(1e5, rel=0.3)
    assert facts["problems"] == facts["not_frames"] == []
    toml = str(capture.folder / "capture.toml")
    assert facts["metadata"]["voltage.volts_per_count"] == {"value": 6e-5, "from": toml}
    assert facts["metadata"]["target.distance_m"] == {"value": None, "from": "default"}


def test_an_exposure_that_changed_midway_is_shown(tmp_path: Path) -> None:
    """The first frames alone show an integration length that the last ones do not have."""
    capture = record(tmp_path / "capture", frames=4)
    sigma = 3.0 * AMPLITUDE_V / (2.0 * 1e5**0.5) / VOLTS_PER_COUNT
    for number, file in enumerate(capture.files[2:]):
        pages = tifffile.imread(file)
        noise = np.random.default_rng(number).normal(scale=sigma, size=pages.shape)
        write_pages(file, np.rint(pages + noise).astype(np.uint16))
    facts = _facts(capture.folder)
    assert facts["integration_lengths_seen"] == pytest.approx([1e4, 1e5], rel=0.4)
    assert facts["integration_length_seen"] == facts["integration_lengths_seen"][0]
    least, most = (f"{length:.4g}" for length in facts["integration_lengths_seen"])
    assert f"integration length seen     {least} … {most} or more" in cadtof("info", capture.folder, "--jobs", 1).out


def test_the_origin_of_each_value_is_shown(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form="exr", toml="[pulse]\nfwhm_ns = 1.5\n")
    metadata = _facts(capture.folder, "--amplitude", 0.25)["metadata"]
    assert metadata["modulation.amplitude_v"] == {"value": 0.25, "from": "--amplitude-v"}
    assert metadata["pulse.fwhm_ns"] == {"value": 1.5, "from": str(capture.folder / "capture.toml")}
    assert metadata["modulation.periods_ns"] == {"value": [40.0, 20.0], "from": "default"}
    shown = cadtof("info", capture.folder, "--amplitude", 0.25, "-j", 1)
    assert shown.status == 0
    rows = {line.split()[0]: line for line in shown.out.splitlines()}
    assert rows["modulation.amplitude_v"].split()[1:] == ["0.25", "from", "--amplitude-v"]
    assert "unknown: the noise is estimated from each frame" in rows["pixel.integration_length"]
    assert "2 harmonics × 2 channels × 24 × 32 (H C Y X)" in rows["shape"]
    assert "5.996 m" in rows["unambiguous"]


def _rows(*arguments: object) -> dict[str, str]:
    """Return what `info` shows, by the name that stands before it."""
    lines = cadtof("info", *arguments, "-j", 1).out.splitlines()[1:]
    return {line[:30].strip(): line[30:] for line in lines}


def test_an_unknown_value_is_shown_with_the_reason(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", toml="[voltage]\nzero_counts = 8192\n")
    known = _rows(capture.folder, "--volts-per-count", 6e-5, "--integration-length", 1e5, "--saturated-counts", "0,1")
    assert known["noise"].endswith("from the integration length")
    assert known["saturated"] == "100.000% of pixels"
    seen = _rows(capture.folder, "--volts-per-count", 6e-5)
    assert seen["noise"].endswith("from the integration length seen")
    assert seen["saturated"] == "unknown: voltage.saturated_counts is not given"
    # pixels at the limits are counted even if nothing says how many volts a count is
    assert _rows(capture.folder, "--saturated-counts", "0,1")["saturated"] == "100.000% of pixels"
    capture.files[0].write_bytes(b"")
    assert not {"saturated", "not finite", "noise"} & _rows(capture.folder).keys()


def test_a_frame_without_a_finite_value(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form="exr")
    nothing = np.full((24, 32), np.nan, np.float32)
    write_exr(capture.files[0], dict.fromkeys(PLANE_NAMES, nothing))
    done = cadtof("info", capture.folder, "-j", 1, "--json")
    wrong = f"{capture.files[0]}: no pixel has an answer (100.0% not finite)"
    assert (done.status, done.err) == (1, f"wrong: {wrong}\n")
    facts = json.loads(done.out, parse_constant=_refuse)
    assert (facts["not_finite"], facts["saturated"], facts["planes"]) == (1.0, 0.0, {})
    assert facts["problems"] == [wrong]
    # `resolve` says the same
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--integration-length", 1e5)
    assert (done.status, f"failed: {wrong}\n" in done.err) == (1, True)


def test_infinite_values_are_counted(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form="exr")
    planes = step_frame(np.random.default_rng(0)).reshape(4, 24, 32).astype(np.float32)
    planes[0, 1, 2], planes[2, 3, 4] = np.inf, np.nan
    write_exr(capture.files[0], dict(zip(PLANE_NAMES, planes, strict=True)))
    assert _facts(capture.folder)["not_finite"] == pytest.approx(2 / 768)


def test_each_harmonic_may_have_an_integration_length_of_its_own(tmp_path: Path) -> None:
    """The same list in capture.toml and on the command line. The noise shown is the harmonics' mean."""
    lengths = record(tmp_path / "a", toml="[pixel]\nintegration_length = [1e5, 2.5e4]\n"), record(tmp_path / "b")
    shown = [
        cadtof("info", lengths[0].folder, "--volts-per-count", 6e-5, "--json"),
        cadtof("info", lengths[1].folder, "--volts-per-count", 6e-5, "--integration-length", "1e5,2.5e4", "--json"),
    ]
    for done in shown:
        facts = json.loads(done.out)
        facts = facts[0] if isinstance(facts, list) else facts
        assert facts["metadata"]["pixel.integration_length"]["value"] == [1e5, 2.5e4]
        variance = (274.6 / np.sqrt(2.0)) ** 2 * np.mean([1 / (2e5 - 1), 1 / (5e4 - 1)])
        assert facts["noise_mv"] == pytest.approx(np.sqrt(variance), rel=1e-6)


def test_problems_are_reported_with_status_1(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3, toml="[pixel]\nintegration_length = 1e5\n")
    capture.files[1].write_bytes(b"")
    done = cadtof("info", capture.folder, "-j", 1, "--json")
    assert done.status == 1
    empty, unscaled = done.err.splitlines()
    assert empty.startswith(f"wrong: {capture.files[1]}: found an empty file, expected one of {KNOWN_FORMATS}")
    assert unscaled.startswith(
        f"wrong: {capture.folder}: frames hold whole numbers (uint16), and the volts per count are unknown"
    )
    facts = json.loads(done.out)
    assert [f"wrong: {problem}" for problem in facts["problems"]] == [empty, unscaled]
    assert (facts["frames"], facts["containers"]) == (3, {"tif": 2})


def test_an_input_with_wrong_settings_does_not_hide_the_others(tmp_path: Path) -> None:
    good, wrong = (record(tmp_path / name, form="exr").folder for name in ("good", "wrong"))
    (wrong / "capture.toml").write_text("[modulation]\nperiods_ns = [40.0, 0.0]\n")
    done = cadtof("info", wrong, good, tmp_path / "none", "-j", 1, "--json")
    assert [Path(json.loads(line)["root"]).name for line in done.out.splitlines()] == ["good", "wrong", "none"]
    settings, absent = done.err.splitlines()
    assert settings.startswith(f"wrong: {wrong / 'capture.toml'}: modulation.periods_ns: found 0.0, expected")
    assert absent.startswith(f"wrong: {tmp_path / 'none'}: no such file or folder")
    assert done.status == 1
    # if there is nothing to show, that is wrong usage
    alone = cadtof("info", wrong, tmp_path / "none", "-j", 1)
    assert (alone.status, alone.out) == (2, "")


def test_a_file_that_is_no_frame_is_named(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    write_exr(capture.folder / "depth.exr", {"direct.depth": step_truth().astype(np.float32)})
    facts = _facts(capture.folder)
    assert facts["frames"] == 1
    (named,) = facts["not_frames"]
    assert named.startswith(str(capture.folder / "depth.exr"))


def test_a_folder_without_frames_is_a_problem_unless_folders_are_searched(tmp_path: Path) -> None:
    write_exr(tmp_path / "frame.exr", {"f1_I": step_truth().astype(np.float32)})
    done = cadtof("info", tmp_path, "-j", 1)
    assert (done.status, done.err) == (
        1,
        f"wrong: {tmp_path}: no frames: none of its files holds the voltages of a frame\n",
    )
    assert cadtof("info", "-r", tmp_path, "-j", 1).status == 0


def test_some_of_many_frames_with_the_same_problem_are_named(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=8)
    for file in capture.files[:7]:
        file.write_bytes(b"II*\0 and no more")
    capture.files[7].write_bytes(b"")
    done = cadtof("info", capture.folder, "-j", 1, "--json")
    assert done.status == 1
    *named, more, other = done.err.splitlines()
    assert [line.partition(": ")[2].partition(": ")[0] for line in named] == list(map(str, capture.files[:5]))
    assert more == "wrong: 2 more for the same reason; --json names all"
    assert other.startswith(f"wrong: {capture.files[7]}: found an empty file")
    assert len(json.loads(done.out)["problems"]) == 8


def test_layers_of_truth_have_their_units(tmp_path: Path) -> None:
    layers = {"direct.depth": np.ones(12), "mpi.delay": np.linspace(3, 20, 12), "mpi.ratio": np.linspace(0, 1, 12)}
    write_exr(tmp_path / "truth.exr", {name: plane.reshape(3, 4).astype(np.float32) for name, plane in layers.items()})
    text = cadtof("info", tmp_path / "truth.exr").out
    assert "mpi.delay                   3 … 20 ns, median 11.5, 100.0% of pixels" in text
    assert "mpi.ratio                   0 … 1, median 0.5, 100.0% of pixels" in text


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_maps_by_file_and_by_folder(form: Form, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2, form=form), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    layers = layers_of(out / f"frame_0.{form}")
    for path, files in ((out, 2), (out / f"frame_0.{form}", 1)):
        facts = _facts(path)
        assert (facts["kind"], facts["path"], facts["files"], facts["pixels"]) == ("maps", str(path), files, [24, 32])
        for name in ("direct.depth", "mpi.sigma", "confidence"):
            finite = layers[name][np.isfinite(layers[name])]
            described = facts["layers"][name]
            assert described["unit"] == ("V" if name == "confidence" else "m")
            assert described["median"] == pytest.approx(float(np.median(finite)))
            assert (described["lowest"], described["highest"]) == (finite.min(), finite.max())
            assert described["valid"] == pytest.approx(finite.size / 768)
        bits = layers["status"].astype(np.uint32)
        assert facts["status"]["two_paths"] == pytest.approx(np.mean((bits & 16) != 0))
        assert (facts["run"] is None) == (files == 1)
    done = cadtof("info", out, out / f"frame_1.{form}", "-j", 1)
    assert done.status == 0
    assert "2 of 32 × 24 pixels; the figures are those of the first\n" in done.out
    assert str(out / f"frame_1.{form}") in done.out


def test_maps_of_one_capture_of_many(tmp_path: Path) -> None:
    """The record of the run lies in the folder above the maps."""
    for name in ("hall", "stairs"):
        record(tmp_path / name)
    assert cadtof("resolve", tmp_path / "hall", tmp_path / "stairs", "-o", tmp_path / "out", "-j", 1).status == 0
    done = cadtof("info", tmp_path / "out" / "stairs")
    assert (done.status, done.out.splitlines()[1].split()[:2]) == (0, ["maps", "1"])


def test_maps_in_folders_below_without_the_record_of_their_run(tmp_path: Path) -> None:
    """`info` and `preview` take them for maps; with a capture in a folder beside, the tree holds recorded frames."""
    capture, tree = record(tmp_path / "hall"), tmp_path / "tree"
    assert cadtof("resolve", capture.folder, "-o", tree / "maps", "-j", 1).status == 0
    for name in ("run.json", "frames.jsonl"):
        (tree / "maps" / name).unlink()
    done = cadtof("info", tree)
    assert (done.status, done.out.splitlines()[1].split()[:2]) == (0, ["maps", "1"])
    assert cadtof("preview", tree, "-o", tmp_path / "a.png").status == 0
    capture.folder.rename(tree / "recorded")
    assert f"{tree / 'recorded'}\n  frames                      1" in cadtof("info", tree, "--recursive").out


def test_a_flipped_bit_in_a_map_is_told(tmp_path: Path) -> None:
    """The pixels have no checksum of their own, but the record of the run holds a digest of each map."""
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    assert cadtof("info", out).status == 0
    content = bytearray((out / "frame_1.tif").read_bytes())
    content[len(content) // 2] ^= 1
    (out / "frame_1.tif").write_bytes(content)
    done = cadtof("info", out)
    told = f"wrong: {out / 'frame_1.tif'}: changed since the run wrote it: damaged, or replaced by another program\n"
    assert (done.status, done.err) == (1, told)
    # the map by itself has nothing to be compared with
    assert cadtof("info", out / "frame_1.tif").status == 0


def test_damaged_maps_and_records(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    (out / "frame_1.tif").write_bytes(b"II*\0garbage")
    (out / "run.json").write_bytes(b'{"a": "\xe2')
    done = cadtof("info", out, "-j", 1)
    assert (done.status, "not the record of a run (not UTF-8 text: byte 7)" in done.err) == (1, True)
    (out / "run.json").write_text("[" * 100_000)
    done = cadtof("info", out, "-j", 1)
    assert "not the record of a run (lists or objects are nested hundreds of levels deep)" in done.err
    (out / "run.json").write_text("{")
    done = cadtof("info", out, "-j", 1)
    assert done.status == 1
    record_problem, map_problem = done.err.splitlines()
    assert record_problem.startswith(f"wrong: {out / 'run.json'}: not the record of a run (")
    assert map_problem.startswith(f"wrong: {out / 'frame_1.tif'}: damaged or truncated TIFF")


def test_a_run_without_maps_and_a_record_that_cannot_be_read_are_problems(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    (out / "frame_0.tif").unlink()
    done = cadtof("info", out, "--json")
    assert (done.status, json.loads(done.out)["problems"]) == (1, [f"{out}: found no maps"])
    (out / "run.json").unlink()
    (out / "run.json").mkdir()
    done = cadtof("info", out, "--json")
    assert done.status == 1
    assert json.loads(done.out)["problems"] == [
        f"{out / 'run.json'}: cannot be read: Is a directory",
        f"{out}: found no maps",
    ]


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_a_folder_whose_first_map_is_damaged_is_described_by_the_next(form: Form, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=3, form=form), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    maps = [out / f"frame_{index}.{form}" for index in range(3)]
    second = _facts(maps[1])
    maps[0].write_bytes(maps[0].read_bytes()[:3000])
    for record_is_there in (True, False):
        if not record_is_there:
            (out / "run.json").unlink()
        done = cadtof("info", out, "--json", "-j", 1)
        assert done.status == 1
        (problem,) = done.err.splitlines()
        assert problem.startswith(f"wrong: {maps[0]}: ")
        facts = json.loads(done.out)
        assert (facts["kind"], facts["files"]) == ("maps", 3)
        assert [facts[name] for name in ("pixels", "layers", "status", "about")] == [
            second[name] for name in ("pixels", "layers", "status", "about")
        ]


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_damaged_frames_beside_truth_are_no_maps(form: Form, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form=form, toml="")
    write_exr(capture.folder / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    capture.files[0].write_bytes(capture.files[0].read_bytes()[:300])
    done = cadtof("info", capture.folder, "--json", "-j", 1)
    assert (done.status, json.loads(done.out)["kind"]) == (1, "capture")
    assert f"wrong: {capture.files[0]}: " in done.err


def test_a_calibration_has_a_line_for_each_value_and_each_finding(tmp_path: Path) -> None:
    folder, findings = tmp_path / "camera", ("one, and more", "another")
    response = made_up_calibration(CaptureMetadata(), (24, 32), ("response",)).response
    assert response is not None
    save_part(folder, replace(response, quality=replace(response.quality, findings=findings)))
    done = cadtof("info", folder)
    assert (done.status, done.err) == (0, "")
    head, *lines = done.out.splitlines()
    assert head == str(folder)
    # two blanks or more separate a name from its value, however long the name is
    column = lines[0].index("digest")
    assert all(line[column - 2 : column] == "  " and line[column] != " " for line in lines)
    assert "response.quality.phase_stderr_rad" in [line[:column].strip() for line in lines]
    first = next(place for place, line in enumerate(lines) if "response.quality.findings" in line)
    assert tuple(line[column:] for line in lines[first : first + 2]) == findings
    assert not lines[first + 1][:column].strip()


@pytest.mark.parametrize(
    ("name", "options"), [("0.npy", ()), ("0.raw", ("--raw-dtype", "uint16", "--raw-shape", "2,2,24,32"))]
)
def test_settings_are_begun_for_frames_that_are_no_maps_beside_their_truth(
    name: str, options: tuple[str, ...], tmp_path: Path
) -> None:
    counts = np.rint(np.random.default_rng(1).normal(8192.0, 300.0, (2, 2, 24, 32))).astype("u2")
    np.save(tmp_path / "0.npy", counts)
    if name != "0.npy":
        (tmp_path / "0.npy").unlink()
        counts.tofile(tmp_path / name)
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.ones((24, 32), "f4")})
    done = cadtof("info", tmp_path, "--write-settings", *options)
    assert f"wrote {tmp_path / 'capture.toml'}" in done.err
    assert f"{tmp_path}: frames hold whole numbers (uint16), and the volts per count are unknown" in done.err


@pytest.mark.parametrize("command", [("info",), ("preview", "-o", "x.png")])
def test_maps_whose_status_was_scaled_are_damaged_maps_and_no_frames(command: tuple[str, ...], tmp_path: Path) -> None:
    layers = {"direct.depth": np.ones((24, 32), "f4"), "status": np.full((24, 32), 8 / 65535, "f4")}
    path = write_exr(tmp_path / "scaled.exr", layers)
    done = cadtof(*command, path)
    assert done.status == 1
    assert f"{path}: damaged maps: their status holds numbers that are no bits" in done.err
    assert "expected voltages" not in done.out + done.err
