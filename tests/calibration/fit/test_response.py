"""What targets can tell of a response, and what they cannot: truth by sampling the waveform itself."""

from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.calibration.fit.response import TargetMean, fit_response
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.capture.metadata import Optics, Waveform
from cadtof_cli.errors import SettingsError
from tests.support.campaign import PIXELS, camera
from tests.support.defects import DefectiveCamera, Defects

FRAMES = 10


def target(seen: DefectiveCamera, distance_m: float, *, seed: int) -> TargetMean:
    """Return the mean frame of a wall, by the camera's own counts."""
    ranges = seen.wall_range_m(distance_m)[np.newaxis]
    frames = np.stack(seen.frames(ranges, np.full_like(ranges, 1.0 / 3.0), count=FRAMES, seed=seed))
    volts = (frames.astype(np.float64) - 8192.0) * 6.0e-5
    mean = volts.mean(axis=0)
    noise = np.sqrt(volts.var(axis=0, ddof=1).mean(axis=(1, 2, 3)) / FRAMES)
    return TargetMean(mean[:, 0] + 1j * mean[:, 1], noise, distance_m)


def response_of(
    defects: Defects,
    distances_m: tuple[float, ...],
    *,
    waveform: Waveform = "sine",
    optics: Optics | None = None,
) -> ResponseCalibration:
    seen = camera(defects, waveform=waveform)
    targets = [target(seen, d, seed=index) for index, d in enumerate(distances_m)]
    origin = Origin(
        captures=("targets",),
        frames=FRAMES * len(targets),
        pixels=PIXELS,
        periods_ns=(40.0, 20.0),
        waveform=waveform,
    )
    metadata = seen.metadata
    if optics is not None:
        metadata = replace(metadata, optics=optics)
    return fit_response(targets, metadata=metadata, origin=origin)


def orders(found: ResponseCalibration) -> set[int]:
    return {k for one in found.responses for k, _ in one.terms}


def test_a_perfect_camera_needs_no_terms_but_one() -> None:
    found = response_of(Defects(), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert orders(found) == {1}
    assert found.quality.residual == pytest.approx(1.0, abs=0.05)
    assert found.phase_rad.std(axis=(1, 2)) == pytest.approx(found.quality.phase_stderr_rad, rel=0.2)
    assert found.field_curvature_m == (0.0, 0.0)


def test_an_ideal_triangle_needs_nothing_besides_its_own_series() -> None:
    found = response_of(Defects(), (0.5, 1.0, 1.7, 2.4, 3.0), waveform="triangle")
    assert all("left, not needed" in text for text in found.quality.findings if text.startswith("k ="))


def test_one_distance_gives_one_term_and_says_so() -> None:
    found = response_of(Defects(sc2_gain=1.05, phase_rad=(0.0, 0.3)), (1.0,))
    assert orders(found) == {1}
    assert any(text.startswith("one distance: k = 1 and the maps only") for text in found.quality.findings)


def test_two_close_distances_tell_no_offset_from_a_phase() -> None:
    found = response_of(Defects(sc2_gain=1.05), (1.0, 1.05))
    assert any("cannot be told" in text for text in found.quality.findings)


def test_the_imbalance_is_found_from_five_distances() -> None:
    found = response_of(Defects(sc2_gain=1.05, phase_rad=(0.0, 0.3), gain=(1.0, 0.8)), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert orders(found) == {1, -1}
    for one in found.responses:
        assert abs(one.mirror / np.conj(one.main) + 0.05 / 2.05) < 2e-4
    assert np.angle(found.responses[1].main) == pytest.approx(0.3, abs=2e-3)


def test_curvature_of_the_lens_is_taken_out_of_the_phase_maps() -> None:
    found = response_of(Defects(petzval_m=(0.06, -0.02)), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert found.field_curvature_m == pytest.approx((0.06, -0.02), abs=1e-3)
    assert found.phase_rad.std(axis=(1, 2)) == pytest.approx(found.quality.phase_stderr_rad, rel=0.2)


def test_without_optics_the_distance_stands_for_every_pixel_and_it_is_said() -> None:
    found = response_of(Defects(), (1.0,), optics=Optics())
    assert any("no focal length given, so every pixel's range is taken" in text for text in found.quality.findings)


def test_offsets_that_nobody_took_out_are_warned_of() -> None:
    found = response_of(Defects(offset_v=0.02), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert any(text.startswith("warning: what is left is") for text in found.quality.findings)


def test_a_target_that_is_not_seen_is_refused() -> None:
    seen = camera(Defects())
    nothing = TargetMean(np.full((2, *PIXELS), np.nan, np.complex128), np.full(2, 1e-4), 1.0)
    origin = Origin(captures=("dark room",), frames=1, pixels=PIXELS, periods_ns=(40.0, 20.0), waveform="sine")
    with pytest.raises(SettingsError, match=r"found 0\.0% of the pixels with a signal from every target"):
        fit_response([nothing], metadata=seen.metadata, origin=origin)
