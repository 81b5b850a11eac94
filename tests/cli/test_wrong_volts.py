"""Values that cannot be voltages of the capture are refused, with the likely cause and the option that mends it."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from tests.conftest import Tool
from tests.support.captures import TOML, VOLTS_PER_COUNT, ZERO_COUNTS, record, write_exr, write_pages
from tests.support.run_cadtof import Finished, cadtof


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """The only frame of a sound capture: uint16 counts."""
    return record(tmp_path / "sound").files[0]


def _capture(folder: Path, pages: NDArray[np.generic], *, toml: str = "") -> Path:
    folder.mkdir()
    write_pages(folder / "frame.tif", pages)
    if toml:
        (folder / "capture.toml").write_text(toml)
    return folder


def _refused(folder: Path, *options: str) -> Finished:
    out = folder.parent / f"maps-{folder.name}"
    done = cadtof("resolve", folder, "-o", out, "--jobs", "1", *options)
    assert done.status in (1, 2)
    assert not out.exists() or not list(out.glob("*.tif"))
    return done


def test_the_sound_capture_is_resolved(recorded: Path, tmp_path: Path) -> None:
    assert cadtof("resolve", recorded.parent, "-o", tmp_path / "maps", "--jobs", "1").status == 0


def test_float_counts_without_settings_are_refused(recorded: Path, tmp_path: Path) -> None:
    folder = _capture(tmp_path / "floats", tifffile.imread(recorded).astype("f4"))
    done = _refused(folder)
    assert (
        f"they look like counts: give --volts-per-count and --zero-counts (probably {ZERO_COUNTS:g}, half of 14 bits"
        in done.err
    )
    mended = ("--volts-per-count", f"{VOLTS_PER_COUNT}", "--zero-counts", f"{ZERO_COUNTS}")
    assert cadtof("resolve", folder, "-o", tmp_path / "mended", "--jobs", "1", *mended).status == 0


def test_unsigned_counts_need_their_zero(recorded: Path, tmp_path: Path) -> None:
    folder = _capture(tmp_path / "counts", tifffile.imread(recorded))
    done = _refused(folder, "--volts-per-count", f"{VOLTS_PER_COUNT}")
    assert done.status == 2
    assert "unsigned numbers (uint16), and the stored value of 0 V is unknown: set zero_counts" in done.err
    refused = _refused(folder, "--volts-per-count", f"{VOLTS_PER_COUNT}", "--zero-counts", "0")
    assert f"give --zero-counts (probably {ZERO_COUNTS:g}, half of 14 bits" in refused.err


def test_values_that_are_cut_off_are_reported_until_the_limit_is_given(recorded: Path, tmp_path: Path) -> None:
    pages = tifffile.imread(recorded)
    limit = int(np.quantile(pages, 0.9))
    folder = _capture(tmp_path / "cut", np.minimum(pages, limit), toml=TOML["tif"])
    warning = f" of the pixels hold {limit}, the largest stored value; if the camera or a program cuts values off there"
    done = cadtof("resolve", folder, "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 0
    assert [line.startswith(f"warning: {folder}: ") for line in done.err.splitlines() if warning in line] == [True]
    dark = cadtof("calibrate", "dark", folder, "-o", tmp_path / "camera")
    assert warning in dark.err
    assert cadtof("info", folder).status == 1
    mended = ("--saturated-counts", f"0,{limit}")
    assert cadtof("info", folder, *mended).status == 0
    assert warning not in cadtof("resolve", folder, "-o", tmp_path / "mended", "--jobs", "1", *mended).err


def test_a_channel_that_is_not_connected_is_reported(recorded: Path, tmp_path: Path) -> None:
    pages = tifffile.imread(recorded)
    noise = np.random.default_rng(3).normal(ZERO_COUNTS, 7.0, pages.shape).astype(pages.dtype)
    folder = _capture(tmp_path / "loose", np.concatenate([pages[:3], noise[3:]]), toml=TOML["tif"])
    warning = f"warning: {folder}: H2.SC2: found only noise, but other planes show a scene"
    assert warning in cadtof("resolve", folder, "-o", tmp_path / "maps", "--jobs", "1").err
    looked = cadtof("info", folder)
    assert looked.status == 1
    assert "H2.SC2: found only noise" in looked.err
    assert "one after the other" not in looked.err
    assert warning not in cadtof("calibrate", "dark", folder, "-o", tmp_path / "camera").err


def test_eight_bits_from_imagemagick_are_refused(recorded: Path, tmp_path: Path, tool: Tool) -> None:
    folder = tmp_path / "magick"
    folder.mkdir()
    (folder / "capture.toml").write_text(TOML["tif"])
    tool("convert", recorded, "-depth", "8", folder / "frame.tif")
    assert "they look scaled to 8 bits, as ImageMagick does with -depth 8" in _refused(folder).err


def test_floats_from_imagemagick_are_refused(recorded: Path, tmp_path: Path, tool: Tool) -> None:
    folder = tmp_path / "magick"
    folder.mkdir()
    (folder / "capture.toml").write_text(TOML["tif"])
    tool(
        "convert",
        recorded,
        "-depth",
        "32",
        "-define",
        "quantum:format=floating-point",
        "-compress",
        "Zip",
        folder / "frame.tif",
    )
    assert "scaled to 0 … 1, as ImageMagick writes floats" in _refused(folder).err


def test_millivolts_are_refused_with_the_option_that_mends_them(recorded: Path, tmp_path: Path) -> None:
    millivolts = (tifffile.imread(recorded).astype("f8") - ZERO_COUNTS) * VOLTS_PER_COUNT * 1000
    folder = _capture(tmp_path / "mv", millivolts.astype("f4"), toml=TOML["exr"])
    assert "they look like millivolts: give --volts-per-count 0.001" in _refused(folder).err
    mended = ("--volts-per-count", "0.001")
    assert cadtof("resolve", folder, "-o", tmp_path / "mended", "--jobs", "1", *mended).status == 0


def test_counts_without_their_zero_are_refused_under_settings_of_counts(recorded: Path, tmp_path: Path) -> None:
    shifted = (tifffile.imread(recorded).astype(int) - ZERO_COUNTS).astype("i2")
    done = _refused(_capture(tmp_path / "shifted", shifted, toml=TOML["tif"]))
    assert done.status == 1
    assert "they look like counts from which the zero was subtracted: give --zero-counts 0" in done.err


def test_volts_are_refused_under_settings_of_counts(recorded: Path, tmp_path: Path) -> None:
    volts = (tifffile.imread(recorded).astype("f8") - ZERO_COUNTS) * VOLTS_PER_COUNT
    done = _refused(_capture(tmp_path / "volts", volts.astype("f4"), toml=TOML["tif"]))
    assert done.status == 1
    assert "they look like volts already: leave out zero_counts, volts_per_count and saturated_counts" in done.err


def test_among_several_captures_the_key_of_the_one_at_fault_is_named_not_only_the_option(
    recorded: Path, tmp_path: Path
) -> None:
    """An option would spoil the other capture: followed for its own capture alone, the advice makes all maps."""
    millivolts = (tifffile.imread(recorded).astype("f8") - ZERO_COUNTS) * VOLTS_PER_COUNT * 1000
    folder = _capture(tmp_path / "mv", millivolts.astype("f4"), toml=TOML["exr"])
    both = ("resolve", recorded.parent, folder, "-o", tmp_path / "maps", "--jobs", "1")
    told = "; an option holds for all captures of a run, a key in the capture.toml of this capture for it alone"
    assert cadtof(*both).err.strip().endswith(told)
    assert "correct --volts-per-count" in cadtof(*both, "--volts-per-count", "0.001").err
    with (folder / "capture.toml").open("a") as toml:
        toml.write("[voltage]\nvolts_per_count = 0.001\n")
    assert cadtof(*both).status == 0


def test_a_frame_without_an_answer_is_a_failed_frame(recorded: Path, tmp_path: Path) -> None:
    dark = np.random.default_rng(1).normal(ZERO_COUNTS, 5, (4, 24, 32)).round().astype("u2")
    write_pages(recorded.parent / "frame_1.tif", dark)
    done = cadtof("resolve", recorded.parent, "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 1
    assert "frame_1.tif: no pixel has an answer (100.0% low confidence)" in done.err
    assert [path.name for path in (tmp_path / "maps").glob("*.tif")] == ["frame_0.tif"]


def test_frames_with_values_of_8_bits_fail_alone(recorded: Path, tmp_path: Path) -> None:
    write_pages(recorded.parent / "frame_0a.tif", (tifffile.imread(recorded) >> 8).astype("u1"))
    write_pages(recorded.parent / "a_first.tif", (tifffile.imread(recorded) >> 8).astype("u1"))
    done = cadtof("resolve", recorded.parent, "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 1
    assert done.err.count("they look scaled to 8 bits") == 2
    assert [path.name for path in (tmp_path / "maps").glob("*.tif")] == ["frame_0.tif"]


def test_a_few_hot_pixels_are_accepted(recorded: Path, tmp_path: Path) -> None:
    pages = tifffile.imread(recorded)
    pages[:, ::5, ::5] = 16000
    folder = _capture(tmp_path / "hot", pages, toml=TOML["tif"])
    assert cadtof("resolve", folder, "-o", tmp_path / "maps", "--jobs", "1").status == 0


@pytest.mark.parametrize("part", ["dark", "response", "petzval"])
def test_float_counts_without_settings_are_not_calibrated(part: str, recorded: Path, tmp_path: Path) -> None:
    pages = tifffile.imread(recorded).astype(np.float32)
    capture = _capture(tmp_path / "float", pages)
    distance = () if part == "dark" else ("--distance", 1)
    done = cadtof("calibrate", part, capture, "-o", tmp_path / "camera", *distance)
    assert done.status == 1
    assert "they look like counts: give --volts-per-count" in done.err
    assert not (tmp_path / "camera").exists()


def test_info_reports_float_counts_without_settings(recorded: Path, tmp_path: Path) -> None:
    folder = _capture(tmp_path / "floats", tifffile.imread(recorded).astype("f4"))
    done = cadtof("info", folder, "--jobs", "1")
    assert done.status == 1
    assert "wrong: " in done.err
    assert "they look like counts" in done.err


@pytest.mark.parametrize("names", ["RGB", "uvw", "RGBA"])
def test_a_file_that_is_no_frame_is_skipped_with_its_reason(names: str, tmp_path: Path) -> None:
    write_exr(tmp_path / "picture.exr", {name: np.full((24, 32), 0.1, "f4") for name in names})
    done = cadtof("resolve", tmp_path / "picture.exr", "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 1
    assert f"skipped: {tmp_path / 'picture.exr'}: holds " in done.err
    assert "expected voltages H1.SC1" in done.err


@pytest.mark.parametrize("samples", [3, 4])
def test_a_colour_picture_in_tiff_is_skipped_with_its_reason(samples: int, tmp_path: Path) -> None:
    picture = np.full((24, 32, samples), 100, "u1")
    tifffile.imwrite(tmp_path / "photo.tif", picture, photometric="rgb")
    settings = ("--volts-per-count", "1e-3", "--zero-counts", "100")
    done = cadtof("resolve", tmp_path / "photo.tif", "-o", tmp_path / "maps", "--jobs", "1", *settings)
    assert done.status == 1
    assert f"skipped: {tmp_path / 'photo.tif'}: holds a colour picture (RGB" in done.err


def test_maps_in_place_of_frames_are_skipped(recorded: Path, tmp_path: Path) -> None:
    cadtof("resolve", recorded.parent, "-o", tmp_path / "maps", "--jobs", "1")
    done = cadtof("resolve", tmp_path / "maps", "-o", tmp_path / "again", "--jobs", "1")
    assert done.status == 1
    assert f"skipped: {tmp_path / 'maps' / 'frame_0.tif'}: holds maps (direct.depth," in done.err


@pytest.mark.parametrize("command", ["resolve", "info", "calibrate"])
def test_the_settings_file_to_be_mended_is_named(command: str, recorded: Path, tmp_path: Path) -> None:
    """A capture.toml beside the frames has no effect if --settings names another file."""
    other = tmp_path / "other.toml"
    other.write_text("[modulation]\nperiods_ns = [40.0, 20.0]\n")
    words = {
        "resolve": ("resolve", recorded.parent, "-o", tmp_path / "maps"),
        "info": ("info", recorded.parent),
        "calibrate": ("calibrate", "dark", recorded.parent, "-o", tmp_path / "camera"),
    }
    done = cadtof(*words[command], "--settings", other)
    told = f"{recorded.parent}: frames hold whole numbers (uint16), and the volts per count are unknown: set "
    assert f"{told}volts_per_count and zero_counts under [voltage] in {other}, or --volts-per-count" in done.err
