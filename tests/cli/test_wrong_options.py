"""Options that have no effect beside the other options are named, and impossible values are refused."""

import re
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli import read_frames, resolve
from tests.support.campaign import camera, covered, write
from tests.support.captures import Form, layers_of, record
from tests.support.run_cadtof import cadtof

FOCAL = ("--focal-length", "28")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("wrong") / "capture").folder


@pytest.fixture(scope="module")
def maps(capture: Path) -> Path:
    folder = capture.parent / "maps"
    assert cadtof("resolve", capture, "-o", folder, "-j", 1, "-q").status == 0
    return folder


WITHOUT_EFFECT = [
    ("resolve CAPTURE --starts 5", "--starts: has no effect with --solver two-path"),
    ("resolve CAPTURE --solver one-path --seed 5", "--seed: has no effect with --solver one-path"),
    ("inspect CAPTURE --pixel 1,1 --seed 5", "--seed: has no effect with --solver two-path"),
    ("simulate --starts 5", "--starts: has no effect with --solver two-path"),
    (
        "resolve CAPTURE --mpi-model diffuse --solver lm",
        "--mpi-model: has no effect with a --solver, --order, --paths or --return that asks for separate paths",
    ),
    ("sweep --asr 5 --mpi 0 --runs 2 --starts 5", "--starts: has no effect with --solver two-path"),
    (
        "resolve CAPTURE --return strongest --min-return-ratio .2",
        "--min-return-ratio: has no effect with --return strongest",
    ),
    ("resolve CAPTURE --null", "--null: has no effect without - as INPUT"),
    ("resolve CAPTURE --scheduler tcp://127.0.0.1:9 --jobs 2", "--jobs: has no effect with --scheduler"),
    (
        "resolve CAPTURE --scheduler tcp://127.0.0.1:9 --start-method spawn",
        "--start-method: has no effect with --scheduler",
    ),
    ("export MAPS -o a.npz --layer mpi.depth", "--layer: has no effect with .npz"),
    ("export MAPS -o a.csv --principal-point 3,3", "--principal-point: has no effect with .csv"),
    ("export MAPS -o a.png --focal-length 300", "--focal-length: has no effect with .png"),
    ("preview MAPS -o a.png --fps 5", "--fps: has no effect with .png"),
    ("preview MAPS -o a.png --layer status --range 0,1", "--range: has no effect with --layer status"),
    ("profile MAPS --row 1 --layer mpi.depth --first-phasor", "--first-phasor: has no effect with --layer mpi.depth"),
    (
        "profile MAPS --row 1 --layer mpi.depth --no-first-phasor",
        "--no-first-phasor: has no effect with --layer mpi.depth",
    ),
    ("profile MAPS --row 1 --overwrite", "--overwrite: has no effect without -o"),
    ("inspect CAPTURE --pixel 1,1 --overwrite", "--overwrite: has no effect without -o"),
    ("compare MAPS MAPS --overwrite", "--overwrite: has no effect without -o"),
    ("evaluate MAPS --truth MAPS/frame_0.tif --overwrite", "--overwrite: has no effect without --csv or --over-time"),
    ("info MAPS --periods-ns 40,20", "--periods: has no effect without a capture as INPUT"),
    ("info MAPS --settings CAPTURE/capture.toml", "--settings: has no effect without a capture as INPUT"),
    ("simulate --f1-hz 5", "--f1: has no effect with --stages dc"),
    ("simulate --cycles 10", "--cycles: has no effect without --photons"),
    ("sweep --asr 5 --mpi 0 --runs 2 --photons-per-cycle 10", "--photons-per-cycle: has no effect without --photons"),
    ("simulate --frame-rate 60", "--frame-rate: has no effect without --speed"),
    ("simulate --scene wall -o new --frame-rate 60", "--frame-rate: has no effect without --speed"),
    ("simulate --speed 0 --frame-rate 60", "--frame-rate: has no effect without --speed"),
    ("simulate --mpi 0 --second 20", "--second: has no effect with --mpi 0"),
    ("sweep --asr 5 --mpi 0 --runs 2 --second 20", "--second: has no effect with --mpi 0"),
    ("resolve CAPTURE --order 1 --return last", "--return: has no effect with one path per pixel"),
    ("resolve CAPTURE --solver lm --paths 1 --starts 5", "--starts: has no effect with one path per pixel"),
    (
        "inspect CAPTURE --pixel 1,1 --solver one-path --min-return-ratio .2",
        "--min-return-ratio: has no effect with one path per pixel",
    ),
    (
        "resolve CAPTURE --order 2 --min-confidence .001 --false-alarm .1",
        "--false-alarm: has no effect with --min-confidence and a given number of paths",
    ),
    ("resolve CAPTURE --distance 1", "--distance: has no effect on maps; `cadtof calibrate` uses it"),
    ("resolve CAPTURE --jobs 1 --start-method spawn", "--start-method: has no effect with a single process"),
    ("resolve CAPTURE --pool 3 --pool 1", "--pool: given 2 times; only the last one has an effect"),
    (
        "profile MAPS --row 1 --first-phasor --no-first-phasor",
        "--first-phasor: given 2 times; only the last one has an effect",
    ),
]

KEYS_WITHOUT_EFFECT: list[tuple[Form, str, str]] = [
    ("exr", "[layout]\nframes = 3", "layout.frames has no effect: EXR files are no stacks"),
    (
        "tif",
        '[layout.raw]\ndtype = "uint16"\nshape = [2, 2, 24, 32]',
        "layout.raw_dtype and layout.raw_shape have no effect on TIFF files",
    ),
    (
        "tif",
        "[optics]\nprincipal_point_px = [3.0, 3.0]",
        "optics.principal_point_px has no effect on maps without optics.focal_length_px",
    ),
]


def _run(line: str, capture: Path, maps: Path) -> tuple[int, str, str]:
    words = {"CAPTURE": str(capture), "MAPS": str(maps)}
    arguments = [re.sub("CAPTURE|MAPS", lambda one: words[one[0]], word) for word in line.split()]
    if arguments[0] == "resolve":
        arguments += ["-o", "new_maps"]
    done = cadtof(*arguments)
    return done.status, done.out, done.err


@pytest.mark.parametrize(("line", "message"), WITHOUT_EFFECT)
def test_options_without_effect_are_named(
    line: str, message: str, capture: Path, maps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A user who types an option expects an effect. Scripts that give the same options to every run go on."""
    monkeypatch.chdir(tmp_path)
    status, _, err = _run(line, capture, maps)
    assert status == (2 if "--scheduler" in line else 0)
    first_line = err.splitlines()[0]
    assert first_line.startswith(message)


@pytest.mark.parametrize(("form", "text", "message"), KEYS_WITHOUT_EFFECT)
def test_keys_without_effect_are_named(form: Form, text: str, message: str, tmp_path: Path) -> None:
    folder = record(tmp_path / "capture", form=form).folder
    known = (folder / "capture.toml").read_text()
    (folder / "capture.toml").write_text(re.sub(r"\[optics\]\n(.+\n)*", "", known) + "\n" + text)
    done = cadtof("resolve", folder, "-o", tmp_path / "maps", "-j", 1)
    assert done.status == 0
    assert f"{folder}: {message}\n" in done.err


def test_keys_of_planes_without_effect_are_named(tmp_path: Path) -> None:
    """A third period that `periods_ns` does not name was left out, though its files had a name in `layout.harmonic`."""
    capture = record(tmp_path / "capture")
    planes = tifffile.imread(capture.files[0]).reshape(4, 24, 32)
    for place, plane in enumerate(planes):
        tifffile.imwrite(capture.folder / f"a_{'xy'[place // 2]}_{place % 2 + 1}.tif", plane)
    capture.files[0].unlink()
    layout = ("--pattern", "{frame}_{harmonic}_{channel}.tif", "--harmonic", "x=1,y=2,z=3", "--stack-frames", 3)
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "maps", "-j", 1, *layout)
    assert done.status == 0
    assert f"{capture.folder}: layout.frames has no effect: TIFF files of one plane are no stacks\n" in done.err
    assert f"{capture.folder}: layout.harmonic.z has no effect: modulation.periods_ns has no such period\n" in done.err


def test_covered_frames_have_no_light_to_be_described(tmp_path: Path) -> None:
    dark = write(tmp_path / "dark", camera(), covered(camera(), count=2))
    done = cadtof("calibrate", "dark", dark, "-o", tmp_path / "calibration", "--fwhm-ns", 2, "--focal-length", 30)
    assert done.status == 0
    assert done.err.startswith(
        "--fwhm: has no effect on a dark calibration\n--focal-length: has no effect on a dark calibration\n"
    )


@pytest.mark.parametrize("order", ["-q -j 99", "-j 99 -q"])
def test_quiet_is_quiet_wherever_it_stands(order: str) -> None:
    assert cadtof("simulate", "--runs", 2, *order.split()).err == ""


def test_the_kernel_of_a_cluster_is_chosen_where_its_workers_start(
    capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """This command said that numpy resolved the frames, while the workers used their compiled kernel."""
    monkeypatch.setenv("CADTOF_KERNEL", "numpy")
    done = cadtof("resolve", capture, "-o", tmp_path / "maps", "--scheduler", "tcp://127.0.0.1:9")
    assert "CADTOF_KERNEL: has no effect with --scheduler, whose workers are started elsewhere\n" in done.err
    assert "by numpy" not in done.err


def test_a_first_phasor_that_is_asked_for_and_unknown_is_named(maps: Path, tmp_path: Path) -> None:
    alone = tmp_path / "frame_0.tif"
    alone.write_bytes((maps / "frame_0.tif").read_bytes())
    assert cadtof("profile", alone, "--row", 1).err == ""
    done = cadtof("profile", alone, "--row", 1, "--first-phasor")
    assert done.err == "no run.json beside the maps, so the first phasor is left out\n"


def test_optics_that_make_no_point_cloud_are_named(maps: Path, tmp_path: Path) -> None:
    alone = tmp_path / "frame_0.tif"
    alone.write_bytes((maps / "frame_0.tif").read_bytes())
    done = cadtof("report", alone, "-o", tmp_path / "page.html", "--principal-point", "3,4")
    assert done.status == 0
    assert "no point cloud is shown: that needs --focal-length-px, and for maps of a --roi also" in done.err


def test_frames_too_small_for_a_tail_are_counted(
    capture: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    done = cadtof("resolve", capture, "-o", tmp_path / "maps", "-j", 1, "--mpi-model", "diffuse")
    words = "has no effect on 1 frame with enough light in too few places; all MPI there is taken for separate paths"
    assert (done.status, f"--mpi-model diffuse: {words}\n" in done.err) == (0, True)
    resolve(next(read_frames(capture)), mpi_model="diffuse")
    assert "frame_0.tif: mpi_model has no effect, because the frame has enough light in too few places" in caplog.text


def test_quiet_runs_do_not_name_options_without_effect(capture: Path, tmp_path: Path) -> None:
    done = cadtof("resolve", capture, "-o", tmp_path / "maps", "-j", 1, "-q", "--starts", 5)
    assert (done.status, done.err) == (0, "")


@pytest.mark.parametrize("quiet", [(), ("-q",)])
def test_the_log_names_options_without_effect(quiet: tuple[str, ...], capture: Path, tmp_path: Path) -> None:
    log, options = tmp_path / "log", ("--starts", 5, "--pool", 3, "--pool", 1, "-j", 999)
    assert cadtof("resolve", capture, "-o", tmp_path / "maps", "--log", log, *options, *quiet).status == 0
    for line in (
        "--jobs 999: at most ",
        "--pool: given 2 times; only the last one has an effect",
        "--starts: has no effect with --solver two-path",
    ):
        assert log.read_text().count(f" {line}") == 1


def test_info_refuses_out_without_write_settings(capture: Path, tmp_path: Path) -> None:
    """A user who asks for a file would mistake an older file of this name for it."""
    done = cadtof("info", capture, "-o", tmp_path / "new.toml")
    assert done.status == 2
    assert done.err.startswith("Error: --out: has no effect without --write-settings; leave it out")
    assert not list(tmp_path.iterdir())


def test_info_writes_no_settings_of_maps(maps: Path) -> None:
    done = cadtof("info", maps, "--write-settings")
    assert done.status == 2
    assert "--write-settings: found 0 captures, expected one or more" in done.err


IMPOSSIBLE = [
    ("resolve CAPTURE --channel A,B", "--channel: layout.channel: found ['A', 'B'], expected layout.pattern beside it"),
    (
        "resolve CAPTURE --harmonic a=1,b=2",
        "--harmonic: layout.harmonic: found {'a': 1, 'b': 2}, expected layout.pattern",
    ),
    (
        "resolve CAPTURE --raw-shape 2,2,24,32",
        "--raw-shape: layout.raw_shape: found [2, 2, 24, 32], expected layout.raw_d",
    ),
    (
        "info CAPTURE --raw-offset-bytes 4",
        "--raw-offset-bytes: layout.raw_offset_bytes: found 4, expected layout.raw_dtype",
    ),
    (
        "resolve CAPTURE --integration-length 1e5,2e5,3e5",
        "--integration-length: pixel.integration_length: found [100000.0, 200000.0, 300000.0], expected one number, or 2",
    ),
    (
        "resolve CAPTURE --integration-length 1e5,0.5",
        "--integration-length: pixel.integration_length: found 0.5, expected a finite number above 1",
    ),
    ("resolve CAPTURE --pool 257", "--pool: found 257, expected an odd number of pixels such as 3 or 5, at most 255"),
    (f"resolve CAPTURE --average {10**20}", "--average: found 100000000000000000000, expected 1 to 1000000 frames"),
    ("resolve CAPTURE --frame-timeout inf", "--frame-timeout: found inf, expected seconds above 0, at most 1e+08"),
    ("resolve CAPTURE --frame-timeout 1e300", "--frame-timeout: found 1e+300, expected seconds above 0"),
    ("evaluate MAPS --truth MAPS --max-median nan", "--max-median: found nan, expected centimetres, 0 or more"),
    ("preview MAPS -o a.png --frame -1", "--frame: found -1, expected 0 or more"),
    ("profile MAPS --row 1 --frame -1", "--frame: found -1, expected 0 or more"),
    ("simulate --asr 1e300", "ASR: found 1e+300, expected a ratio from 0 to 1e+12"),
    ("simulate --mpi 1e300", "MPI ratio: found 1e+300, expected a ratio from 0 to 1e+12"),
    ("simulate --scene card --asr 1e300 -o new", "ASR: found 1e+300, expected a ratio from 0 to 1e+12"),
    ("simulate --jitter 1e9", "jitter: found 1e+09 ns, expected 0 to less than 20 ns"),
    (
        "sweep -o -",
        "-o: found -, expected a name; commands that can write to stdout do so without -o",
    ),
    (
        "sweep --out=-",
        "--out: found -, expected a name; commands that can write to stdout do so without --out",
    ),
    ("sweep -o-", "-o: found -, expected a name"),
    ("evaluate MAPS --truth MAPS --csv -", "--csv: found -, expected a name"),
    ("evaluate MAPS --over-time -", "--over-time: found -, expected a name"),
    ("simulate --scene wall --seed -1 -o new", "seed: found -1, expected 0 or more"),
    ("report CAPTURE -o a.html", "CAPTURE/"),
]


@pytest.mark.parametrize(("line", "message"), IMPOSSIBLE)
def test_impossible_values_are_refused(
    line: str, message: str, capture: Path, maps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = _run(line, capture, maps)
    assert (status, out) == (1 if line.startswith("report") else 2, "")
    assert message.replace("CAPTURE", str(capture)) in err
    assert "unexpected" not in err
    assert not list(tmp_path.iterdir())


def test_frames_beyond_any_capture_are_none(capture: Path, tmp_path: Path) -> None:
    """`0:10…0` means all frames, `10…0:` none, with any number of digits.

    A run that ends with status 1 says why, with --quiet too.
    """
    everything = cadtof("resolve", capture, "-o", tmp_path / "all", "-j", 1, "-q", "--frames", f"0:{10**30}")
    assert (everything.status, everything.err) == (0, "")
    nothing = cadtof("resolve", capture, "-o", tmp_path / "none", "-j", 1, "-q", "--frames", f"{10**30}:")
    assert nothing.status == 1
    assert nothing.err == "no frame was resolved: no capture has a frame in the range of --frames\n"


def test_a_map_says_itself_that_its_depths_are_planar(capture: Path, tmp_path: Path) -> None:
    """A map that was copied out of its run's folder still says that it holds z depth.

    So it is not taken for ranges without the optics, and not exported as a range.
    """
    assert cadtof("resolve", capture, "-o", tmp_path / "run", "-j", 1, "-q", "--depth", "z", *FOCAL).status == 0
    (tmp_path / "alone").mkdir()
    (inside,) = (tmp_path / "run").glob("frame_*")
    alone = inside.rename(tmp_path / "alone" / inside.name)
    assert cadtof("resolve", capture, "-o", tmp_path / "range", "-j", 1, "-q").status == 0
    truth = tmp_path / "range" / inside.name
    refused = cadtof("evaluate", alone, "--truth", truth)
    assert refused.status == 2
    assert f"{truth}: holds radial range and {alone} planar depth z, and no run.json tells the optics" in refused.err
    cloud = tmp_path / "alone.ply"
    assert cadtof("export", alone, "-o", cloud, *FOCAL).status == 0
    body = cloud.read_bytes().split(b"end_header\n", 1)[1]
    depth = layers_of(alone)["direct.depth"]
    point = np.dtype([(name, "<f4") for name in ("x", "y", "z", "amplitude", "sigma")] + [("status", "<u4")])
    forward = np.frombuffer(body, point)["z"]
    np.testing.assert_array_equal(forward, depth[np.isfinite(depth)])
    unknown = cadtof("export", alone, "-o", tmp_path / "no.png", "--depth", "range")
    assert unknown.status == 2
    assert "its optics are unknown" in unknown.err


def test_maps_that_serve_as_truth_say_what_they_hold(capture: Path, tmp_path: Path) -> None:
    """A run of longer exposure may be the truth of another run; other pixels gave errors of decimetres."""
    resolve = ("resolve", capture, "-j", 1, "-q", *FOCAL)
    for name, options in (
        ("range", ()),
        ("z", ("--depth", "z")),
        ("a", ("--roi", "0,0,6,5")),
        ("b", ("--roi", "2,1,8,6")),
    ):
        assert cadtof(*resolve, "-o", tmp_path / name, *options).status == 0
    (frame,) = (path.name for path in (tmp_path / "range").glob("frame_*"))

    def refusals(maps: str, truth: str) -> set[str]:
        given = (tmp_path / maps, "--truth", tmp_path / truth / frame)
        tried = [
            cadtof("evaluate", *given),
            cadtof("profile", *given, "--row", 1),
            cadtof("preview", *given, "-o", tmp_path / f"{maps}_{truth}.png"),
            cadtof("report", *given, "-o", tmp_path / f"{maps}_{truth}.html"),
        ]
        assert len({done.status for done in tried}) == 1
        return {done.err for done in tried if done.status}

    (other_part,) = refusals("a", "b")
    assert f"a shows pixels 0,0,6,5 and {tmp_path / 'b' / frame} 2,1,8,6: resolve both with" in other_part
    for maps, truth in (("range", "range"), ("a", "a"), ("b", "range"), ("range", "z"), ("z", "range"), ("z", "z")):
        assert refusals(maps, truth) == set()


@pytest.mark.parametrize("width", [1, 2])
@pytest.mark.parametrize("height", [1, 5])
@pytest.mark.parametrize("form", ["tif", "exr"])
def test_frames_of_one_column_or_row(width: int, height: int, form: str, tmp_path: Path) -> None:
    """`resolve` reads what `simulate` records, however few pixels it has."""
    size = ("--distance", 1, "--width", width, "--height", height, "--format", form)
    assert cadtof("simulate", "--scene", "wall", *size, "-q", "-o", tmp_path / "wall").status == 0
    assert cadtof("resolve", tmp_path / "wall", "-o", tmp_path / "maps", "-j", 1, "-q").status == 0
    depth = layers_of(next((tmp_path / "maps").glob("frame_*")))["direct.depth"]
    truth = layers_of(tmp_path / "wall" / "truth.exr")["direct.depth"]
    assert depth.shape == truth.shape == (height, width)
    assert np.abs(depth - truth).max() < 0.1


def test_a_run_without_maps_names_no_place_for_them(capture: Path, tmp_path: Path) -> None:
    done = cadtof("resolve", capture, "-o", tmp_path / "out", "-j", 1, "--min-confidence", 1e9)
    assert done.status == 1
    assert done.err.endswith(f"s; 1 failed, see {tmp_path / 'out' / 'frames.jsonl'}\n")


def test_different_parts_of_the_pixels_are_not_compared(capture: Path, tmp_path: Path) -> None:
    """Two parts have the same size, but show different pixels of the frame."""
    for name, roi in (("a", "0,0,6,5"), ("b", "2,1,8,6")):
        assert cadtof("resolve", capture, "-o", tmp_path / name, "-j", 1, "-q", "--roi", roi).status == 0
    refused = cadtof("compare", tmp_path / "a", tmp_path / "b")
    assert refused.status == 2
    assert "shows pixels 0,0,6,5 and " in refused.err
    assert refused.err.endswith(" 2,1,8,6: resolve both with the same --roi\n")


@pytest.mark.parametrize("command", ["calibrate dark", "calibrate response", "calibrate petzval", "resolve", "info"])
def test_commands_without_their_inputs_name_what_is_missing(command: str, tmp_path: Path) -> None:
    options = () if command == "info" else ("-o", tmp_path / "out")
    done = cadtof(*command.split(), *options)
    assert done.status == 2
    assert "Error: Missing argument '" in done.err
    assert not (tmp_path / "out").exists()
