"""If a capture is wrong, a message says what was found and expected, and where. A bad frame costs no other frame."""

import gc
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from tests.support.captures import (
    FRAME_SUFFIXES,
    KNOWN_FORMATS,
    PLANE_NAMES,
    TOML,
    layers_of,
    record,
    write_exr,
    write_pages,
)
from tests.support.forward import step_frame, step_truth
from tests.support.run_cadtof import cadtof, program, without_privilege

METADATA = [
    ("[modulation]\nperiod_ns = [40.0]\n", "unknown key modulation.period_ns; did you mean periods_ns? allowed: periods_ns"),
    ("[modulaton]\n", "unknown table [modulaton]; did you mean modulation? allowed: modulation, pixel"),
    ("[layout.raw]\nraw_shape = [4, 4]\n", "unknown key layout.raw.raw_shape; did you mean shape? allowed: dtype, shape, offset"),
    ("[layout]\nraw = 5\n", "layout.raw: found 5, expected a table [layout.raw]"),
    ("[optics.focal]\nlength_px = 5.0\n", "unknown key optics.focal; allowed: focal_length_px"),
    ("modulation = 3\n", "modulation: found 3, expected a table [modulation]"),
    ("[pixel\n", "not valid TOML: "),
    ("[pixel]\nintegration_length = 1e5\nintegration_length = 2e5\n", "not valid TOML: "),
    ("[pixel]\nintegration_length = -5\n", "pixel.integration_length: found -5.0, expected a finite number above 1"),
    ("[pixel]\nintegration_length = nan\n", "pixel.integration_length: found nan, expected a finite number above 1"),
    ("[pixel]\nintegration_length = 'long'\n", "pixel.integration_length: found 'long', expected a number"),
    ("[modulation]\namplitude_v = 0\n", "modulation.amplitude_v: found 0.0, expected a finite number above 0"),
    ("[modulation]\nperiods_ns = 40\n", "modulation.periods_ns: found 40, expected a list of numbers"),
    ("[modulation]\nperiods_ns = [40.0, 27.0]\n", "modulation.periods_ns: found [40.0, 27.0], expected the longest period first"),
    ("[modulation]\nperiods_ns = [20.0, 40.0]\n", "modulation.periods_ns: found [20.0, 40.0], expected the longest period first"),
    ("[modulation]\nwaveform = 'square'\n", "modulation.waveform: found 'square', expected 'sine' or 'triangle'"),
    ("[pulse]\nfwhm_ns = -1\n", "pulse.fwhm_ns: found -1.0, expected 0, or 1e-06 or more, in ns"),
    ("[pulse]\nfwhm_ns = 1.7e-9\n", "pulse.fwhm_ns: found 1.7e-09, expected 0, or 1e-06 or more, in ns"),
    (
        "[target]\ndistance_m = 1500\n",
        "target.distance_m: found 1500.0, expected at most 10 unambiguous ranges, which are 59.96 m; is it in mm?",
    ),
    ("[voltage]\nvolts_per_count = 0\n", "voltage.volts_per_count: found 0.0, expected a finite number other than 0"),
    ("[voltage]\nsaturated_counts = [9, 3]\n", "voltage.saturated_counts: found [9.0, 3.0], expected the lower limit"),
    ("[voltage]\nsaturated_counts = [9, 9]\n", "voltage.saturated_counts: found [9.0, 9.0], expected the lower limit"),
    ("[voltage]\nsaturated_counts = [9]\n", "voltage.saturated_counts: found [9], expected a list of two numbers"),
    ("[layout]\npattern = 'a_{frame}.tif'\n", "layout.pattern: found 'a_{frame}.tif', expected a file name with {frame}"),
    ("[layout]\npattern = '{frame:4}{harmonic}_{channel}'\n", "layout.pattern: found '{frame:4}{harmonic}_{channel}', expected"),
    ("[layout]\nframes = 0\n", "layout.frames: found 0, expected 1 or more"),
]  # fmt: skip


@pytest.mark.parametrize(("toml", "message"), METADATA)
@pytest.mark.parametrize("command", ["resolve", "info"])
def test_metadata_with_a_mistake_is_refused(toml: str, message: str, command: str, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", toml=toml)
    out = ("-o", tmp_path / "out") if command == "resolve" else ()
    done = cadtof(command, capture.folder, *out, "-j", 1)
    assert done.err.startswith(f"Error: {capture.folder / 'capture.toml'}: {message}")
    assert (done.status, done.out) == (2, "")
    assert not (tmp_path / "out").exists()


OPTIONS = [
    (("--amplitude", "0"), "--amplitude-v: modulation.amplitude_v: found 0.0, expected a finite number above 0"),
    (("--integration-length", "-1"), "--integration-length: pixel.integration_length: found -1.0"),
    (("--periods", "40,13"), "--periods-ns: modulation.periods_ns: found [40.0, 13.0]"),
    (("--periods", "40,x"), "'40,x' is not a list of numbers such as 40,20"),
    (("--jobs", "0"), "--jobs: found 0, expected 1 or more"),
    (("--false-alarm", "0"), "--false-alarm: found 0.0, expected a probability between 0 and 1"),
    (("--min-return-ratio", "2"), "--min-return-ratio: found 2.0, expected 0 to 1"),
    (("--min-confidence", "-1"), "--min-confidence: found -1.0, expected a voltage, 0 or more"),
    (("--solver", "one-path", "--order", "2"), "--order: found '2', expected one of auto, 1"),
    (("--solver", "magic"), "'magic' is not one of"),
    (("--overwrite", "--resume"), "--overwrite and --resume exclude each other: replace the old maps, or keep them"),
    (("--format", "png"), "'png' is not one of 'exr', 'tif', 'same'"),
]


@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_options_with_a_mistake_are_refused(options: tuple[str, ...], message: str, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", *options)
    assert message in done.err
    assert "Traceback" not in done.err
    assert (done.status, done.out) == (2, "")
    assert not (tmp_path / "out").exists()


def test_missing_metadata_is_named_with_the_option_that_gives_it(tmp_path: Path) -> None:
    counts = record(tmp_path / "counts", toml="[pixel]\nintegration_length = 1e5\n")
    done = cadtof("resolve", counts.folder, "-o", tmp_path / "out", "-j", 1)
    assert done.err == (
        f"Error: {counts.folder}: frames hold whole numbers (uint16), and the volts per count are unknown: "
        f"set volts_per_count and zero_counts under [voltage] in {counts.folder / 'capture.toml'}, or --volts-per-count and "
        "--zero-counts\n"
    )
    assert done.status == 2
    volts = record(tmp_path / "volts", form="exr")
    mixed = shutil.copytree(volts.folder, tmp_path / "mixed")
    odd = Path(shutil.copy(counts.files[0], mixed / "odd.tif"))
    done = cadtof("resolve", mixed, "-o", tmp_path / "of_mixed", "-j", 1)
    assert f"\nfailed: {odd}: frames hold whole numbers (uint16)" in done.err
    assert done.status == 1
    done = cadtof("resolve", volts.folder, "-o", tmp_path / "out", "-j", 1, "--depth", "z")
    assert done.err == (
        f"Error: {volts.folder}: the optics are unknown: set focal_length_px under [optics] in "
        f"{volts.folder / 'capture.toml'}, or --focal-length-px\n"
    )
    assert done.status == 2
    assert not (tmp_path / "out").exists()


def test_inputs_without_frames_say_what_was_looked_for(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    for inputs, message in (
        ((empty,), f"{empty}: no frames: looked for {FRAME_SUFFIXES} files other than truth.*, found nothing"),
        ((tmp_path / "gone",), f"{tmp_path / 'gone'}: no such file or folder; expected a capture folder or a frame"),
    ):
        for command in (("resolve", "-o", tmp_path / "out"), ("info",)):
            done = cadtof(*command, *inputs)
            assert (done.status, done.out, done.err) == (2, "", f"Error: {message}\n")
    (empty / "notes.txt").touch()
    write_exr(empty / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    assert "found notes.txt, truth.exr" in cadtof("resolve", empty, "-o", tmp_path / "out").err


def test_more_or_fewer_periods_than_were_recorded_are_refused(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--periods", "40,20,10")
    assert done.status == 1
    assert f"{capture.files[0]}: found 4 pages of 32 × 24 uint16, expected 6 for one frame (H1.SC1, " in done.err
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "single", "-j", 1, "--periods", "40")
    assert done.status == 2
    assert "2 paths need at least 2 periods" in done.err


def _truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-700])


def _garbage(file: Path) -> None:
    content = np.random.default_rng(5).bytes(3000)
    file.write_bytes(file.read_bytes()[:8] + content)


def _planes() -> Float:
    return step_frame(np.random.default_rng(9)).reshape(4, 24, 32)


def _write(file: Path, planes: Float) -> None:
    if file.suffix == ".exr":
        write_exr(file, dict(zip(PLANE_NAMES, planes.astype(np.float32), strict=False)))
    else:
        write_pages(file, (planes * 1e4 + 8192).astype(np.uint16))


def _smaller(file: Path) -> None:
    _write(file, _planes()[:, :20, :])


def _without_last_plane(file: Path) -> None:
    _write(file, _planes()[:3])


def _gone(file: Path) -> None:
    file.unlink()
    file.symlink_to("nowhere")


def _empty(file: Path) -> None:
    file.write_bytes(b"")


def _picture(file: Path) -> None:
    file.write_bytes(b"\xff\xd8\xff\xe0\0\x10JFIF" + bytes(500))


DAMAGE: list[tuple[str, Callable[[Path], None], str]] = [
    ("tif", _truncate, "truncated"),
    ("exr", _truncate, "damaged EXR"),
    ("tif", _garbage, "damaged"),
    ("exr", _garbage, "damaged EXR"),
    ("tif", _smaller, "found 32 × 20 pixels, expected 32 × 24 as most frames of the capture have"),
    ("exr", _smaller, "found 32 × 20 pixels, expected 32 × 24 as most frames of the capture have"),
    ("tif", _without_last_plane, "found 3 pages of 32 × 24 uint16, expected 4 for one frame"),
    ("exr", _without_last_plane, "H2.SC2"),
    ("tif", _gone, "cannot be read: No such file or directory"),
    ("tif", _empty, f"found an empty file, expected one of {KNOWN_FORMATS}"),
    ("exr", _picture, f"found a file of another kind (first bytes ff d8 ff e0), expected one of {KNOWN_FORMATS}"),
]


@pytest.mark.parametrize(("form", "damage", "message"), DAMAGE)
def test_one_bad_frame_of_many_fails_alone(
    form: str, damage: Callable[[Path], None], message: str, tmp_path: Path
) -> None:
    capture = record(tmp_path / "capture", frames=4, form="exr" if form == "exr" else "tif")
    bad = capture.files[2]
    damage(bad)
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1)
    assert done.status == 1
    assert "Traceback" not in done.err
    (complaint,) = (line for line in done.err.splitlines() if line.startswith("failed: "))
    assert "resolved 3 of 4 frames" in done.err
    assert f"1 failed, see {tmp_path / 'out' / 'frames.jsonl'}" in done.err
    lines = [json.loads(line) for line in (tmp_path / "out" / "frames.jsonl").read_text().splitlines()]
    assert [line["status"] for line in lines] == ["ok", "ok", "failed", "ok"]
    failed = lines[2]
    assert (failed["source"], failed["output"], failed["invalid"]) == (str(bad), None, None)
    assert complaint == f"failed: {failed['reason']}"
    assert failed["reason"].startswith(str(bad))
    assert message in failed["reason"]
    assert "unexpected" not in failed["reason"]
    names = {f"frame_{index}.{form}" for index in (0, 1, 3)} | {"frames.jsonl", "run.json"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    for index in (0, 1, 3):
        depth = layers_of(tmp_path / "out" / f"frame_{index}.{form}")["direct.depth"]
        assert np.median(np.abs(depth - step_truth())) < 0.01
    info = cadtof("info", capture.folder, "-j", 1)
    assert info.status == 1
    assert f"wrong: {bad}" in info.err


def test_a_frame_of_saturated_pixels_has_no_answer(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2)
    write_pages(capture.files[0], np.full((4, 24, 32), 16383, np.uint16))
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--json")
    assert done.status == 1
    assert json.loads(done.out.splitlines()[0])["status"] == "failed"
    assert "every pixel is saturated: stored values (uint16) lie between 16383 and 16383" in done.err
    assert [path.name for path in (tmp_path / "out").glob("*.tif")] == ["frame_1.tif"]
    text = (capture.folder / "capture.toml").read_text().replace("integration_length = 100000\n", "")
    (capture.folder / "capture.toml").write_text(text)
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "estimated", "-j", 1)
    assert done.status == 1
    assert "every pixel is saturated" in done.err


def test_a_frame_whose_noise_cannot_be_estimated_fails(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    pages = np.full((4, 24, 32), 16383, np.uint16)
    pages[:, :3, :4] = 8200
    write_pages(capture.files[0], pages)
    text = (capture.folder / "capture.toml").read_text().replace("integration_length = 100000\n", "")
    (capture.folder / "capture.toml").write_text(text)
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "estimated", "-j", 1)
    assert done.status == 1
    assert (
        f"failed: {capture.files[0]}: the integration length is unknown and the noise cannot be estimated" in done.err
    )
    assert "too few neighbouring pixels are finite and not saturated" in done.err
    assert "set integration_length under [pixel] in capture.toml, or --integration-length" in done.err


def test_a_frame_without_light_has_no_answer(tmp_path: Path) -> None:
    """The counts are so coarse that noise need not change any."""
    text = TOML["tif"].replace("6.0e-5", "1.0e-3")
    capture = record(tmp_path / "capture", toml=text)
    write_pages(capture.files[0], np.full((4, 24, 32), 8192, np.uint16))
    for extra in ((), ("--min-confidence", "0"), ("--order", "2"), ("--solver", "one-path")):
        done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--overwrite", *extra)
        assert done.status == 1
        assert f"failed: {capture.files[0]}: no pixel has an answer (100.0% low confidence)" in done.err
        assert not list((tmp_path / "out").glob("*.tif"))


def test_files_and_folders_without_permission_are_reported(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3)
    capture.files[1].chmod(0)
    done = without_privilege("resolve", capture.folder, "-o", tmp_path / "out", "-j", 2)
    assert done.status == 1
    assert f"failed: {capture.files[1]}: cannot be read: Permission denied" in done.err
    assert (tmp_path / "out" / "frame_2.tif").exists()
    (capture.folder / "capture.toml").chmod(0)
    done = without_privilege("resolve", capture.folder, "-o", tmp_path / "none")
    toml = capture.folder / "capture.toml"
    assert (done.status, done.out, done.err) == (2, "", f"Error: {toml}: cannot be read: Permission denied\n")
    capture.folder.chmod(0)
    try:
        done = without_privilege("resolve", capture.folder, "-o", tmp_path / "none")
    finally:
        capture.folder.chmod(0o755)
    message = f"Error: {capture.folder}: no permission to list this folder; expected one that can be read\n"
    assert (done.status, done.out, done.err) == (2, "", message)


def test_names_that_are_not_utf_8_are_resolved_and_recorded(tmp_path: Path) -> None:
    capture = record(tmp_path / "bytes \udcff and\nlines", toml=TOML["tif"])
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out \udcfe", "-j", 1, "--json")
    assert done.status == 0
    assert json.loads(done.out)["source"] == str(capture.files[0])
    assert program("resolve", capture.folder, "-o", tmp_path / "real", "-j", 2).status == 0
    run = json.loads((tmp_path / "out \udcfe" / "run.json").read_text())
    assert run["arguments"]["inputs"] == [str(capture.folder)]


def test_debug_shows_where_an_error_arose(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="no such file or folder"):
        cadtof("--debug", "resolve", tmp_path / "gone", "-o", tmp_path / "out")


@pytest.mark.parametrize("name", ["Capture.toml", "capture.toml.txt"])
def test_a_settings_file_with_a_wrong_name_is_reported_not_ignored(name: str, tmp_path: Path) -> None:
    capture, above = record(tmp_path / "capture"), tmp_path / "capture.toml"
    settings = (capture.folder / "capture.toml").rename(capture.folder / name)
    above.write_text(TOML["tif"])
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1)
    assert done.status == 2
    assert (
        f"{settings}: found settings under this name, expected capture.toml: rename it, or give --settings" in done.err
    )
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--settings", settings).status == 0
    (capture.folder / "capture.toml").write_text(TOML["tif"])
    assert cadtof("info", capture.folder, "-j", 1).status == 0


def test_optics_that_are_not_in_pixels_are_doubted(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", toml=TOML["tif"].replace("focal_length_px = 28.0", "focal_length_px = 4.2"))
    message = (
        f"{capture.folder}: optics.focal_length_px = 4.2 means a view of 151°: is the value in mm instead of pixels?"
    )
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1)
    assert done.status == 0
    assert f"warning: {message}" in done.err
    info = cadtof("info", capture.folder, "-j", 1)
    assert info.status == 1
    assert f"wrong: {message}" in info.err


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="the system does not list open files")
def test_a_damaged_frame_does_not_stay_open(tmp_path: Path) -> None:
    """With many such frames, no file could be opened any more."""
    (tmp_path / "capture").mkdir()
    for number in range(3):
        _write(tmp_path / f"capture/frame_{number}.exr", _planes())
    damaged = tmp_path / "capture/frame_2.exr"
    _truncate(damaged)
    gc.disable()
    try:
        assert cadtof("resolve", damaged.parent, "-o", tmp_path / "out", "-j", 1).status == 1
        assert damaged not in [one.resolve() for one in Path("/proc/self/fd").iterdir()]
    finally:
        gc.enable()
