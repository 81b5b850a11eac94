"""How many pixels of each frame a page holds, and the colours of its pictures."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from cadtof_cli.report import frames as report_frames
from cadtof_cli.report.colours import Limits, palette, thumbnail, widen
from cadtof_cli.report.frames import EmbeddedFrame, Planes, embedded_frame, planned_page, sampled

MB = 1_000_000


def _planes(height: int = 240, width: int = 320, layers: int = 8) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    return {f"layer{k}.depth": rng.normal(2.0, 0.1, (height, width)).astype(np.float32) for k in range(layers)}


@pytest.mark.parametrize(
    ("shape", "step", "first"), [((7, 9), 3, (1, 1)), ((8, 8), 1, (0, 0)), ((2, 9), 8, (0, 4)), ((1, 1), 5, (0, 0))]
)
def test_every_nth_pixel_is_one_of_the_plane(shape: tuple[int, int], step: int, first: tuple[int, int]) -> None:
    plane = np.arange(shape[0] * shape[1]).reshape(shape)
    kept = sampled(plane, step)
    assert kept[0, 0] == plane[first]
    assert kept.size == -(-(shape[0] - first[0]) // step) * -(-(shape[1] - first[1]) // step)


def test_frames_that_fit_keep_all_pixels() -> None:
    plan = planned_page([_planes()], 5, limit_bytes=25 * MB, whole=None)
    assert [plan.step_of(place) for place in range(5)] == [1] * 5
    assert plan.thumbnail_px == 80


def test_all_pixels_are_compressed_once_to_measure_them(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[int] = []

    def counted(planes: Planes, *, step: int) -> EmbeddedFrame:
        steps.append(step)
        return embedded_frame(planes, step=step)

    monkeypatch.setattr(report_frames, "embedded_frame", counted)
    planned_page([_planes(layers=1)], 40, limit_bytes=2 * MB, whole=None)
    assert steps.count(1) == 1


@pytest.mark.parametrize(("frames", "limit_mb"), [(40, 10), (500, 25), (2000, 25)])
def test_frames_that_do_not_fit_are_thinned_out(frames: int, limit_mb: float) -> None:
    """Frames with all pixels are spread over the run, and all frames together stay below the limit."""
    planes = _planes()
    plan = planned_page([planes], frames, limit_bytes=limit_mb * MB, whole=None)
    assert plan.step > 1
    assert 0 < len(plan.whole) < frames
    assert {0, frames - 1} <= plan.whole or len(plan.whole) == 1
    whole, thin = (len(embedded_frame(planes, step=step).data) for step in (1, plan.step))
    taken = len(plan.whole) * whole + (frames - len(plan.whole)) * thin
    assert 0.5 * limit_mb * MB < taken < limit_mb * MB


def test_as_many_whole_frames_as_are_asked_for() -> None:
    plan = planned_page([_planes()], 100, limit_bytes=2 * MB, whole=7)
    assert len(plan.whole) == 7
    assert plan.step == 20  # the longer side keeps 16 pixels
    assert planned_page([_planes()], 3, limit_bytes=2 * MB, whole=7).whole == {0, 1, 2}
    assert planned_page([_planes()], 3, limit_bytes=2 * MB, whole=0).whole == set()


def test_no_frame_is_whole_if_thumbnails_alone_exceed_the_limit() -> None:
    plan = planned_page([_planes()], 20_000, limit_bytes=0.0, whole=None)
    assert (plan.whole, plan.step, plan.thumbnail_px) == (frozenset(), 20, 20)


def test_only_as_many_frames_are_shown_as_fit() -> None:
    """They are spread over the run, from the first frame to the last one."""
    places = planned_page([_planes()], 20_000, limit_bytes=25 * MB, whole=None).shown
    assert {0, 19_999} <= places
    assert 2000 < len(places) < 5000
    gaps = np.diff(sorted(places))
    assert gaps.max() - gaps.min() <= 1
    assert planned_page([_planes()], 500, limit_bytes=25 * MB, whole=None).shown == set(range(500))
    assert len(planned_page([_planes()], 5, limit_bytes=0.0, whole=None).shown) == 1
    assert len(planned_page([_planes()], 5, limit_bytes=0.0, whole=4).shown) == 4


def test_thumbnails_shrink_if_there_are_many() -> None:
    assert planned_page([_planes()], 5000, limit_bytes=25 * MB, whole=None).thumbnail_px < 80


def test_a_thumbnail_has_the_colours_of_the_scale_between_its_limits() -> None:
    scale, none = palette()["sequential"], palette()["no_answer"]
    nearest, middle, farthest = scale[0], scale[len(scale) // 2], scale[-1]
    depth_m = np.array([[1.0, 2.0, 3.0], [0.5, 9.0, np.nan]], np.float32)
    for limits_m, expected in (
        ((1.0, 3.0), [nearest, middle, farthest, nearest, farthest, none]),
        ((1.0, 1.0), [nearest, farthest, farthest, nearest, farthest, none]),
        ((np.nan, np.nan), [none] * 6),
    ):
        picture = base64.b64decode(thumbnail(depth_m, limits_m).removeprefix("data:image/png;base64,"))
        colours = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).reshape(-1, 3)
        assert [f"#{colour.tobytes().hex()}" for colour in colours] == expected


@pytest.mark.parametrize("size", [(1000, 1000), (2000, 2000), (1024, 1280), (1, 2000), (240, 320), (3, 4)])
def test_the_colours_suit_all_columns_and_rows(size: tuple[int, int]) -> None:
    y, x = np.mgrid[: size[0], : size[1]]
    for values in (y, x):
        limits: dict[str, Limits] = {}
        widen(limits, "direct.depth", values)
        low, high, lowest, highest = limits["direct.depth"]
        last = values.max()
        assert lowest <= low <= 0.02 * last
        assert highest >= high >= 0.97 * last
        assert highest >= 0.995 * last
