"""The camera with defects has none by default, and each defect is as large as asked for."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Optics, Pixel
from tests.support.defects import DefectiveCamera, Defects, qvga_metadata

METADATA = qvga_metadata(CaptureMetadata(pixel=Pixel(integration_length=1e12), optics=Optics(focal_length_px=14.0)))
PIXELS = (12, 16)


def camera(**defects: Any) -> DefectiveCamera:
    return DefectiveCamera(metadata=METADATA, pixels=PIXELS, defects=replace(Defects(), **defects))


def volts(seen: DefectiveCamera, range_m: float, share: float) -> np.ndarray:
    ranges = np.full((1, *PIXELS), range_m)
    (frame,) = seen.frames(ranges, np.full_like(ranges, share), count=1, seed=1)
    return (frame.astype(np.float64) - 8192.0) * 6.0e-5


def test_a_camera_without_defects_samples_the_wave_after_the_pulse() -> None:
    found = volts(camera(), 1.2, 0.3)
    for row, h in enumerate((1, 2)):
        theta = h * 2 * np.pi / 40.0 * 2 * 1.2 / 0.299792458
        pulse = np.exp(-((h * 2 * np.pi * 1.7 / 2.354820045 / 40.0) ** 2) / 2)
        expected = 0.2746 * 0.3 * pulse * np.array([np.cos(theta), np.sin(theta)])
        np.testing.assert_allclose(found[row], np.broadcast_to(expected[:, None, None], (2, *PIXELS)), atol=4e-5)


@pytest.mark.parametrize(
    ("defect", "row", "factor", "turn"),
    [
        ({"gain": (1.0, 0.8)}, 1, 0.8, 0.0),
        ({"phase_rad": (0.1, 0.3)}, 0, 1.0, 0.1),
        ({"phase_rad": (0.1, 0.3)}, 1, 1.0, 0.3),
    ],
)
def test_gain_and_phase_of_a_harmonic(defect: dict[str, object], row: int, factor: float, turn: float) -> None:
    clean, changed = volts(camera(), 1.2, 0.3)[row], volts(camera(**defect), 1.2, 0.3)[row]
    ratio = (changed[0] + 1j * changed[1]) / (clean[0] + 1j * clean[1])
    np.testing.assert_allclose(ratio, factor * np.exp(1j * turn), atol=2e-3)


def test_sc2_alone_is_stronger() -> None:
    clean, changed = volts(camera(), 1.2, 0.3), volts(camera(sc2_gain=1.05), 1.2, 0.3)
    np.testing.assert_allclose(changed[:, 0], clean[:, 0], atol=7e-5)
    np.testing.assert_allclose(changed[:, 1], 1.05 * clean[:, 1], atol=7e-5)


def test_counts_saturate_at_14_bits() -> None:
    bright = replace(METADATA, voltage=replace(METADATA.voltage, volts_per_count=2.0e-5))
    seen = DefectiveCamera(metadata=bright, pixels=PIXELS)
    stored = [seen.frames(np.full((1, *PIXELS), r), np.ones((1, *PIXELS)), count=1, seed=1)[0] for r in (0.0, 3.0)]
    assert stored[0].max() == 16383
    assert stored[1].min() == 0


def test_drawn_defects_are_as_large_as_asked_for_and_fixed() -> None:
    seen = DefectiveCamera(
        metadata=METADATA,
        pixels=(60, 80),
        defects=Defects(offset_v=0.02, hot_share=0.05, pixel_phase_rad=0.05, pixel_gain=0.02, seed=3),
    )
    drawn = seen.drawn()
    calm = ~drawn.hot
    assert np.abs(drawn.offset_v[:, :, calm]).max() == pytest.approx(0.02, rel=0.01)
    assert drawn.offset_v[:, :, calm].std() == pytest.approx(0.02 / np.sqrt(3), rel=0.02)
    assert drawn.offset_v[:, :, drawn.hot].mean() == pytest.approx(0.25, abs=0.002)
    assert drawn.hot.mean() == pytest.approx(0.05, abs=0.01)
    assert drawn.noisy.mean() == pytest.approx(0.05, abs=0.01)
    assert not (drawn.hot & drawn.noisy).any()
    assert drawn.phase_rad.std() == pytest.approx(0.05, rel=0.03)
    assert (drawn.gain[0] == 1.0).all()
    assert drawn.gain[1].std() == pytest.approx(0.02, rel=0.05)
    np.testing.assert_array_equal(seen.drawn().phase_rad, drawn.phase_rad)


def test_lens_and_wall_are_centred_without_a_principal_point() -> None:
    seen = camera(petzval_m=(0.06, -0.02))
    bent, wall = seen.curvature_m(), seen.wall_range_m(2.0)
    for values in (bent, wall):
        np.testing.assert_allclose(values, values[::-1, ::-1], rtol=1e-12)
    rho = np.hypot(7.5, 5.5) / 10.0
    assert bent[0, 0] == pytest.approx(0.06 * rho**2 - 0.02 * rho**4)
    assert wall[0, 0] == pytest.approx(2.0 * np.sqrt(1 + (7.5 / 14) ** 2 + (5.5 / 14) ** 2))
    tilted = seen.wall_range_m(2.0, (10.0, 0.0))
    assert (tilted[:, 0] > tilted[:, -1]).all()
