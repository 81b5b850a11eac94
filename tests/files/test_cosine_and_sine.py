"""Planes whose names call the channels I and Q, or cosine and sine: SC1 is the mean cosine, SC2 the mean sine."""

from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.capture.frames import FrameSource, read_stored
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.named_planes import is_of_a_plane
from cadtof_cli.files.plane_table import plane_table

LAYOUT = FrameLayout((1, 2))


@pytest.mark.parametrize(
    "names",
    [
        ["I 40 ns", "I 20 ns", "Q 40 ns", "Q 20 ns"],
        ["h1 cos", "h2 cos", "h1 sin", "h2 sin"],
        ["in-phase, 25 MHz", "in-phase, 50 MHz", "quadrature, 25 MHz", "quadrature, 50 MHz"],
        ["I", "I", "Q", "Q"],
        ["h1 real", "h2 real", "h1 imag", "h2 imag"],
        ["Kosinus 25 MHz", "Kosinus 50 MHz", "Sinus 25 MHz", "Sinus 50 MHz"],
        ["Harmonische 1_0°", "Harmonische 2_0°", "Harmonische 1_90°", "Harmonische 2_90°"],
        ["target 90deg I h1", "target 90deg I h2", "target 90deg Q h1", "target 90deg Q h2"],
    ],
)
def test_cosine_and_sine_are_channels_1_and_2(names: list[str]) -> None:
    """The pages are in the order cosine, cosine, sine, sine, so their order alone would mix harmonics and channels."""
    table = plane_table("Q", [4], LAYOUT, where="file", names=names)
    assert table.tolist() == [[[0, 2], [1, 3]]]


@pytest.mark.parametrize(
    "name",
    ["index", "quiz", "I and Q", "rec_iq.tif", "cosine sine", "single", "sinusoid", "100 deg", "190deg", "imaging"],
)
def test_other_words_are_no_channels(name: str) -> None:
    assert not is_of_a_plane(name)


def test_sc1_and_sc2_go_before_other_words() -> None:
    """A name such as `SC2 (sine), H1` gives its channel twice; SC2 counts."""
    names = [f"{channel} of I recordings, H{h}" for channel in ("SC2", "SC1") for h in (1, 2)]
    table = plane_table("Q", [4], LAYOUT, where="file", names=names)
    assert table.tolist() == [[[2, 0], [3, 1]]]


def test_pages_of_a_tiff_by_cosine_and_sine(tmp_path: Path) -> None:
    frame = np.arange(4 * 6, dtype=np.uint16).reshape(2, 2, 2, 3)
    path = tmp_path / "frame.tif"
    with tifffile.TiffWriter(path) as file:
        for channel, word in enumerate("IQ"):
            for harmonic, period in enumerate((40, 20)):
                tag = [(285, "s", 0, f"{word} {period} ns", True)]
                file.write(frame[harmonic, channel], extratags=tag, metadata=None, photometric="minisblack")
    assert np.array_equal(read_stored(FrameSource("frame", (path,)), LAYOUT), frame)
