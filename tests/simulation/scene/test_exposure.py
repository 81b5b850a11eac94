"""A scene seen by a camera: bands of rows make up the exposure, and frames are draws from it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.pixel.pixel import PixelDefects
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


def test_all_pixels_of_a_scene_have_the_defects_of_a_pixel() -> None:
    """SC2 is stronger by 4 %, after which the offsets are added; the noise of samples is averaged as photons are."""
    plain = exposure()
    real = replace(plain, defects=PixelDefects(gain_mismatch=0.04, offsets_v=(0.002, -0.001)))
    noisy, late = (
        replace(plain, defects=PixelDefects(sample_noise_v=0.3)),
        replace(plain, defects=PixelDefects(jitter_ns=0.5)),
    )
    whole, with_noise, with_jitter = (expose_band(one, slice(0, 19)) for one in (plain, noisy, late))
    ideal, found = (frame_voltages(one, whole, 3) for one in (plain, real))
    assert_allclose(found[:, 0], ideal[:, 0] + 0.002)
    assert_allclose(found[:, 1], 1.04 * ideal[:, 1] - 0.001)
    added = with_noise.voltages.covariances_v2 - whole.voltages.covariances_v2
    assert_allclose(added[:, 0::2], 0.3**2 / (2 * 1e4 - 1), rtol=1e-6)
    assert_allclose(added[:, 1], 0.0, atol=1e-18)
    # a Gaussian of standard deviation s multiplies harmonic h by exp(−(2π·h·s/T1)²/2)
    for row, harmonic in enumerate((1, 2)):
        shorter = np.exp(-0.5 * (2.0 * np.pi * harmonic * 0.5 / 40.0) ** 2)
        assert_allclose(with_jitter.voltages.means_v[row], shorter * whole.voltages.means_v[row], atol=1e-12)
    assert [one.told.pixel.integration_length for one in (plain, real, noisy)] == [1e4, 1e4, None]
    with pytest.raises(SettingsError, match="jitter: found 20 ns, expected 0 to less than 20 ns"):
        replace(plain, defects=PixelDefects(jitter_ns=20.0))


def test_without_an_integration_length_there_is_no_noise_to_draw() -> None:
    assert exposure().integration_length == 1e4
    with pytest.raises(SettingsError, match="integration length: found none, expected a number above 1"):
        expose_band(exposure(length=None), slice(0, 8))
