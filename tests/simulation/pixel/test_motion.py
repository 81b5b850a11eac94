"""A moving target: every harmonic sees it at another distance; the truth is its distance halfway through the frame."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.errors import SettingsError
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.evolution import evolution
from cadtof_cli.simulation.pixel.mix import Condition, Motion
from cadtof_cli.simulation.pixel.pixel import PixelModel
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, expose_band
from cadtof_cli.simulation.scene.scenes import Wall
from cadtof_cli.workflows.simulate.outcome import TrialsSummary, summary
from cadtof_cli.workflows.simulate.trials import Recordings, Trials, recordings

FAST = Motion(speed_m_s=3.0, frame_rate_hz=20.0)
"""3 m/s · 25 ms = 7.5 cm between two harmonics, 0.5003 ns there and back."""


def outcome(
    *, harmonics: int = 2, n_av: float = 1e6, order: str = "1", motion: Motion = FAST, **more: Any
) -> TrialsSummary:
    model = PixelModel(
        modulation=Modulation(periods_ns=tuple(40.0 / h for h in range(1, 1 + harmonics))),
        averaging=Averaging(integration_length=n_av),
        motion=motion,
    )
    trials = Trials(
        condition=Condition(asr=2.0, mpi_ratio=0.0), model=model, resolver=ResolverSettings(order=order), runs=400
    )
    wanted = replace(trials, **more)
    return summary(wanted, Recordings.joined([recordings(wanted, runs) for runs in wanted.blocks]))


def test_harmonics_are_evenly_spread_about_the_middle_of_the_frame() -> None:
    np.testing.assert_allclose(FAST.delays_ns(2), [-0.25017, 0.25017], atol=1e-5)
    np.testing.assert_allclose(FAST.delays_ns(3), [-0.33356, 0.0, 0.33356], atol=1e-5)
    assert Motion().delays_ns(3) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("harmonics", [2, 3])
def test_the_error_of_one_path_is_the_weighted_mean_of_the_harmonics_delays(harmonics: int) -> None:
    """Harmonic h has the weight h²: two harmonics give (−1 + 4)/5 of .250 ns, three give (−1 + 9)/14 of .334 ns."""
    expected = {2: 0.25017 * 3 / 5, 3: 0.33356 * 8 / 14}[harmonics]
    assert outcome(harmonics=harmonics).direct.bias_ns == pytest.approx(expected, rel=0.08)
    away = outcome(harmonics=harmonics, motion=replace(FAST, speed_m_s=-3.0)).direct
    assert away.bias_ns == pytest.approx(-expected, rel=0.08)


def test_photon_by_photon_sees_the_same_motion() -> None:
    photons = outcome(n_av=2e3, photon_by_photon=True, runs=200).direct
    exact = outcome(n_av=2e3, runs=4000).direct
    error_ns = exact.std_ns / math.sqrt(200)
    assert photons.bias_ns == pytest.approx(exact.bias_ns, abs=4 * error_ns)
    assert abs(exact.bias_ns) > 20 * error_ns


def test_at_rest_nothing_changes() -> None:
    assert outcome(motion=Motion(frame_rate_hz=5.0)).direct == outcome(motion=Motion()).direct


def test_a_scene_moves_as_a_pixel_does() -> None:
    """The phasor of harmonic 1 turns by −ω·0.25 ns, and that of harmonic 2 by +2ω·0.25 ns; the wall is at 3 m."""
    exposure = Exposure(
        scene=Wall(), camera=Camera(width=8, height=8), metadata=CaptureMetadata(pixel=Pixel(integration_length=1e5))
    )
    still, moving = (expose_band(each, slice(0, 8)) for each in (exposure, replace(exposure, motion=FAST)))
    for row, (harmonic, delay_ns) in enumerate([(1, -0.25017), (2, 0.25017)]):
        first, second = (band.voltages.means_v[row, 0] + 1j * band.voltages.means_v[row, 1] for band in (still, moving))
        np.testing.assert_allclose(np.angle(second / first), harmonic * 2 * np.pi * delay_ns / 40.0, atol=1e-5)
        np.testing.assert_allclose(abs(second), abs(first), rtol=1e-12)
    np.testing.assert_array_equal(moving.truth["direct.depth"], still.truth["direct.depth"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed_m_s": math.nan}, "speed: found nan m/s"),
        ({"frame_rate_hz": 0.0}, "frame rate: found 0 Hz, expected a rate"),
    ],
)
def test_impossible_motion_is_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        Motion(**change)


def test_the_pictures_of_a_recording_show_the_target_where_the_fundamental_sees_it() -> None:
    """60 m/s · 25 ms / 2 = .75 m, 5.0035 ns there and back, before the middle of the frame: an arrival at 5 instead of 10 ns."""
    model = PixelModel(averaging=Averaging(integration_length=200.0), cycles=1000, motion=replace(FAST, speed_m_s=60.0))
    light = Condition(asr=0.0, mpi_ratio=0.0, direct_ns=10.0).mix(40.0)
    shown = evolution(model, light, np.random.default_rng(0))
    assert shown.settled_phase_deg == pytest.approx((10.0 - 5.0035) / 40.0 * 360.0, abs=0.5)
