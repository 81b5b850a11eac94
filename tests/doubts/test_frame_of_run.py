"""What a run says of single frames whose maps are likely wrong."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.doubts.frame import frame_doubts
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.status import StatusCounts
from tests.support.captures import TOML, write_frame
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, T1_NS, step_frame
from tests.support.run_cadtof import cadtof

RANGE_M = C_M_PER_NS * T1_NS / 2.0


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("farthest_m", "is_told"), [(5.98, False), (6.5, True)])
def test_a_surface_that_goes_on_beyond_the_range_is_told(
    tmp_path: Path, farthest_m: float, is_told: bool, turned: bool
) -> None:
    """The part beyond was 6 m too near, with a sigma of millimetres, in silence. The wall leans to one side, or back."""
    depth_m = np.linspace(5.5, farthest_m, 100) * np.ones((100, 1))
    phases = (
        2.0 * np.pi * (depth_m.T if turned else depth_m) / RANGE_M * np.array([1.0, 2.0])[:, np.newaxis, np.newaxis]
    )
    pulse = np.exp(-0.5 * (np.array([1.0, 2.0]) * 2.0 * np.pi / T1_NS * 1.7 / 2.354820045) ** 2)[
        :, np.newaxis, np.newaxis
    ]
    volts = 0.5 * AMPLITUDE_V * np.stack([pulse * np.cos(phases), pulse * np.sin(phases)], axis=1)
    capture = tmp_path / "wall"
    capture.mkdir()
    (capture / "capture.toml").write_text(TOML["exr"])
    write_frame(capture / "frame.exr", volts + np.random.default_rng(1).normal(0.0, 5e-4, volts.shape))
    out = tmp_path / "maps"
    done = cadtof("resolve", capture, "-o", out, "--jobs", 1)
    told = (
        "depths go on at 0 where surfaces are 6 m away, the range of periods_ns: what is farther comes out 6 m too near"
    )
    assert done.status == 0
    assert (f"{out / 'frame.exr'}: {told}" in done.err) == is_told
    assert (told in (json.loads((out / "frames.jsonl").read_text())["reason"] or "")) == is_told


@pytest.mark.parametrize(
    ("counts", "is_told"), [((60, 60, 648), True), ((60, 348, 360), True), ((300, 60, 408), False)]
)
def test_planes_are_looked_at_if_few_answers_are_one_path(counts: tuple[int, int, int], is_told: bool) -> None:
    """With `--paths 3`, wrong planes give most pixels more than two paths."""
    metadata = CaptureMetadata(modulation=Modulation(amplitude_v=AMPLITUDE_V), pixel=Pixel(integration_length=1e5))
    swapped, one_depth = step_frame(np.random.default_rng(2))[:, ::-1], np.ones((3, 24, 32), np.float32)
    maps = DepthMaps(("direct.depth", "direct.sigma"), one_depth, np.zeros((24, 32), np.uint32))
    told = frame_doubts(swapped, maps, StatusCounts(*counts, diffuse=0, invalid=0), FramePlan(metadata=metadata))
    assert ["with SC1 and SC2 swapped" in one for one in told] == [True] * is_told


@pytest.mark.parametrize(
    ("harmonics", "chi_squared", "is_told"), [(2, 7.0, False), (2, 9.0, True), (3, 9.0, False), (3, 11.0, True)]
)
def test_paths_that_do_not_explain_the_light_are_told(harmonics: int, chi_squared: float, is_told: bool) -> None:
    """In more than half of the pixels that have an answer; each further harmonic leaves two more numbers over."""
    periods_ns = tuple(T1_NS / h for h in range(1, harmonics + 1))
    plan = FramePlan(metadata=CaptureMetadata(modulation=Modulation(periods_ns=periods_ns)))
    misfit = np.full((16, 16), np.nan, np.float32)

    def told(of: NDArray[np.float32]) -> bool:
        layers = np.stack([np.ones((16, 16), np.float32), np.ones((16, 16), np.float32), of])
        maps = DepthMaps(("direct.depth", "direct.sigma", "chi_squared"), layers, np.zeros((16, 16), np.uint32))
        counts = StatusCounts(256, 0, 0, diffuse=0, invalid=0)
        return any("do not explain the light" in one for one in frame_doubts(None, maps, counts, plan))

    misfit[:4] = chi_squared
    assert told(misfit) == is_told
    misfit[3, 15] = np.nan
    assert not told(misfit)
    misfit[4:12] = 1.0
    assert not told(misfit)


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize(
    ("near_m", "far_m", "sigma_m", "length", "is_told"),
    [
        (0.1, 5.9, 0.05, 64, True),
        (0.1, 5.9, 0.05, 63, False),
        (0.14, 5.9, 0.05, 64, False),
        (0.1, 5.86, 0.05, 64, False),
        (0.1, 5.9, 0.07, 64, False),
    ],
)
def test_neighbours_at_both_ends_of_the_range_are_one_surface(
    near_m: float, far_m: float, sigma_m: float, length: int, is_told: bool, turns: int
) -> None:
    """On whichever side the surface goes on; noise without light lies anywhere, with a large sigma."""
    depth, sigma = np.full((70, 70), 3.0, np.float32), np.full((70, 70), sigma_m, np.float32)
    depth[:length, 34], depth[:length, 35] = near_m, far_m
    layers = np.stack([np.rot90(depth, turns), np.rot90(sigma, turns)])
    maps = DepthMaps(("direct.depth", "direct.sigma"), layers, np.zeros((70, 70), np.uint32))
    counts = StatusCounts(4900, 0, 0, diffuse=0, invalid=0)
    told = frame_doubts(None, maps, counts, FramePlan(metadata=CaptureMetadata()))
    assert ["depths go on at 0 where surfaces are 6 m away" in one for one in told] == [True] * is_told
