"""Which plane is which, from a file's axes: an array laid out by its labels is put back in our order."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.tiff.axes import plane_table

counts = st.integers(1, 6)
harmonics = st.integers(1, 3).map(lambda n: tuple(range(1, n + 1)))


@given(counts, harmonics, st.permutations("THC"))
def test_labelled_frames_and_channels_are_found_wherever_they_are(
    count: int, numbers: tuple[int, ...], order: list[str]
) -> None:
    # plane t, h, c has the number it would have in our order; the file holds them in another
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
