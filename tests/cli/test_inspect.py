"""`cadtof inspect`: what it says of a pixel agrees with the map of `resolve`, the file and the recorded light."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.text import Annotation

from cadtof_cli.figures import phasor_diagram
from tests.support.captures import (
    TOML,
    VOLTS_PER_COUNT,
    ZERO_COUNTS,
    Form,
    layers_of,
    record,
    write_exr,
    write_frame,
    write_pages,
)
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, T1_NS, Light, depth_m, phasors_of
from tests.support.run_cadtof import ROOT, cadtof

DATA = ROOT / "sample_data"


def _inspected(frame: Path, x: int, y: int, *options: object) -> dict[str, Any]:
    done = cadtof("inspect", frame, "--pixel", f"{x},{y}", "--json", "-q", *options)
    assert (done.status, done.err) == (0, "")

    def refuse(constant: str) -> None:
        pytest.fail(f"{constant} is no JSON")

    found: dict[str, Any] = json.loads(done.out, parse_constant=refuse)
    return found


def _maps(capture: Path, out: Path, *options: object) -> list[Path]:
    assert cadtof("resolve", capture, "-o", out, "-j", 1, "-q", *options).status == 0
    return sorted(path for path in out.iterdir() if path.suffix in {".tif", ".exr"})


def _require_same_bits(chosen: dict[str, Any], file: Path, x: int, y: int) -> None:
    layers = layers_of(file)
    assert set(chosen) == set(layers)
    for name, plane in layers.items():
        value = plane[y, x]
        if name == "status":
            assert chosen[name] == int(value)
        elif np.isnan(value):
            assert chosen[name] is None, name
        else:
            assert np.float32(chosen[name]).tobytes() == value.tobytes(), name
            assert float(np.float32(chosen[name])) == chosen[name]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("corner", ()),
        ("corner", ("--mpi-model", "discrete", "--pool", "3")),
        ("corner", ("--depth", "z")),
        ("card", ()),
        ("card", ("--order", "2", "--return", "strongest")),
        ("wall", ("--solver", "one-path")),
        ("wall", ("--solver", "lm", "--order", "2", "--starts", "2")),
    ],
)
def test_the_chosen_answer_is_that_of_the_map(name: str, options: tuple[str, ...], tmp_path: Path) -> None:
    (file, *_) = _maps(DATA / name, tmp_path / "out", *options)
    width, height = layers_of(file)["status"].shape[::-1]
    for x, y in ((0, 0), (width // 2, height // 2), (width - 1, height - 3), (width // 3, height // 4)):
        found = _inspected(DATA / name, x, y, *options)
        assert found["pixel"] == [x, y]
        _require_same_bits(found["chosen"], file, x, y)


def test_frames_of_a_stack_and_means_are_found_by_their_place(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=5)
    files = _maps(capture.folder, tmp_path / "out", "--average", "2")
    assert len(files) == 3
    for place, file in enumerate(files):
        found = _inspected(capture.folder, 20, 7, "--average", "2", "--frame", place)
        _require_same_bits(found["chosen"], file, 20, 7)
        assert found["noise"]["averaged_pixels"] == min(2, 5 - 2 * place)
    (lone, *_) = _maps(capture.files[3], tmp_path / "lone")
    found = _inspected(capture.files[3], 20, 7)
    _require_same_bits(found["chosen"], lone, 20, 7)
    assert found["frame"] == str(capture.files[3])
    for beyond in (5, 10**20):
        done = cadtof("inspect", capture.folder, "--pixel", "1,1", "--frame", beyond)
        assert (done.status, done.out) == (2, "")
        assert done.err.startswith(f"Error: --frame: found {beyond}, expected 0 … 4: a run on")


def test_voltages_and_phasors_are_those_of_the_file(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    found = _inspected(capture.files[0], 25, 3)
    volts = VOLTS_PER_COUNT * (tifffile.imread(capture.files[0])[:, 3, 25].astype(float) - ZERO_COUNTS).reshape(2, 2)
    np.testing.assert_allclose(found["voltages_v"], volts, rtol=1e-12)
    phasors = phasors_of(volts[:, :, np.newaxis] / AMPLITUDE_V)[:, 0]
    np.testing.assert_allclose(found["phasors"], np.stack([phasors.real, phasors.imag], axis=1), rtol=1e-9)
    # the noise of light with MPI 0.3 at ASR 2 and n_av 1e5
    light = Light(asr=2.0, mpi=0.3, direct_ns=12.0, second_ns=20.0)
    for row, h in enumerate((1, 2)):
        pulse = abs(phasors[row]) / abs(np.hypot(*volts[row]) / AMPLITUDE_V)
        sigma = AMPLITUDE_V * np.sqrt(np.diag(light.covariance(h, 1e5))) * pulse
        np.testing.assert_allclose(found["noise"]["sigma_v"][row], sigma, rtol=0.02)


def test_two_paths_one_path_and_the_test_between_them(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form="exr")
    light = Light(asr=2.0, mpi=0.3, direct_ns=12.0, second_ns=20.0)
    exact = np.stack([[light.moment(h).real, light.moment(h).imag] for h in (1, 2)])
    volts = np.broadcast_to(AMPLITUDE_V * exact[:, :, np.newaxis, np.newaxis], (2, 2, 24, 32))
    # no camera records the same value in all pixels
    volts = volts + np.linspace(-1e-6, 1e-6, 24 * 32).reshape(24, 32)
    volts[:, :, 5, 4] = AMPLITUDE_V * exact
    file = capture.folder / "exact.exr"
    write_exr(
        file,
        dict(zip(("H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2"), volts.reshape(4, 24, 32).astype(np.float32), strict=True)),
    )
    found = _inspected(file, 4, 5)
    for name, delay, share in (("direct", 12.0, 1.0), ("mpi", 20.0, 0.3)):
        path = found["two_paths"][name]
        assert path["depth_m"] == pytest.approx(depth_m(delay), abs=2e-5)
        assert path["amplitude_v"] == pytest.approx(AMPLITUDE_V * share / 3.3, rel=1e-4)
        assert path["sigma_m"] == pytest.approx(found["chosen"][f"{name}.sigma"], rel=1e-6)
    assert found["status"] == ["two paths"]
    assert found["order_test"]["threshold"] == pytest.approx(-2 * np.log(0.01))
    assert found["order_test"]["chi_squared"] == found["one_path"]["chi_squared"] > 100
    moved = abs(found["one_path"]["depth_m"] - found["two_paths"]["direct"]["depth_m"])
    assert found["order_test"]["moved_m"] == pytest.approx(moved, rel=1e-6)
    assert found["order_test"]["worth_another"] is True
    assert (
        found["order_test"]["verdict"]
        == "one path does not explain the phasors, and a second one reduces the error of the direct path"
    )
    alone = _inspected(capture.files[0], 3, 3, "--false-alarm", 1e-6)
    assert alone["status"] == ["one path"]
    assert alone["one_path"]["depth_m"] == pytest.approx(alone["chosen"]["direct.depth"], rel=1e-6)
    assert alone["one_path"]["sigma_m"] == pytest.approx(alone["chosen"]["direct.sigma"], rel=1e-6)
    assert alone["order_test"]["chi_squared"] <= alone["order_test"]["threshold"] == pytest.approx(27.63, abs=0.01)
    assert alone["chosen"]["mpi.depth"] is None


def test_one_path_is_rejected_if_it_is_far_from_the_phasors() -> None:
    found = _inspected(DATA / "card" / "frame_0000.exr", 160, 120)
    assert found["status"] == ["two paths"]
    assert found["order_test"]["moved_m"] < found["order_test"]["needed_m"]
    assert found["order_test"]["verdict"].startswith("one path is far from explaining the phasors")


def test_the_tail_of_a_corner() -> None:
    """H₁ is the first phasor over that of the direct light: its phase is the lag, which is the depth that MPI adds."""
    found = _inspected(DATA / "corner", 60, 60)
    tail = found["diffuse"]["tail"]
    assert (found["status"], found["diffuse"]["model"]) == (["diffuse MPI"], "diffuse")
    first = (np.arctan2(*reversed(found["phasors"][0])) % (2 * np.pi)) * C_M_PER_NS * T1_NS / (4 * np.pi)
    assert tail["pulled_back_m"] == pytest.approx(first - found["chosen"]["direct.depth"], abs=1e-6)
    ratio = found["chosen"]["confidence"] / found["chosen"]["direct.amplitude"]
    assert tail["amplitude_ratio"] == pytest.approx(ratio, rel=1e-5)
    assert 0.0 < tail["chi_squared"] < 30.0
    assert 0.0 < found["diffuse"]["room"]["albedo"][0] < 1.0
    assert found["order_test"]["verdict"] == "not tested: the MPI is a tail"
    apart = _inspected(DATA / "corner", 60, 60, "--mpi-model", "discrete")
    assert (apart["diffuse"], apart["two_paths"]["direct"]) == (None, found["two_paths"]["direct"])


def test_the_tail_of_a_corner_in_z_depth() -> None:
    """All distances of a pixel are planar: the first phasor is too far by its own depth minus the direct depth."""
    found = _inspected(DATA / "corner", 20, 20, "--depth", "z")
    first = (np.arctan2(*reversed(found["phasors"][0])) % (2 * np.pi)) * C_M_PER_NS * T1_NS / (4 * np.pi)
    planar = first / np.sqrt(1.0 + ((20 - 159.5) ** 2 + (20 - 119.5) ** 2) / 280.0**2)
    tail = found["diffuse"]["tail"]
    assert tail["pulled_back_m"] == pytest.approx(planar - found["chosen"]["direct.depth"], abs=1e-6)


def test_neighbours_and_the_edge_of_the_frame(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    (file,) = _maps(capture.folder, tmp_path / "out")
    depth = layers_of(file)["direct.depth"]
    inside = _inspected(capture.files[0], 10, 9)["neighbours_m"]
    np.testing.assert_array_equal(np.array(inside, np.float32), depth[7:12, 8:13])
    corner = _inspected(capture.files[0], 31, 0)["neighbours_m"]
    assert [row[2] for row in corner[:2]] == [None, None]
    assert [value is None for value in corner[2]] == [False, False, False, True, True]
    np.testing.assert_array_equal(np.array(corner[4][:3], np.float32), depth[2, 29:32])


def test_a_pixel_without_an_answer_still_shows_what_is_known(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    pages = tifffile.imread(capture.files[0])
    pages[0, 5, 6] = 16383
    tifffile.imwrite(capture.files[0], pages, photometric="minisblack", metadata=None)
    found = _inspected(capture.files[0], 6, 5)
    assert found["status"] == ["saturated"]
    assert found["voltages_v"][0][0] == pytest.approx(VOLTS_PER_COUNT * (16383 - ZERO_COUNTS))
    assert found["one_path"]["amplitude_v"] > 0.0
    assert {value for name, value in found["chosen"].items() if name != "status"} == {None}
    volts = np.full((2, 2, 24, 32), 0.01)
    volts[0, 1, 2, 3] = np.nan
    (tmp_path / "nan").mkdir()
    (tmp_path / "nan" / "capture.toml").write_text("[pixel]\nintegration_length = 100000\n")
    write_frame(tmp_path / "nan" / "a.exr", volts)
    found = _inspected(tmp_path / "nan" / "a.exr", 3, 2, "-o", tmp_path / "nan.png")
    assert (found["status"], found["one_path"], found["two_paths"]) == (["not finite"], None, None)
    assert found["voltages_v"][0][1] is None
    assert (tmp_path / "nan.png").stat().st_size > 1000
    volts[:, :, 2, 3] = 0.0
    write_frame(tmp_path / "nan" / "a.exr", volts)
    found = _inspected(tmp_path / "nan" / "a.exr", 3, 2)
    assert (found["status"], found["chosen"]["direct.depth"]) == (["low confidence"], None)


def test_the_table_shows_the_values_of_the_json(tmp_path: Path) -> None:
    frame, place = DATA / "card" / "frame_0000.exr", ("--pixel", "80,60")
    done = cadtof("inspect", frame, *place, "-q")
    found = _inspected(frame, 80, 60)
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0] == f"{frame}, pixel 80,60: {', '.join(found['status'])}"
    rows = {line[2:24].strip(): line[24:] for line in lines if line.startswith("  ")}
    depth, unit = rows["direct.depth"].split()
    assert unit == "m"
    assert float(depth) == pytest.approx(found["chosen"]["direct.depth"], rel=1e-5)
    assert rows["status"] == f"{found['chosen']['status']} ({', '.join(found['status'])})"
    assert f"{1000 * found['voltages_v'][0][0]:.3f} mV" in rows["harmonic 1"]
    assert f"{found['one_path']['depth_m']:.4f} m" in rows["one path"]
    assert len(lines[-1].split()) == 5


def test_a_pixel_is_drawn_as_phasors_with_paths_and_noise(tmp_path: Path) -> None:
    done = cadtof("inspect", DATA / "corner", "--pixel", "9,9", "-q", "-o", tmp_path / "a.svg")
    assert (done.status, done.err) == (0, "")
    drawn = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert drawn.count("#1b6ca8") >= 2  # the direct path, in the panel of each harmonic
    assert drawn.count("#d1495b") >= 2  # the MPI
    assert drawn.count("#e08a00") >= 4  # one and two standard deviations
    assert cadtof("inspect", DATA / "corner", "--pixel", "9,9", "-q", "-o", tmp_path / "a.png").status == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG\r\n")
    done = cadtof("inspect", DATA / "corner", "--pixel", "9,9", "-q", "-o", tmp_path / "gone" / "a.png")
    assert (done.status, done.out) == (2, "")
    assert "cannot be written" in done.err


@pytest.mark.parametrize("length", [1e6, 200])
def test_arrows_of_all_paths_end_at_the_recorded_phasor_and_ellipses_lie_in_the_panel(
    length: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photons = ((1.0, 5.0), (0.6, 13.0), (0.4, 21.0))
    phasors = [sum(a * np.exp(2j * np.pi * h * ns / T1_NS) for a, ns in photons) / 8.0 for h in (1, 2, 3)]
    exact = np.array([(one.real, one.imag) for one in phasors])[:, :, np.newaxis, np.newaxis]
    scatter = np.random.default_rng(5).standard_normal((3, 2, 12, 16))
    np.save(tmp_path / "a.npy", AMPLITUDE_V * (exact + 1e-4 * scatter))
    modulation = f"periods_ns = [40.0, 20.0, 13.3333]\namplitude_v = {AMPLITUDE_V}\nwaveform = 'sine'"
    rest = f"[pixel]\nintegration_length = {length}\n[pulse]\nfwhm_ns = 0.0\n"
    (tmp_path / "capture.toml").write_text(f"[modulation]\n{modulation}\n{rest}")
    drawn: list[Figure] = []
    monkeypatch.setattr(phasor_diagram, "save", lambda figure, *_, **__: drawn.append(figure))
    found = _inspected(tmp_path / "a.npy", 8, 6, "--paths", 3, "--order", 3, "-o", tmp_path / "a.png")
    assert found["status"][-1] == "more paths"
    panels = drawn[0].axes
    assert len(panels) == 3
    for axes, recorded in zip(panels, found["phasors"], strict=True):
        recorded_arrow, *paths = [one for one in axes.texts if isinstance(one, Annotation)]
        assert recorded_arrow.xy == pytest.approx(recorded)
        assert len(paths) == 3
        assert paths[-1].xy == pytest.approx(recorded, abs=1e-6)
        ellipses = [one for one in axes.patches if isinstance(one, Ellipse)]
        assert len(ellipses) == 2
        for ellipse in ellipses:
            outline = ellipse.get_patch_transform().transform(ellipse.get_path().vertices)
            assert np.abs(outline).max() < axes.get_xlim()[1]


def test_the_arrow_of_a_tail_ends_at_the_recorded_phasor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(phasor_diagram, "save", lambda figure, *_, **__: drawn.append(figure))
    found = _inspected(DATA / "corner", 60, 60, "-o", tmp_path / "a.png")
    assert found["status"] == ["diffuse MPI"]
    for axes, recorded in zip(drawn[0].axes, found["phasors"], strict=True):
        _, direct, tail = [one for one in axes.texts if isinstance(one, Annotation)]
        assert tail.xy == pytest.approx(recorded)
        assert tail.xyann == pytest.approx(direct.xy)


def test_arrows_of_triangle_waves_end_at_the_recorded_phasor_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Arrows of a sine would end several hundredths beside it."""
    made = cadtof("simulate", "--scene", "card", "--waveform", "triangle", "-o", tmp_path / "card", "-q")
    assert made.status == 0
    drawn: list[Figure] = []
    monkeypatch.setattr(phasor_diagram, "save", lambda figure, *_, **__: drawn.append(figure))
    found = _inspected(tmp_path / "card" / "frame_0000.tif", 160, 120, "-o", tmp_path / "a.png")
    assert found["status"] == ["two paths"]
    for axes, recorded in zip(drawn[0].axes, found["phasors"], strict=True):
        _, *paths = [one for one in axes.texts if isinstance(one, Annotation)]
        assert paths[-1].xy == pytest.approx(recorded, abs=1e-4)


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_a_map_is_refused_with_the_recorded_frame_to_inspect(form: Form, tmp_path: Path) -> None:
    """The message is one line: it names the recorded frame, and the pixel there, and says nothing about settings."""
    capture, out = record(tmp_path / "capture", frames=2, form=form), tmp_path / "out"
    first, second = _maps(capture.folder, out, "--roi", "4,2,20,12")
    for what, place, recorded in ((first, 0, 0), (second, 0, 1), (out, 1, 1)):
        done = cadtof("inspect", what, "--pixel", "3,3", "--frame", place)
        assert (done.status, done.out) == (1, "")
        (message,) = done.err.splitlines()
        assert message.startswith(f"Error: {(first, second)[recorded]}: holds ")
        expected = f"; inspect the recorded frame: {capture.files[recorded]}; pixel 0,0 of the maps is 4,2 there"
        assert message.endswith(expected)
    (out / "run.json").unlink()
    done = cadtof("inspect", first, "--pixel", "3,3")
    assert done.status == 1
    (message,) = done.err.splitlines()
    assert "recorded frame" not in message


def test_maps_of_stacks_means_and_planes_name_the_recorded_frame(tmp_path: Path) -> None:
    pages = [tifffile.imread(file) for file in record(tmp_path / "capture", frames=3).files]
    for name, toml in (
        ("stack", "[layout]\nframes = 3\n"),
        ("planes", '[layout]\npattern = "{frame}_{harmonic}{channel}.tif"\n'),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "capture.toml").write_text(TOML["tif"] + toml)
    write_pages(tmp_path / "stack" / "a.tif", np.concatenate(pages))
    for frame, planes in enumerate(pages):
        for place, plane in enumerate(planes):
            write_pages(tmp_path / "planes" / f"f{frame}_{1 + place // 2}{1 + place % 2}.tif", plane)
    for name, options, map_index, expected in (
        ("stack", (), 2, f"the recorded frame: {tmp_path / 'stack' / 'a.tif'} --frame 2"),
        ("stack", ("--average", "2"), 1, f"the recorded frame: {tmp_path / 'stack' / 'a.tif'} --frame 2"),
        (
            "stack",
            ("--average", "2"),
            0,
            f"the first of the 2 recorded frames: {tmp_path / 'stack' / 'a.tif'} --frame 0",
        ),
        ("planes", (), 1, f"the recorded frame: {tmp_path / 'planes'} --frame 1"),
    ):
        file = _maps(tmp_path / name, tmp_path / f"{name}{len(options)}", "--overwrite", *options)[map_index]
        message = cadtof("inspect", file, "--pixel", "3,3").err
        assert message.rstrip().endswith(f"; inspect {expected}")
        if not options:
            _require_same_bits(_inspected(*_inspect_arguments(expected))["chosen"], file, 3, 3)


def _inspect_arguments(message: str) -> tuple[Any, ...]:
    path, _, place = message.partition(": ")[2].partition(" --frame ")
    return Path(path), 3, 3, "--frame", place


def test_impossible_pixels_and_frames_are_refused(tmp_path: Path) -> None:
    frame = record(tmp_path / "capture").files[0]
    for arguments, message in (
        ((frame, "--pixel", "32,0"), "--pixel: found 32,0, expected a column 0 … 31 and a row 0 … 23 of"),
        ((frame, "--pixel", "0,-1"), "--pixel: found 0,-1, expected a column 0 … 31 and a row 0 … 23 of"),
        ((frame, "--pixel", "here"), "'here' is not a column and a row such as 160,120"),
        ((frame,), "Missing option '--pixel'"),
        ((tmp_path / "gone.tif", "--pixel", "1,1"), "no such file or folder; expected a capture folder or a frame"),
        ((frame, "--pixel", "1,1", "--pool", "2"), "--pool: found 2, expected an odd number of pixels"),
    ):
        done = cadtof("inspect", *arguments)
        assert (done.status, done.out) == (2, "")
        assert message in done.err
