"""What a run says of single frames whose maps are likely wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.captures import TOML, write_frame
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, T1_NS
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
