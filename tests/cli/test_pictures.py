"""Every picture that a command draws is whole, with any name in it, and replaces no file.

Whole means: nothing is cut off, no legend lies on curves, and axes have labels.
"""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.textpath import TextPath
from matplotlib.transforms import BboxBase

from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.petzval import PetzvalCalibration, WallFit
from cadtof_cli.calibration.store import save_part
from cadtof_cli.capture.metadata import CaptureMetadata, Optics
from cadtof_cli.figures.canvas import within
from cadtof_cli.figures.petzval import draw_petzval
from cadtof_cli.figures.pixel_classes import PixelClass
from cadtof_cli.figures.profile import draw_profile
from cadtof_cli.maps.profile import Curve, Profile
from cadtof_cli.optics import wall_range_m
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.units import unambiguous_range_m
from tests.support.calibrations import PETZVAL_QUALITY, curved, made_up_calibration
from tests.support.captures import record, write_exr, write_frame
from tests.support.forward import step_frame, step_truth
from tests.support.run_cadtof import cadtof
from tests.support.vision import SEEN, apart, rgb

HOSTILE = "$a$_{b}^2 $\\frac$ 深度 ☃ new\nline \\x"

SHOWN_HOSTILE = r"$a$_{b}^2 $\frac$ \u{6df1}\u{5ea6} ☃ new\nline \x"
"""How a picture shows this name: characters that the font lacks, and the end of a line, are escaped."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a hostile name. It holds captures of several shapes, their maps, truth and a calibration."""
    place = tmp_path_factory.mktemp("pictures") / HOSTILE
    shapes = {"usual": (24, 32), "wide": (6, 96), "tall": (120, 8)}
    for name, (height, width) in shapes.items():
        capture = record(place / f"{name} capture", frames=2)
        for file in capture.files:
            volts = np.tile(step_frame(np.random.default_rng(0)), (1, 1, 5, 3))
            write_frame(file, volts[..., :height, :width])
        done = cadtof("resolve", capture.folder, "-o", place / name, "-j", 1, "-q", "--mpi-model", "discrete")
        assert done.status == 0
    write_exr(place / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    for part in made_up_calibration(CaptureMetadata(), (24, 32), ("dark", "response", "petzval")).parts:
        save_part(place / "calibration", part)
    return place


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are drawn during a test."""
    drawn: list[Figure] = []
    save = Figure.savefig

    def recorded(figure: Figure, *arguments: Any, **more: Any) -> None:
        save(figure, *arguments, **more)
        drawn.append(figure)

    monkeypatch.setattr(Figure, "savefig", recorded)
    return drawn


COMMANDS: dict[str, tuple[object, ...]] = {
    "preview of maps": ("preview", "usual", "--frame", 0),
    "preview with truth": ("preview", "usual", "--frame", 0, "--truth", "truth.exr"),
    "preview of a wide map": ("preview", "wide", "--frame", 0),
    "preview of a tall map": ("preview", "tall", "--frame", 0),
    "preview of a layer": ("preview", "usual", "--frame", 1, "--layer", "mpi.depth"),
    "preview of a sheet": ("preview", "usual"),
    "preview of a recorded frame": ("preview", "usual capture", "--frame", 0),
    "preview of truth": ("preview", "truth.exr"),
    "preview of a calibration": ("preview", "calibration"),
    "compare": ("compare", "usual", "truth.exr"),
    "compare runs": ("compare", "wide", "wide"),
    "profile": ("profile", "usual", "--row", 3, "--truth", "truth.exr"),
    "inspect": ("inspect", "usual capture", "--pixel", "20,3"),
}

FOLDERS = {"usual", "wide", "tall", "usual capture", "truth.exr", "calibration"}


def _typed(place: Path, command: str) -> list[object]:
    return [place / str(word) if word in FOLDERS else word for word in COMMANDS[command]]


def test_a_title_is_whole_whatever_letters_are_left_of_it() -> None:
    """Such as a folder with a long name of narrow letters: its middle is left out, and wide letters stay."""
    shown = within(40 * "W" + 200 * "i" + 40 * "W", 5.0, size=11)
    assert 4.5 < TextPath((0, 0), shown, size=11).get_extents().width / 72 <= 5.0


@pytest.mark.parametrize("command", COMMANDS)
def test_a_picture_is_whole(command: str, place: Path, figures: list[Figure], tmp_path: Path) -> None:
    done = cadtof(*_typed(place, command), "-o", tmp_path / "a.png")
    assert (done.status, done.err) == (0, "")
    (figure,) = figures
    _require_whole(figure)


def test_pictures_of_simulations_are_whole(figures: list[Figure], tmp_path: Path) -> None:
    cycles = ("--cycles", 2000, "--runs", 5, "-j", 1, "-q")
    assert cadtof("simulate", "--integration-length", 1000, *cycles, "-o", tmp_path / "simulated").status == 0
    grid = ("--asr", "1:5:3", "--mpi", "0,0.3", "--integration-length", "1e3,1e5", "--runs", 5, "-j", 1, "-q")
    assert cadtof("sweep", *grid, "-o", tmp_path / "a.csv", "--plot", tmp_path / "plots").status == 0
    assert len(figures) == 6
    for figure in figures:
        _require_whole(figure)
    # curves of one plot are told apart without their colours
    for figure in figures:
        for axes in (axes for axes in figure.axes if axes.get_ylabel() in {"voltage, mV", "confidence, mV"}):
            named = [line for line in axes.get_lines() if not str(line.get_label()).startswith("_")]
            assert len({(line.get_marker(), line.get_linestyle()) for line in named}) == len(named) == 2


def test_the_picture_of_walls_is_whole(figures: list[Figure], tmp_path: Path) -> None:
    origin = Origin(captures=("wall", HOSTILE), frames=2, pixels=(24, 32), periods_ns=(40.0, 20.0), waveform="sine")
    wall = WallFit(2.0, 0.0, True, (0.0, 0.0), 0.01, 0.001, 0.001, 768)
    quality = replace(PETZVAL_QUALITY, walls=(wall, wall))
    petzval = PetzvalCalibration(origin, curved(0.05, -0.03, (15.0, 11.0), k2_stderr_m=3e-5), quality)
    flat = wall_range_m(Optics(focal_length_px=28.0, principal_point_px=(15.0, 11.0)), (24, 32), distance_m=2.0)
    # the second is as it is measured if the middle of the wall is nearer than the unambiguous range and its rim farther
    measured = flat + petzval.range_offset_m
    wrapped = np.where(measured > 2.1, measured - unambiguous_range_m(40.0), measured)
    draw_petzval([measured, wrapped], petzval, tmp_path / "a.png")
    (figure,) = figures
    _require_whole(figure)
    assert figure.get_suptitle().startswith("Field curvature: k2 = 5.0000 ± 0.0030 cm, k4 = -3.00 ± 0.20 cm; ")
    # each wall has two plots, along its middle row and over ρ; the walls have exactly this curvature: nothing is left
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["wall: rows 9 to 13", "wall", f"{SHOWN_HOSTILE}: rows 9 to 13", SHOWN_HOSTILE]
    for radial in (figure.axes[1], figure.axes[3]):
        before, after, curve = radial.get_lines()
        assert before.get_marker() != after.get_marker()
        medians = np.asarray(after.get_ydata(), np.float64)
        np.testing.assert_allclose(medians[np.isfinite(medians)], 0.0, atol=1e-9)
        assert np.ptp(np.asarray(curve.get_ydata(), np.float64)) > 1.0


@pytest.mark.parametrize(("row", "shown"), [(40.0, "rows 21 to 23"), (-7.0, "rows 0 to 2")])
def test_walls_of_a_part_of_an_array_are_drawn_next_to_a_principal_point_beside_it(
    row: float, shown: str, figures: list[Figure], tmp_path: Path
) -> None:
    origin = Origin(captures=("wall",), frames=1, pixels=(24, 32), periods_ns=(40.0, 20.0), waveform="sine")
    wall = WallFit(2.0, 0.0, True, (0.0, 0.0), 0.01, 0.001, 0.001, 768)
    petzval = PetzvalCalibration(origin, curved(0.05, -0.03, (15.0, row)), replace(PETZVAL_QUALITY, walls=(wall,)))
    draw_petzval([petzval.range_offset_m + 2.0], petzval, tmp_path / "a.png")
    assert figures[0].axes[0].get_title() == f"wall: {shown}"


@pytest.mark.parametrize("alone", [0, 30, 59])
def test_a_pixel_alone_on_a_line_is_drawn_as_a_point(alone: int, figures: list[Figure], tmp_path: Path) -> None:
    """A line joins neighbours, so a lone pixel needs a point. The first and the last pixel are no neighbours."""
    values = np.ones(60)
    values[[place for place in (alone - 1, alone + 1) if 0 <= place < 60]] = np.nan
    for curve in (np.ones(60), values):
        line = np.arange(60), np.zeros(60, np.intp)
        profile = Profile("direct.depth", "m", "row 0", "column", line[1], line[0], "range", (Curve("a", curve),), None)
        draw_profile(profile, tmp_path / "a.png")
    whole, broken = (figure.axes[0].get_lines()[0].get_marker() for figure in figures)
    assert (whole, broken) == ("None", ".")


def test_truth_and_first_phasors_of_pixels_alone_are_drawn_as_points(figures: list[Figure], tmp_path: Path) -> None:
    """Truth that was measured at some pixels only."""
    sparse = np.where(np.arange(60) % 5 == 0, 1.0, np.nan)
    line = np.arange(60), np.zeros(60, np.intp)
    for known in (np.ones(60), sparse):
        curve = Curve("a", np.ones(60), first_phasor=known)
        profile = Profile("direct.depth", "m", "row 0", "column", line[1], line[0], "range", (curve,), known)
        draw_profile(profile, tmp_path / "a.png")
    for figure, marker in zip(figures, ("None", "."), strict=True):
        drawn = {one.get_label(): one.get_marker() for one in figure.axes[0].get_lines()}
        assert (drawn["truth"], drawn["first phasor"], drawn["a"]) == (marker, marker, "None")


def _legend(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_pixels_with_fewer_paths_are_not_said_to_have_no_answer(figures: list[Figure], tmp_path: Path) -> None:
    """Pixels with one path, two, three, and without an answer, in the layers of the second and the third path."""
    status = np.array(
        [[StatusBit.ONE_PATH, StatusBit.TWO_PATHS, StatusBit.MORE_PATHS, StatusBit.NOT_FINITE]], np.uint32
    )
    nan = np.nan
    layers = {"direct": [1.0, 1.0, 1.0, nan], "mpi": [nan, 2.0, 2.0, nan], "path3": [nan, nan, 3.0, nan]}
    depths = {f"{name}.depth": np.array([values], np.float32) for name, values in layers.items()}
    write_exr(tmp_path / "a.exr", {**depths, "status": status})
    for name in layers:
        done = cadtof("preview", tmp_path / "a.exr", "--layer", f"{name}.depth", "-o", tmp_path / f"{name}.png")
        assert (done.status, done.err) == (0, "")
    none = "no answer: 25.0%"
    assert [_legend(one) for one in figures] == [[none], ["one path: 25.0%", none], ["fewer paths", none]]


def test_maps_without_status_are_not_said_to_have_no_answer(figures: list[Figure], tmp_path: Path) -> None:
    """Maps of other programs may lack it: then no panel shows the paths of each pixel, and no share is given."""
    depth = np.array([[1.0, 2.0], [3.0, np.nan]], np.float32)
    write_exr(tmp_path / "a.exr", dict.fromkeys(("direct.depth", "mpi.depth", "confidence", "direct.sigma"), depth))
    done = cadtof("preview", tmp_path / "a.exr", "-o", tmp_path / "a.png")
    assert (done.status, done.err) == (0, "")
    (figure,) = figures
    assert _legend(figure) == ["no answer"]
    assert "paths" not in [text.get_text() for text in figure.texts]


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 2), (1, 300), (2000, 4)])
def test_frames_of_few_rows_or_columns_can_be_seen(
    height: int, width: int, figures: list[Figure], tmp_path: Path
) -> None:
    """Panels and bars are at least .4 inches high and panels as wide; pixels are counted in whole numbers."""
    names = ("direct.depth", "mpi.depth", "confidence", "direct.sigma")
    write_exr(tmp_path / "a.exr", {name: np.ones((height, width), np.float32) for name in names})
    for more in ((), ("--layer", "direct.depth")):
        assert cadtof("preview", tmp_path / "a.exr", "-o", tmp_path / "a.png", "--overwrite", *more).status == 0
    for figure in figures:
        for axes in figure.axes:
            box = axes.get_window_extent().transformed(figure.dpi_scale_trans.inverted())
            assert box.height > 0.39
            if axes.images:
                assert box.width > 0.39
                places = [*axes.get_xticks(), *axes.get_yticks()]
                assert places == [round(place) for place in places]


@pytest.mark.parametrize("value", [-2.0, 0.0, np.nan, np.inf, 1e30])
def test_layers_of_other_programs_are_drawn_whatever_they_hold(
    value: float, figures: list[Figure], tmp_path: Path
) -> None:
    """Nothing keeps another program from writing a sigma or an amplitude below 0."""
    names = ("direct.depth", "direct.sigma", "direct.amplitude", "confidence")
    write_exr(tmp_path / "a.exr", {name: np.full((24, 32), value, np.float32) for name in names})
    done = cadtof("preview", tmp_path / "a.exr", "-o", tmp_path / "a.png")
    assert (done.status, done.err) == (0, "")
    assert cadtof("profile", tmp_path / "a.exr", "--row", 3, "-o", tmp_path / "b.png").status == 0
    assert len(figures) == 2


def test_classes_of_pixels_are_told_apart_by_everybody() -> None:
    """From each other, and, where a layer has no value, from the colours of its scale."""
    classes = [one for one in PixelClass if one is not PixelClass.IN_ONE]
    shown = rgb(*dict.fromkeys(one.colour for one in classes))
    none = rgb(PixelClass.NO_ANSWER.colour, PixelClass.SATURATED.colour)
    for seen in SEEN:
        distances = apart(shown, shown, seen)[np.triu_indices(len(shown), 1)]
        assert distances.min() > (6.0 if seen == "in black and white" else 15.0), seen
        # in black and white, no grey can be missing in a scale from dark to bright
        for scale in ("viridis", "plasma", "magma", "inferno", "RdBu_r") if seen != "in black and white" else ():
            assert apart(none, mpl.colormaps[scale](np.linspace(0.0, 1.0, 256))[:, :3], seen).min() > 12.0, scale


@pytest.mark.parametrize("truth", [False, True])
def test_the_legend_of_many_runs_is_whole(truth: bool, figures: list[Figure], tmp_path: Path) -> None:
    """No two runs have the same colour and kind of line. In black and white, the first three still differ."""
    place, along = np.arange(9), np.arange(9.0)
    curves = tuple(Curve(f"a run with a long name {run}", along + run, np.ones(9)) for run in range(18))
    expected = along if truth else None
    draw_profile(
        Profile("direct.depth", "m", "row 0", "column", place, place, "range", curves, expected), tmp_path / "a.png"
    )
    _require_whole(figures[0])
    lines = [line for line in figures[0].axes[0].get_lines() if "long name" in str(line.get_label())]
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 18
    assert len({line.get_linestyle() for line in lines[:3]}) == 3


def test_runs_of_any_name_stand_in_the_legend(figures: list[Figure], tmp_path: Path) -> None:
    """Matplotlib hides labels that begin with `_`, and cannot write a byte order mark into a PDF. Long names are cut."""
    place, along = np.arange(9), np.arange(9.0)
    curves = tuple(Curve(name, along, None) for name in ("_run", "a\ufeffb\u202ec", "a/folder/" * 12 + "end"))
    draw_profile(
        Profile("direct.depth", "m", "row 0", "column", place, place, "range", curves, None), tmp_path / "a.pdf"
    )
    legend = figures[0].axes[0].get_legend()
    assert legend is not None
    *names, cut = [text.get_text().strip() for text in legend.get_texts()]
    assert names == ["_run", r"a\ufeffb\u202ec"]
    assert len(cut) == 34
    assert cut.endswith("end")
    _require_whole(figures[0])


@pytest.mark.parametrize(
    ("mpi", "asr", "lengths"),
    [("0", "0,1", "1e5"), ("0.3", "1:60:60", "log:1e2:1e7:24"), ("0,0.1,0.3", "1:6:6", "log:1e3:1e5:5")],
)
def test_heat_maps_of_any_grid_are_whole_and_their_axes_readable(
    mpi: str, asr: str, lengths: str, figures: list[Figure], tmp_path: Path
) -> None:
    done = cadtof(
        *("sweep", "--asr", asr, "--mpi", mpi, "--integration-length", lengths, "--runs", 2, "-j", 1, "-q"),
        *("-o", tmp_path / "a.csv", "--plot", tmp_path / "a"),
    )
    assert done.status == 0
    for figure in figures:
        _require_whole(figure)
        for axes in (axes for axes in figure.axes if axes.images):
            for axis in (axes.xaxis, axes.yaxis):
                boxes = [tick.label1.get_window_extent() for tick in axis.get_major_ticks()]
                assert not any(_overlap(one, two) for one, two in itertools.pairwise(boxes))


def _require_whole(figure: Figure) -> None:
    """Make sure that all text lies within the figure, headings do not overlap, legends are beside curves, axes are labelled."""
    figure.draw_without_rendering()
    page = figure.bbox
    shown = [axes for axes in figure.axes if axes.get_visible() and axes.axison]
    legends = [one for one in (*figure.legends, *(axes.get_legend() for axes in shown)) if one is not None]
    for text in _texts(figure, shown):
        assert _inside(text[1], page), f"{text[0]!r} is cut off"
    for legend in legends:
        box = legend.get_window_extent()
        assert _inside(box, page), "a legend is cut off"
        for axes in shown:
            if axes.get_lines() or axes.images:
                assert not _overlap(box, axes.get_window_extent()), "a legend lies on curves"
    headings = [(text.get_text(), text.get_window_extent()) for text in figure.texts if text.get_text()]
    headings += [(axes.get_title(), axes.title.get_window_extent()) for axes in shown if axes.get_title()]
    for number, (name, box) in enumerate(headings):
        for other, other_box in headings[:number]:
            assert not _overlap(box, other_box), f"{name!r} overlaps {other!r}"
    assert any(axes.get_xlabel() for axes in shown) or not any(axes.images for axes in shown)
    assert any(axes.get_ylabel() for axes in shown)


def _texts(figure: Figure, shown: list[Axes]) -> Iterator[tuple[str, BboxBase]]:
    for axes in shown:
        texts = [axes.title, axes.xaxis.label, axes.yaxis.label]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            texts += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        for text in texts:
            if text.get_text() and text.get_visible():
                yield text.get_text(), text.get_window_extent()
    for text in figure.texts:
        yield text.get_text(), text.get_window_extent()


def _inside(box: BboxBase, page: BboxBase) -> bool:
    return bool(box.x0 >= -1 and box.y0 >= -1 and box.x1 <= page.x1 + 1 and box.y1 <= page.y1 + 1)


def _overlap(box: BboxBase, other: BboxBase) -> bool:
    return bool(min(box.x1, other.x1) - max(box.x0, other.x0) > 1 and min(box.y1, other.y1) - max(box.y0, other.y0) > 1)


@pytest.mark.parametrize(
    ("command", "kind", "magic"),
    [
        ("preview of maps", "svg", b"<?xml"),
        ("preview of maps", "jpg", b"\xff\xd8\xff"),
        ("compare", "jpeg", b"\xff\xd8\xff"),
        ("profile", "pdf", b"%PDF"),
        ("inspect", "png", b"\x89PNG"),
    ],
)
def test_pictures_are_replaced_only_with_overwrite_and_have_known_suffixes(
    command: str, kind: str, magic: bytes, place: Path, tmp_path: Path
) -> None:
    existing = tmp_path / f"a.{kind}"
    existing.write_text("mine")
    done = cadtof(*_typed(place, command), "-o", existing)
    assert (done.status, "already exists; add --overwrite" in done.err) == (2, True)
    assert existing.read_text() == "mine"
    assert cadtof(*_typed(place, command), "-o", existing, "--overwrite").status == 0
    assert existing.read_bytes().startswith(magic)
    done = cadtof(*_typed(place, command), "-o", tmp_path / "a.bmp")
    assert (done.status, "found the suffix '.bmp', expected one of .png" in done.err) == (2, True)
