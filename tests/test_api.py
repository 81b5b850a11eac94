"""The Python interface returns the same bits as the command writes, and importing the package loads nothing until it is used."""

import logging
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
import tifffile

from cadtof_cli import Frame, Maps, read_frames, read_maps, resolve, simulate_scene
from cadtof_cli.api import frames as api_frames
from cadtof_cli.api.resolve import ResolveOptions, ResolverOptions
from cadtof_cli.calibration.store import save_part
from cadtof_cli.capture.metadata import Pixel
from cadtof_cli.capture.toml import load_metadata
from cadtof_cli.errors import CaptureError, FrameError, MetadataError, SettingsError
from cadtof_cli.pipeline.plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from tests.support.calibrations import made_up_calibration
from tests.support.captures import layers_of, record
from tests.support.loaded import loaded_modules
from tests.support.needed import needed_module
from tests.support.run_cadtof import ROOT, cadtof

CORNER = ROOT / "sample_data" / "corner"
ROI = (100, 60, 220, 180)


def _same(maps: Maps, file: Path) -> None:
    written = layers_of(file)
    assert set(maps) == set(written)
    for name, plane in written.items():
        if name == "status":
            assert maps.status.dtype == np.uint32
            assert (maps.status == plane).all()
        else:
            assert maps[name].dtype == np.float32
            assert maps[name].tobytes() == plane.astype(np.float32).tobytes(), name


def _written(capture: Path, out: Path, *options: str) -> list[Path]:
    done = cadtof("resolve", capture, "-o", out, "-j", "1", "--quiet", *options)
    assert done.status == 0, done.err
    return sorted(path for path in out.iterdir() if path.suffix in {".tif", ".exr"})


WAYS: list[tuple[list[str], ResolveOptions]] = [
    (["--mpi-model", "discrete"], {"mpi_model": "discrete"}),
    (["--solver", "lm", "--order", "2", "--seed", "3"], {"solver": "lm", "order": "2", "seed": 3}),
    (["--pool", "3", "--depth", "z"], {"pool": 3, "depth": "z"}),
    (["--return", "strongest", "--min-confidence", "0.02"], {"returns": "strongest", "min_confidence_v": 0.02}),
]


@pytest.mark.parametrize(("options", "same_options"), WAYS, ids=" ".join)
@pytest.mark.parametrize("form", ["tif", "exr"])
def test_resolve_gives_the_bits_that_the_command_writes(
    tmp_path: Path, form: str, options: list[str], same_options: ResolveOptions
) -> None:
    capture = record(tmp_path / "capture", frames=2, form="tif" if form == "tif" else "exr")
    optics = "" if form == "tif" else "[optics]\nfocal_length_px = 28.0\n"
    settings = capture.folder / "capture.toml"
    settings.write_text(settings.read_text() + optics)
    written = _written(capture.folder, tmp_path / "out", *options)
    read = list(read_frames(capture.folder))
    assert [frame.name for frame in read] == [file.stem for file in written]
    for frame, file in zip(read, written, strict=True):
        maps = resolve(frame, **same_options)
        _same(maps, file)
        assert maps.facts.items() <= read_maps(file).facts.items()
        assert maps.facts["source"] == file.with_suffix(f".{form}").name


def test_a_region_with_diffuse_mpi_has_the_bits_that_the_command_writes(tmp_path: Path) -> None:
    (file,) = _written(CORNER, tmp_path / "out", "--mpi-model", "diffuse", "--roi", ",".join(map(str, ROI)))
    (frame,) = read_frames(CORNER)
    maps = resolve(frame, mpi_model="diffuse", roi=ROI)
    assert (maps.status & 2048 > 0).mean() > 0.99
    _same(maps, file)


def test_maps_with_a_calibration_are_those_that_resolve_writes(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    metadata = load_metadata(capture.folder / "capture.toml").metadata
    for part in made_up_calibration(metadata, (24, 32), {"dark", "response", "petzval"}).parts:
        save_part(tmp_path / "calibration", part)
    (file,) = _written(capture.folder, tmp_path / "out", "--calibration", str(tmp_path / "calibration"))
    (frame,) = read_frames(capture.folder)
    maps = resolve(frame, calibration=tmp_path / "calibration")
    _same(maps, file)
    assert maps.facts["calibration"] == read_maps(file).facts["calibration"]
    assert np.nanmax(np.abs(maps["direct.depth"] - resolve(frame)["direct.depth"])) > 0.01
    with pytest.raises(MetadataError, match="no such folder"):
        resolve(frame, calibration=tmp_path / "elsewhere")


def test_a_calibration_that_is_replaced_is_read_again(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    (frame,) = read_frames(capture.folder)
    dark, _, curved = made_up_calibration(frame.metadata, (24, 32), {"dark", "response", "petzval"}).parts
    save_part(tmp_path / "calibration", dark)
    before = resolve(frame, calibration=tmp_path / "calibration")
    save_part(tmp_path / "calibration", curved)
    assert resolve(frame, calibration=tmp_path / "calibration").facts["calibration"] != before.facts["calibration"]


def test_a_list_of_frames_is_resolved_as_their_mean(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=4)
    (file,) = _written(capture.folder, tmp_path / "out", "--average", "4")
    maps = resolve(list(read_frames(capture.folder)), mpi_model="auto")
    _same(maps, file)
    assert (maps["effective_pixels"] == 4).all()
    with pytest.raises(SettingsError, match="found no frame"):
        resolve([])


def test_options_without_effect_are_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    frame = next(read_frames(record(tmp_path / "capture").folder))
    for _ in range(2):
        resolve(frame, order="1", starts=5, returns="last", min_confidence_v=1e-4, false_alarm=0.1)
    for line in (
        "starts: has no effect with --solver two-path",
        "returns: has no effect with one path per pixel",
        "false_alarm: has no effect with --min-confidence and a given number of paths",
    ):
        assert caplog.text.count(line) == 1
    assert "min_return_ratio" not in caplog.text
    Frame.from_array(frame.stored, {"layout.frames": 3, "voltage.volts_per_count": 6e-5}, name="live")
    assert "live: layout.frames has no effect on an array" in caplog.text


def test_a_copy_of_a_frame_is_left_out_of_the_mean(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A driver that fills one buffer again gives the same values under several names; they make no noise smaller."""
    capture = record(tmp_path / "capture", frames=3)
    capture.files[1].write_bytes(capture.files[0].read_bytes())
    (file,) = _written(capture.folder, tmp_path / "out", "--average", "3")
    _same(resolve(list(read_frames(capture.folder)), mpi_model="auto"), file)
    assert "frame_1.tif: holds the same values as another of these frames, so the mean is without it" in caplog.text


def test_frames_of_one_pixel_that_hold_the_same_values_are_not_taken_for_copies(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """By chance, a single pixel may hold the same values again; the command counts such frames, too."""
    volts = np.array([0.1, 0.05, 0.02, 0.08], np.float32).reshape(2, 2, 1, 1)
    frame = Frame.from_array(volts, {"pixel.integration_length": 1e4})
    assert resolve([frame, frame], mpi_model="discrete")["effective_pixels"].tolist() == [[2.0]]
    assert "holds the same values" not in caplog.text


def test_reading_goes_on_after_a_frame_that_cannot_be_read(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3)
    capture.files[1].write_bytes(capture.files[1].read_bytes()[:100])
    frames = read_frames(capture.folder)
    assert str(next(frames)) == "frame_0.tif"
    with pytest.raises(FrameError, match="frame_1"):
        next(frames)
    assert [str(frame) for frame in frames] == ["frame_2.tif"]


def test_frames_of_a_stack_are_read_by_a_slice(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=5)
    pages = np.concatenate([tifffile.imread(file) for file in capture.files])
    for file in capture.files:
        file.unlink()
    tifffile.imwrite(capture.folder / "stack.tif", pages, photometric="minisblack", metadata=None)
    read = list(read_frames(capture.folder, metadata={"layout.frames": 5}, frames=slice(1, 3)))
    assert [(frame.name, frame.source) for frame in read] == [
        ("stack_0001", "stack.tif[1]"),
        ("stack_0002", "stack.tif[2]"),
    ]
    assert (read[1].stored.reshape(4, 24, 32) == pages[8:12]).all()


def test_an_array_is_a_frame_as_good_as_a_file(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    (frame,) = read_frames(capture.folder)
    known = {
        "pixel.integration_length": 100000,
        "voltage.zero_counts": 8192.0,
        "voltage.volts_per_count": 6.0e-5,
        "voltage.saturated_counts": [0, 16383],
        "optics.focal_length_px": 28.0,
        "optics.principal_point_px": [15.0, 10.0],
    }
    made = Frame.from_array(frame.stored, known)
    assert made.metadata == frame.metadata
    assert resolve(made)["direct.depth"].tobytes() == resolve(frame)["direct.depth"].tobytes()
    by_file = Frame.from_array(
        frame.stored, {"pixel.integration_length": 5e4}, settings_file=capture.folder / "capture.toml"
    )
    assert by_file.metadata.pixel == Pixel(integration_length=5e4)
    assert by_file.metadata.voltage == frame.metadata.voltage


@pytest.mark.parametrize(
    ("shape", "dtype", "expected"),
    [
        ((3, 2, 4, 4), "uint16", r"shape \(3, 2, 4, 4\), expected \(2, 2, Y, X\)"),
        ((24, 32, 2, 2), "uint16", r"if its axes are Y X H C: stored\.transpose\(2, 3, 0, 1\)"),
        (
            (24, 32, 4),
            "uint16",
            r"if its axes are Y X 4: stored\.transpose\(2, 0, 1\), then \.reshape\(2, 2, Y, X\) with its",
        ),
        (
            (4, 24, 32),
            "uint16",
            r"; planes on one axis: stored\.reshape\(2, 2, Y, X\) with its numbers of rows and columns",
        ),
        ((2, 2, 4), "uint16", "shape"),
        ((2, 2, 4, 0), "float32", "shape"),
        ((2, 2, 4, 4), "complex128", "type complex128"),
    ],
)
def test_an_array_that_is_no_frame_is_refused(shape: Sequence[int], dtype: str, expected: str) -> None:
    with pytest.raises(FrameError, match=expected):
        Frame.from_array(np.zeros(shape, dtype))


def test_wrong_input_raises_an_error_of_our_own(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    (frame,) = read_frames(capture.folder)
    mistyped: Any = {"pooling": 4}
    dark = Frame(np.full_like(frame.stored, 8192), frame.metadata, name="dark")
    with pytest.raises(FrameError, match="dark: all pixels hold the same values"):
        resolve(dark)
    volts = Frame.from_array(frame.stored.astype(np.float32))
    with pytest.raises(FrameError, match="stored values"):
        resolve(volts)
    with pytest.raises(SettingsError, match="--pool: found 4"):
        resolve(frame, pool=4)
    with pytest.raises(SettingsError, match="found the option pooling, expected some of calibration, mpi_model"):
        resolve(frame, **mistyped)
    with pytest.raises(SettingsError, match=r"metadata: found 'integration_length'"):
        list(read_frames(capture.folder, metadata={"integration_length": 1e5}))
    with pytest.raises(CaptureError, match="no such file"):
        list(read_frames(tmp_path / "nowhere"))


def test_a_key_without_its_table_is_named_with_it(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"found 'periods_ns', expected keys such as modulation\.periods_ns, …"):
        list(read_frames(tmp_path, metadata={"periods_ns": [40.0, 20.0]}))
    with pytest.raises(
        SettingsError, match=r"found 'optics\.focal_length', expected keys such as optics\.focal_length_px, …"
    ):
        list(read_frames(tmp_path, metadata={"optics.focal_length": 280.0}))
    with pytest.raises(SettingsError, match=r"found 'pixel', expected keys such as pixel\.integration_length, …"):
        read_frames(tmp_path, metadata={"pixel": {"integration_length": 1e5}})


@pytest.mark.parametrize("inputs", [(), ("",), ("capture", "")])
def test_an_empty_path_does_not_mean_the_current_folder(inputs: tuple[str, ...]) -> None:
    with pytest.raises(CaptureError, match=r"read_frames: found .*, expected capture folders or frames"):
        list(read_frames(*inputs))


@pytest.mark.parametrize("given", ["capture", np.zeros((2, 2, 4, 4)), [1], None, 7])
def test_the_message_for_an_object_that_is_no_frame_says_how_to_get_one(given: Any) -> None:
    kind = type(given).__name__
    with pytest.raises(
        SettingsError, match=rf"found {kind}, expected a Frame, or several; read_frames\(PATH\) yields them"
    ):
        resolve(given)


def test_an_order_may_be_a_number_and_a_region_lies_in_the_frame(tmp_path: Path) -> None:
    (frame,) = read_frames(record(tmp_path / "capture").folder)
    number: Any = 2
    assert np.array_equal(resolve(frame, order=number).status, resolve(frame, order="2").status)
    for region in ((0, 0, 33, 10), (40, 0, 50, 10), (0, 0, 32, 25)):
        with pytest.raises(SettingsError, match="expected it inside the 32 × 24 pixels of frame_"):
            resolve(frame, roi=region)


MASKED = np.ma.masked_greater(np.full((2, 2, 4, 4), 0.1), 0.05)


@pytest.mark.parametrize("make", [Frame.from_array, Frame])
@pytest.mark.parametrize("values", [MASKED, list(MASKED), [list(of_harmonic) for of_harmonic in MASKED]])
def test_masked_values_are_not_taken_for_numbers(make: Callable[[Any], Frame], values: Any) -> None:
    with pytest.raises(FrameError, match="frame: found masked values"):
        make(values)


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "<f8", ">f4"])
def test_values_may_lie_at_any_place_in_a_buffer(tmp_path: Path, dtype: str) -> None:
    """A packet of a camera has a header, often of an odd number of bytes, before its values."""
    frame = next(read_frames(record(tmp_path / "capture").folder))
    values = frame.stored.astype(dtype)
    packet = bytearray(b"header " + values.tobytes())
    odd = np.ndarray(values.shape, dtype, buffer=packet, offset=7)
    for made in (
        Frame.from_array(odd, settings_file=tmp_path / "capture" / "capture.toml"),
        Frame(odd, frame.metadata),
    ):
        assert (
            resolve(made)["direct.depth"].tobytes() == resolve(Frame(values, frame.metadata))["direct.depth"].tobytes()
        )


def test_what_is_likely_wrong_with_an_array_is_logged_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`cadtof resolve` warns of planes in another order, of periods in ps and of assumptions; so does a frame from an array."""
    monkeypatch.setattr(api_frames, "_kinds", set())
    frame = next(read_frames(ROOT / "sample_data" / "card"))
    volts, periods = frame.stored[:, ::-1], {"modulation.periods_ns": [40.0e3, 20.0e3]}
    for _ in range(3):
        Frame.from_array(volts, periods, name="live")
    assert caplog.text.count("with SC1 and SC2 swapped, they would in") == 1
    assert caplog.text.count("warning: live: modulation.periods_ns = 40000, … means depths up to 5996 m") == 1
    assert caplog.text.count("live: not given, so taken from the paper: modulation.waveform = 'sine'") == 1


def test_a_frame_without_a_recording_does_not_stand_for_those_after_it(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The buffer of a driver is empty when it starts. Values that `resolve` refuses are left to it."""
    monkeypatch.setattr(api_frames, "_kinds", set())
    frame = next(read_frames(ROOT / "sample_data" / "card"))
    for values in (np.full_like(frame.stored, 1000.0), frame.stored[:, ::-1]):
        Frame.from_array(values, {"modulation.amplitude_v": 0.25}, name="live")
    assert caplog.text.count("with SC1 and SC2 swapped, they would in") == 1
    Frame.from_array(np.ones((2, 2, 8, 8), np.uint16), name="counts")
    assert "counts" not in caplog.text


@pytest.mark.parametrize("options", [{"mpi_model": "diffuse"}, {"pool": 3}], ids=str)
def test_the_answer_does_not_depend_on_how_the_caller_treats_rounding(options: Any) -> None:
    frame = next(read_frames(ROOT / "sample_data" / "card"))
    with np.errstate(all="raise"):
        strict = resolve(frame, **options)
    assert strict["direct.depth"].tobytes() == resolve(frame, **options)["direct.depth"].tobytes()


WRONG_KINDS: list[tuple[dict[str, Any], str]] = [
    ({"roi": (1, 2, 3)}, "found roi=(1, 2, 3), expected 4 whole numbers"),
    ({"roi": (1.5, 2, 3, 4)}, "found roi=(1.5, 2, 3, 4), expected 4 whole numbers"),
    ({"pool": "3"}, "found pool='3', expected a whole number"),
    ({"paths": 2.0}, "found paths=2.0, expected a whole number"),
    ({"starts": True, "solver": "lm"}, "found starts=True, expected a whole number"),
    ({"false_alarm": None}, "found false_alarm=None, expected a number"),
    ({"min_confidence_v": "x"}, "found min_confidence_v='x', expected a number"),
]


@pytest.mark.parametrize(("options", "expected"), WRONG_KINDS)
def test_an_option_of_another_kind_is_named(options: dict[str, Any], expected: str) -> None:
    frame = Frame(np.zeros((2, 2, 4, 6), np.float32))
    with pytest.raises(SettingsError, match=f"^resolve: {re.escape(expected)}$"):
        resolve(frame, **options)


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    """Numbers computed with numpy can be passed as they are: in options, regions and keys of `capture.toml`."""
    frame = next(read_frames(record(tmp_path / "capture").folder))
    known = frame.metadata
    settings = {
        "modulation.periods_ns": np.array(known.modulation.periods_ns),
        "optics.principal_point_px": (np.float32(15.0), np.int64(10)),
        "pixel.integration_length": np.float32(1e5),
        "voltage.zero_counts": np.int64(8192),
        "voltage.volts_per_count": np.float64(known.voltage.volts_per_count or 0.0),
    }
    made = Frame.from_array(frame.stored, settings)
    assert made.metadata.modulation.periods_ns == known.modulation.periods_ns
    assert made.metadata.voltage.zero_counts == 8192.0
    corners: Any = np.array([1, 2, 5, 6])
    assert resolve(made, roi=corners, pool=int(np.int32(3)), min_confidence_v=0).shape == (4, 4)
    card = simulate_scene("card", camera={"width": np.int64(8), "height": 6}, seed=int(np.int8(3)))
    assert repr(card.frames[0]) == "<Frame frame_0000 of 8 × 6 pixels: 2 harmonics, uint16>"


@pytest.mark.parametrize("frames", [0, slice(-1, None), slice(0, 10**30), slice(0.0, 1.0)])
def test_frames_are_counted_from_0(frames: Any) -> None:
    with pytest.raises(SettingsError, match=r"^read_frames: found frames=.*, expected a slice from 0 on, such as"):
        next(read_frames(CORNER, frames=frames))


def test_frames_may_be_chosen_by_numbers_of_numpy() -> None:
    chosen: Any = slice(np.int64(0), np.int64(1))
    assert [str(frame) for frame in read_frames(CORNER, frames=chosen)] == ["frame_0000.tif"]


def test_options_are_the_fields_of_the_records() -> None:
    """ResolveOptions repeats names and types for type checkers; they must be those of the records."""
    resolver, maps = get_type_hints(ResolverSettings), get_type_hints(MapSettings)
    typed = get_type_hints(ResolveOptions)
    known = {one.name for one in fields(ResolverSettings)} - {"min_confidence"}
    assert set(ResolverOptions.__annotations__) == known, "api/resolve.py: ResolverOptions repeats resolver/settings.py"
    of_maps = set(typed) - set(ResolverOptions.__annotations__)
    assert of_maps == set(maps) - {"resolver", "average"}, "api/resolve.py: ResolveOptions repeats pipeline/plan.py"
    for name, hint in typed.items():
        assert hint == (resolver | maps)[name], name


def test_the_page_about_python_names_every_option() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    names = ResolveOptions.__annotations__
    unnamed = [name for name in names if f"--{name.replace('_', '-')}" not in page and f"`{name}=" not in page]
    assert not unnamed, f"docs/python.md, Options, does not name {', '.join(unnamed)}"


def test_defaults_that_were_taken_are_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    capture = record(tmp_path / "capture", form="exr", toml="")
    with caplog.at_level(logging.WARNING, logger="cadtof_cli"):
        assert len(list(read_frames(capture.folder))) == 1
    assert "taken from the paper: modulation.periods_ns = [40.0, 20.0]" in caplog.text


def test_a_capture_whose_harmonics_allow_one_path_only_is_read(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    (frame,) = read_frames(capture.folder, metadata={"modulation.periods_ns": [60.0, 20.0]})
    assert (resolve(frame, solver="one-path").status & 8 > 0).mean() > 0.5
    with pytest.raises(SettingsError, match="with 2 periods, 2 paths have a unique"):
        resolve(frame)


@pytest.mark.parametrize("suffix", ["tif", "exr"])
def test_maps_are_read_from_files_and_folders(tmp_path: Path, suffix: str) -> None:
    capture = record(tmp_path / "capture", frames=2)
    files = _written(capture.folder, tmp_path / "out", "--format", suffix)
    maps = read_maps(files[0])
    _same(maps, files[0])
    assert maps.units["direct.depth"] == maps.units["mpi.sigma"] == "m"
    assert maps.units["confidence"] == "V"
    assert maps.units["status"] == ""
    assert maps.shape == (24, 32)
    assert "32 × 24 pixels" in repr(maps)
    with pytest.raises(KeyError, match=r"direct\.deep: found layers .*direct\.depth"):
        maps["direct.deep"]
    with pytest.raises(
        CaptureError, match="found 2 files that may hold maps, expected one; name one of them"
    ) as raised:
        read_maps(tmp_path / "out")
    assert list(read_maps(str(raised.value).rpartition("such as ")[2])) == list(maps)
    files[1].unlink()
    assert list(read_maps(tmp_path / "out")) == list(maps)


def test_truth_is_read_too() -> None:
    truth = read_maps(CORNER / "truth.exr")
    assert {"direct.depth", "mpi.ratio"} <= set(truth)
    assert truth.facts == {}


def test_maps_as_xarray_keep_their_units_and_the_meanings_of_their_bits(tmp_path: Path) -> None:
    xarray = needed_module("xarray")
    capture = record(tmp_path / "capture")
    (frame,) = read_frames(capture.folder)
    data = resolve(frame).to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert data["direct.depth"].dims == ("y", "x")
    assert data["direct.depth"].attrs == {"units": "m"}
    assert data.attrs["depth"] == "radial range"
    assert data["status"].attrs["flag_meanings"].split()[3] == "one_path"
    assert data["status"].attrs["flag_masks"][3] == 8
    one = data["status"].to_numpy() & 8 > 0
    assert np.isnan(data["mpi.depth"].to_numpy()[one]).all()
    assert float(data["direct.depth"].sel(x=3, y=5)) == resolve(frame)["direct.depth"][5, 3]


def test_xarray_matches_maps_of_a_part_with_those_of_the_whole(tmp_path: Path) -> None:
    """xarray matches data by coordinates, so a difference of whole and part must be one of the same pixels."""
    needed_module("xarray")
    capture, part = record(tmp_path / "capture"), (5, 3, 29, 21)
    (frame,) = read_frames(capture.folder)
    whole, of_part = resolve(frame, mpi_model="discrete"), resolve(frame, mpi_model="discrete", roi=part)
    out = tmp_path / "out"
    options = ("-j", 1, "-q", "--mpi-model", "discrete", "--roi", "5,3,29,21")
    assert cadtof("resolve", capture.folder, "-o", out, *options).status == 0
    for maps in (of_part, read_maps(out)):
        data = maps.to_xarray()
        assert (data.x[0], data.x[-1], data.y[0], data.y[-1]) == (5, 28, 3, 20)
        difference = (whole.to_xarray() - data)["direct.depth"]
        assert difference.shape == (18, 24)
        assert (difference == 0).any()
        assert not (difference != 0).where(difference.notnull(), 0).any()


def test_to_xarray_without_xarray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    maps = Maps({"direct.depth": np.zeros((2, 3), np.float32)})
    with pytest.raises(SettingsError, match=r"pip install 'cadtof\[xarray\]'"):
        maps.to_xarray()


def test_a_simulated_scene_is_what_the_command_records(tmp_path: Path) -> None:
    done = cadtof(
        *("simulate", "--scene", "corner", "--frames", "2", "--seed", "5", "--width", "32", "--height", "24"),
        *("--asr", "3", "--opening", "80", "--petzval", "0.03,0", "--quiet", "-j", "1", "-o", tmp_path / "corner"),
        *("--gain-mismatch", "0.05", "--jitter", "0.2", "--integration-length", "1e5,1e4"),
    )
    assert done.status == 0, done.err
    read = list(read_frames(tmp_path / "corner"))
    camera = {"width": 32, "height": 24, "petzval_m": (0.03, 0.0)}
    pixel, lengths = {"gain_mismatch": 0.05, "jitter_ns": 0.2}, [1e5, 1e4]
    made = simulate_scene(
        "corner", frames=2, seed=5, integration_length=lengths, camera=camera, pixel=pixel, asr=3.0, opening_deg=80.0
    )
    assert [frame.name for frame in made.frames] == [frame.name for frame in read]
    for ours, theirs in zip(made.frames, read, strict=True):
        assert ours.metadata == theirs.metadata
        assert ours.stored.dtype == theirs.stored.dtype
        assert (ours.stored == theirs.stored).all()
    truth = read_maps(tmp_path / "corner" / "truth.exr")
    assert set(truth) == set(made.truth)
    assert np.allclose(truth["direct.depth"], made.truth["direct.depth"], atol=1e-4, equal_nan=True)


def test_an_unknown_scene_or_setting_is_refused() -> None:
    with pytest.raises(SettingsError, match="found 'cave', expected one of card, wall"):
        simulate_scene("cave")
    with pytest.raises(SettingsError, match="Wall: found opening_deg, expected some of distance_m"):
        simulate_scene("wall", opening_deg=80)
    with pytest.raises(SettingsError, match=r"modulation\.amplitude_v"):
        simulate_scene("wall", modulation={"amplitude_v": -1.0})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": 1.5}, "simulate_scene: found frames=1.5, expected a whole number"),
        ({"frames": 0}, "frames: found 0, expected 1 or more"),
        ({"seed": "3"}, "simulate_scene: found seed='3', expected a whole number"),
        ({"integration_length": 0}, "pixel.integration_length: found 0.0, expected a finite number above 1"),
        ({"integration_length": "many"}, "simulate_scene: found integration_length='many', expected a number"),
        ({"fwhm_ns": -1}, "pulse.fwhm_ns: found -1.0, expected 0, or 1e-06 or more, in ns"),
        ({"fwhm_ns": "1"}, "Pulse: found fwhm_ns='1', expected a number"),
    ],
)
def test_a_value_that_a_scene_cannot_have_is_a_settings_error(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError) as caught:
        simulate_scene("wall", camera={"width": 8, "height": 6}, **options)
    assert str(caught.value) == message


def test_importing_the_package_loads_nothing() -> None:
    heavy = {"numpy", "scipy", "click", "rich", "matplotlib", "tifffile", "OpenEXR", "xarray", "logging"}
    assert not loaded_modules("import cadtof_cli; assert 'resolve' in dir(cadtof_cli)") & heavy
    loaded = loaded_modules("from cadtof_cli import read_frames, resolve, read_maps, simulate_scene")
    assert "numpy" in loaded
    assert not loaded & {"click", "rich", "matplotlib", "xarray", "OpenEXR"}


def test_the_package_has_no_other_names_than_those_in_all() -> None:
    import cadtof_cli

    with pytest.raises(AttributeError, match="no attribute 'resolved'"):
        assert cadtof_cli.resolved
    assert cadtof_cli.__all__ == sorted(cadtof_cli.__all__)
