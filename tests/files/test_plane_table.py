"""The labels of axes and the names of planes say which plane is which: any array is put into our order."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from cadtof_cli.capture.frames import FrameSource, read_stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.exr_planes import NamedPart, Place, voltage_places
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.plane_table import plane_table

counts = st.integers(1, 6)
harmonics = st.integers(1, 3).map(lambda n: tuple(range(1, n + 1)))


@given(counts, harmonics, st.permutations("THC"))
def test_labelled_frames_and_channels_are_found_wherever_they_are(
    count: int, numbers: tuple[int, ...], order: list[str]
) -> None:
    # the value of plane (t, h, c) is its place in our order; the file holds the planes in another order
    truth = np.arange(count * len(numbers) * 2).reshape(count, len(numbers), 2)
    stored = truth.transpose(["THC".index(label) for label in order])
    table = plane_table("".join(order), stored.shape, FrameLayout(numbers), where="file")
    assert np.array_equal(stored.ravel()[table], truth)


@given(counts, harmonics, st.sampled_from(["THC", "T(HC)", "(THC)"]))
def test_planes_in_our_order_need_no_labels(count: int, numbers: tuple[int, ...], form: str) -> None:
    sizes = {"THC": (count, len(numbers), 2), "T(HC)": (count, 2 * len(numbers)), "(THC)": (count * len(numbers) * 2,)}
    layout = FrameLayout(numbers, count if form == "(THC)" else None)
    table = plane_table("Q" * len(sizes[form]), sizes[form], layout, where="file")
    assert np.array_equal(table, np.arange(count * len(numbers) * 2).reshape(count, len(numbers), 2))


@given(st.lists(st.tuples(st.sampled_from("TZCSQIH"), st.integers(1, 5)), max_size=5), harmonics, st.none() | counts)
def test_any_axes_give_whole_frames_or_an_error(
    axes: list[tuple[str, int]], numbers: tuple[int, ...], frames: int | None
) -> None:
    labels, sizes = "".join(label for label, _ in axes), [size for _, size in axes]
    layout = FrameLayout(numbers, frames)
    try:
        table = plane_table(labels, sizes, layout, where="file")
    except FrameError:
        return
    assert table.shape[1:] == (len(numbers), 2)
    assert sorted(table.ravel()) == list(range(int(np.prod(sizes))))
    assert frames in (None, len(table))


@pytest.mark.parametrize("sizes", [s for s in itertools.product((1, 2, 3, 4), repeat=2) if np.prod(s) % 4])
def test_planes_that_are_not_whole_frames(sizes: tuple[int, int]) -> None:
    with pytest.raises(FrameError, match="expected 4 for one frame"):
        plane_table("QQ", sizes, FrameLayout((1, 2)), where="file: found so many")


def test_a_channel_axis_in_front_of_an_unlabelled_one() -> None:
    table = plane_table("CZ", (2, 2), FrameLayout((1, 2)), where="file")
    assert table.tolist() == [[[0, 2], [1, 3]]]


@given(
    st.permutations(range(12)),
    st.sampled_from(["H{}.SC{}", "h{}_sc{}", "H{}/SC{}", "H{} Sc{}", "H{}SC{}", " h{}-SC{} "]),
)
def test_names_win_over_any_order(order: list[int], form: str) -> None:
    # three frames: of the planes with one name, the first belongs to the first frame
    names = [form.format(1 + place // 2 % 2, 1 + place % 2) for place in order]
    table = plane_table("Q", (12,), FrameLayout((1, 2)), where="file", names=names)
    for harmonic, channel in itertools.product(range(2), range(2)):
        places = [i for i, place in enumerate(order) if place % 4 == 2 * harmonic + channel]
        assert table[:, harmonic, channel].tolist() == places


WORDS = (
    *("sc{1}_h{0}", "Harmonic {0}, SC{1}", "rec 3_h{0}_sc{1}.tif", "H0{0}.SC0{1}", "h{0}.sc{1} (V)", "{2} MHz SC{1}"),
    *("SC{1}.{2}MHz", "sc{1}-{2}.0 MHz", "SC{1}_{2}MHz", "{2}MHz.SC{1}", "SC{1}.H{0}"),
)
"""Names that say harmonic {0}, or frequency {2}, and channel {1}."""


@given(st.permutations(range(8)), st.sampled_from(WORDS))
def test_names_in_other_words_win_over_any_order_too(order: list[int], form: str) -> None:
    # two frames
    names = [form.format(1 + place // 2 % 2, 1 + place % 2, (25, 50)[place // 2 % 2]) for place in order]
    table = plane_table("Q", (8,), FrameLayout((1, 2), 2), where="file", names=names)
    for harmonic, channel in itertools.product(range(2), range(2)):
        places = [i for i, place in enumerate(order) if place % 4 == 2 * harmonic + channel]
        assert table[:, harmonic, channel].tolist() == places


@given(st.permutations(range(4)), st.sampled_from(WORDS), st.booleans())
def test_channels_and_parts_of_an_exr_go_by_the_same_words(order: list[int], form: str, apart: bool) -> None:
    names = [form.format(1 + place // 2, 1 + place % 2, (25, 50)[place // 2]) for place in order]
    parts = [NamedPart(name, ("Y",)) for name in names] if apart else [NamedPart("", tuple(names))]
    places = voltage_places(parts, FrameLayout((1, 2)), where="file")
    expected = [order.index(place) for place in range(4)]
    assert places == [Place(i, "Y") if apart else Place(0, names[i]) for i in expected]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["SC1.25MHz", "SC2.25MHz", "SC1.50MHz"], "holds the channels SC1.25MHz, SC2.25MHz, SC1.50MHz, expected"),
        (["SC1.20MHz", "SC2.20MHz", "SC1.50MHz", "SC2.50MHz"], "holds the channels SC1.20MHz"),
        (["SC1.25MHz", "SC2.25MHz", "SC1.50MHz", "SC2.50MHz", "other"], "holds the channels SC1.25MHz"),
        (["SC1.25MHz", "SC2.25MHz", "SC1.50MHz", "SC2.50MHz", "sc1_25MHz"], "found H1.SC1 twice"),
    ],
)
def test_words_in_an_exr_that_do_not_say_each_plane_once_are_no_frame(names: list[str], expected: str) -> None:
    with pytest.raises(FrameError, match=expected):
        voltage_places([NamedPart("", tuple(names))], FrameLayout((1, 2)), where="file")


@pytest.mark.parametrize(
    "names",
    [
        ["SC2 at H2, no. 1", "SC1 at H2", "SC2, H1", "first"],
        ["disc2", "disc1", "disc2", "disc1"],
        ["50 MHz SC1", "50 MHz SC2", "20 MHz SC1", "20 MHz SC2"],
        ["a SC1, SC2 of H1 and H2"] * 4,
        [f"{'a long story of ' * 20} h{harmonic} sc{channel}" for harmonic in (2, 1) for channel in (2, 1)],
        ["camera SC1"] * 4,
        ["SC1 A", "SC2 A", "SC1 B", "B"],
        ["0 ns SC1"] * 2 + ["none"] * 2,
    ],
)
def test_words_that_do_not_say_each_plane_leave_the_order(names: list[str]) -> None:
    assert plane_table("Q", (4,), FrameLayout((1, 2)), where="file", names=names).tolist() == [[[0, 1], [2, 3]]]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["SC2", "SC1", "SC2", "SC1"], [[[1, 0], [3, 2]]]),
        (["H2", "H2", "H1", "H1"], [[[2, 3], [0, 1]]]),
        (["disc1 h2", "disc2 h2", "disc1 h1", "disc2 h1"], [[[2, 3], [0, 1]]]),
        (["50 MHz A", "50 MHz B", "25 MHz A", "25 MHz B"], [[[2, 3], [0, 1]]]),
        (["DAPI", "GFP", "", "Cy5"], [[[0, 1], [2, 3]]]),
        (["H1.SC1", "H1.SC2", "H3.SC1", "H3.SC2"], [[[0, 1], [2, 3]]]),
    ],
)
def test_names_that_say_a_part_leave_the_rest_to_the_order(names: list[str], expected: list[list[list[int]]]) -> None:
    harmonics = (1, 3) if "H3.SC1" in names else (1, 2)
    assert plane_table("Q", (4,), FrameLayout(harmonics), where="file", names=names).tolist() == expected


@pytest.mark.parametrize("names", [["H1 A", "H2 A", "H1 B", "H2 B"], ["H1.SC0", "H2.SC0", "H1.SC1", "H2.SC1"]])
def test_pages_whose_names_contradict_their_order_are_refused(names: list[str], tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "frame.tif") as file:
        for name in names:
            file.write(np.zeros((2, 3), np.uint16), description=name, metadata=None)
    with pytest.raises(FrameError, match=r"names mean the same plane|no channel H1.SC2, H2.SC2"):
        read_stored(FrameSource("frame", (tmp_path / "frame.tif",)), FrameLayout((1, 2)))


@pytest.mark.parametrize("rounded", [(17, 33), (33, 67), (14, 29), (13, 25)])
def test_frequencies_may_be_rounded_to_whole_numbers(rounded: tuple[int, int]) -> None:
    """Periods of 60, 30, 70 and 80 ns, and half as long."""
    names = [f"SC{channel} {mhz} MHz" for mhz in reversed(rounded) for channel in (1, 2)]
    layout = FrameLayout((1, 2), period_ns=1e3 / rounded[1] * 2.0)
    assert plane_table("Q", (4,), layout, where="file", names=names).tolist() == [[[2, 3], [0, 1]]]


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("20 MHz", "40 MHz"), "20, 40 MHz"),
        (("25 MHz", "75 MHz"), "25, 75 MHz"),
        (("50 ns", "25 ns"), "20, 40 MHz"),
        (("24 MHz", "48 MHz"), None),
        (("40 ns", "20 ns"), None),
    ],
)
def test_frequencies_in_names_are_those_of_the_capture(words: tuple[str, str], found: str | None) -> None:
    """With other periods, every depth would be wrong in proportion. Names may be rounded: 24 for 25 MHz."""
    names = [f"SC{channel} {word}" for word in words for channel in (1, 2)]
    layout = FrameLayout((1, 2), period_ns=40.0)
    planes = NamedPart("", tuple(names))
    parts = [NamedPart(word, ("SC1", "SC2")) for word in words]
    for read in (
        lambda: plane_table("Q", (4,), layout, where="file", names=names),
        lambda: voltage_places([planes], layout, where="file"),
        lambda: voltage_places(parts, layout, where="file"),
    ):
        if found is None:
            read()
        else:
            with pytest.raises(FrameError, match=f"file: found planes named by {found}, expected 25, 50 MHz as of "):
                read()


def test_frequencies_in_the_names_of_files_are_those_of_the_capture(tmp_path: Path) -> None:
    files = [tmp_path / f"rec_{mhz}MHz_SC{channel}.tif" for mhz in (20, 40) for channel in (1, 2)]
    for file in files:
        tifffile.imwrite(file, np.zeros((2, 3), np.uint16))
    source = FrameSource("rec", tuple(files))
    assert read_stored(source, FrameLayout((1, 2), period_ns=50.0)).shape == (2, 2, 2, 3)
    with pytest.raises(FrameError, match="found planes named by 20, 40 MHz, expected 25, 50 MHz as of "):
        read_stored(source, FrameLayout((1, 2), period_ns=40.0))


@pytest.mark.parametrize("unnamed", ["a preview", ""])
def test_a_first_page_without_a_name_does_not_hide_the_names_of_the_others(tmp_path: Path, unnamed: str) -> None:
    planes = np.arange(5 * 6, dtype=np.uint16).reshape(5, 2, 3)
    with tifffile.TiffWriter(tmp_path / "frame.tif") as file:
        for name, plane in zip((unnamed, "H2.SC2", "H2.SC1", "H1.SC2", "H1.SC1"), planes, strict=True):
            file.write(plane, description=name or None, metadata=None)
    frame = read_stored(FrameSource("frame", (tmp_path / "frame.tif",)), FrameLayout((1, 2)))
    assert np.array_equal(frame.reshape(4, 2, 3), planes[:0:-1])


def test_a_tiff_of_which_a_plane_has_no_name_is_refused(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "frame.tif") as file:
        for name in ("other", "H1.SC1", "H1.SC2", "H2.SC1"):
            file.write(np.zeros((2, 3), np.uint16), description=name, metadata=None)
    with pytest.raises(FrameError, match=r"no channel H2\.SC2; found H1\.SC1, H1\.SC2, H2\.SC1"):
        read_stored(FrameSource("frame", (tmp_path / "frame.tif",)), FrameLayout((1, 2)))


def test_planes_without_a_voltages_name_are_passed_over() -> None:
    names = ["preview", "H2.SC2", "H2.SC1", "H1.SC2", "H1.SC1"]
    assert plane_table("C", (5,), FrameLayout((1, 2)), where="file", names=names).tolist() == [[[4, 3], [2, 1]]]


@pytest.mark.parametrize(
    ("names", "frames", "found"),
    [
        (["H1.SC1", "H1.SC2", "H2.SC1", "x"], None, "file: no channel H2.SC2; found H1.SC1, H1.SC2, H2.SC1"),
        (["H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2", "H1.SC1"], None, "2 of them are named H1.SC1"),
        ([*("H1.SC1", "H1.SC2", "H2.SC1") * 2, "H2.SC2", "H2.SC1"], None, "3 of them are named H2.SC1"),
        (["H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2"], 2, "expected layout.frames = 2"),
        (["SC1", "SC1", "SC1", "SC2"], None, "found two planes whose names mean the same plane"),
        (["H1", "H1", "H5", "H5"], None, "found a plane of harmonic 5"),
    ],
)
def test_names_that_do_not_fit_are_refused(names: list[str], frames: int | None, found: str) -> None:
    if frames and len(names) == 4:
        names = names * 3
    with pytest.raises(FrameError, match=found):
        plane_table("Q", (len(names),), FrameLayout((1, 2), frames), where="file", names=names)


@pytest.mark.parametrize(("parts", "first"), [(("50MHz", "25MHz"), 1), (("25MHz", "50MHz"), 0), (("far", "near"), 0)])
def test_parts_called_by_their_frequency(parts: tuple[str, str], first: int) -> None:
    named = [NamedPart(name, ("SC1", "SC2")) for name in parts]
    places = voltage_places(named, FrameLayout((1, 2)), where="file")
    assert [place.part for place in places] == [first, first, 1 - first, 1 - first]


@pytest.mark.parametrize(
    "name",
    [
        "SC{c} {period} ns",
        "{period}ns_sc{c}.tif",
        "SC{c}.{period}ns",
        "T={period} ns, SC{c}",
        "{frequency} MHz, {period} ns: SC{c}",
    ],
)
def test_planes_may_be_named_by_their_period(name: str) -> None:
    names = [
        name.format(c=channel, period=period, frequency=1000 / period) for channel in (1, 2) for period in (20.0, 40.0)
    ]
    table = plane_table("Q", [4], FrameLayout((1, 2)), where="file", names=names)
    assert table.tolist() == [[[1, 3], [0, 2]]]


@pytest.mark.parametrize(
    "names",
    [
        ["SC1 A", "SC1 B", "SC2 A", "SC2 B"],
        ["SC1", "SC1", "SC2", "SC2"],
        ["SC1, 20 nsteps", "SC1, 40 nsteps", "SC2, 20 nsteps", "SC2, 40 nsteps"],
    ],
)
def test_names_that_say_channels_alone_count_harmonics_in_their_order(names: list[str]) -> None:
    layout = FrameLayout((1, 3))
    assert plane_table("Q", [4], layout, where="file", names=names).tolist() == [[[0, 2], [1, 3]]]
    turned = [names[2], names[0], names[3], names[1]]
    assert plane_table("Q", [4], layout, where="file", names=turned).tolist() == [[[1, 0], [3, 2]]]
    assert plane_table("CH", [2, 2], layout, where="file", names=names).tolist() == [[[0, 2], [1, 3]]]


def test_names_of_a_stack_that_say_channels_alone_must_agree_with_its_order() -> None:
    layout = FrameLayout((1, 2), 2)
    names = [f"SC{channel} of frame {frame}" for frame in (0, 1) for channel in (1, 2, 1, 2)]
    table = plane_table("Q", [8], layout, where="file", names=names)
    assert table.ravel().tolist() == list(range(8))
    with pytest.raises(FrameError, match="found two planes whose names mean the same plane"):
        plane_table("Q", [8], layout, where="file", names=sorted(names))


@pytest.mark.parametrize("names", [("H2.SC2", "H1.SC1", "H2.SC1", "H1.SC2"), ()])
def test_the_bands_of_a_geotiff_are_planes_by_their_descriptions(names: tuple[str, ...], tmp_path: Path) -> None:
    """GDAL writes them into tag 42112; without them, the bands are in our order."""
    ours = ["H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2"]
    items = [f'<Item name="DESCRIPTION" sample="{n}" role="description">{name}</Item>' for n, name in enumerate(names)]
    about = f"<GDALMetadata><Item name='made by'>a test</Item>{''.join(items)}</GDALMetadata>"
    truth = np.arange(4 * 6 * 5, dtype=np.uint16).reshape(4, 6, 5)
    bands = truth[[ours.index(name) for name in names or ours]].transpose(1, 2, 0)
    path = tmp_path / "frame.tif"
    tags = [(42112, "s", 0, about, True)]
    tifffile.imwrite(path, bands, photometric="minisblack", planarconfig="contig", metadata=None, extratags=tags)
    stored = read_stored(FrameSource("frame", (path,)), FrameLayout((1, 2)))
    assert np.array_equal(stored.reshape(truth.shape), truth)
