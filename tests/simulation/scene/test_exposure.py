"""A scene seen by a camera: bands of rows make up the exposure, and frames are draws from it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, band_rows, expose_band, frame_voltages, joined
from cadtof_cli.simulation.scene.scenes import Card, Wall

CAMERA = Camera(width=12, height=19)


def exposure(camera: Camera = CAMERA, *, seed: int = 4, length: float | None = 1e4) -> Exposure:
    metadata = CaptureMetadata(pixel=Pixel(integration_length=length), optics=camera.optics)
    return Exposure(scene=Card(), camera=camera, metadata=metadata, seed=seed)


def test_bands_have_eight_rows_but_the_last() -> None:
    assert band_rows(19) == (slice(0, 8), slice(8, 16), slice(16, 19))
    assert band_rows(16) == (slice(0, 8), slice(8, 16))


def test_bands_make_up_the_frame() -> None:
    whole, parts = expose_band(exposure(), slice(0, 19)), [expose_band(exposure(), rows) for rows in band_rows(19)]
    found = joined(parts)
    assert_allclose(found.voltages.means_v, whole.voltages.means_v)
    assert_allclose(found.voltages.covariances_v2, whole.voltages.covariances_v2)
    assert found.truth.keys() == whole.truth.keys()
    for name, plane in found.truth.items():
        assert_allclose(plane, whole.truth[name])


def test_dark_offsets_are_added_to_a_frame_s_voltages() -> None:
    whole = expose_band(exposure(), slice(0, 19))
    offsets = np.random.default_rng(1).normal(size=(2, 2, 19, 12))
    bare, shifted = (frame_voltages(exposure(), whole, 2, offsets_v=one) for one in (None, offsets))
    assert_allclose(shifted - bare, offsets)


def test_frames_and_seeds_are_independent_draws() -> None:
    whole = expose_band(exposure(), slice(0, 19))
    first = frame_voltages(exposure(), whole, 0)
    np.testing.assert_array_equal(frame_voltages(exposure(), whole, 0), first)
    for other in (frame_voltages(exposure(), whole, 1), frame_voltages(exposure(seed=5), whole, 0)):
        ours, theirs = ((one - whole.voltages.means_v).ravel() for one in (first, other))
        assert abs(np.corrcoef(ours, theirs)[0, 1]) < 0.1


def test_a_pixel_s_own_delay_and_the_lens_s_come_on_top_of_every_path() -> None:
    """The delays 2(k2 ρ² + k4 ρ⁴)/c and the fixed pattern turn the phasor of the fundamental; the truth stays."""
    wall = Wall(distance_m=2.0)
    plain = replace(exposure(), scene=wall)
    bent = Camera(width=12, height=19, petzval_m=(0.05, 0.01), fixed_delay_ns=0.1)
    whole, turned = (expose_band(replace(plain, camera=camera), slice(8, 16)) for camera in (CAMERA, bent))
    first, second = (one.voltages.means_v[0, 0] + 1j * one.voltages.means_v[0, 1] for one in (whole, turned))
    delay = bent.curvature_delay_ns(slice(8, 16)) + bent.fixed_delays_ns(4)[8:16]
    assert_allclose(np.angle(second / first), 2.0 * np.pi * delay / 40.0, atol=1e-6)
    assert_allclose(turned.truth["direct.depth"], whole.truth["direct.depth"])


def test_without_an_integration_length_there_is_no_noise_to_draw() -> None:
    assert exposure().integration_length == 1e4
    with pytest.raises(SettingsError, match="integration length: found none, expected a number above 1"):
        expose_band(exposure(length=None), slice(0, 8))
