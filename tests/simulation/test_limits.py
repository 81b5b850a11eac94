"""Settings at their limits are simulated, settings beyond are refused; the defaults are QVGA and the paper's pixel."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.pixel.averaging import Averaging, Capacitors, Stages, stage_ticks
from cadtof_cli.simulation.pixel.mix import Condition, Motion, PhotonMix
from cadtof_cli.simulation.pixel.pixel import PixelModel, pixel_weights
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.scenes import Card, Corner, InterReflection, Wall
from cadtof_cli.workflows.simulate.trials import Trials

AVERAGING = Averaging(integration_length=100.0)

UNKNOWN_DRIVE: Any = "pulsed"

Make = Callable[[], object]


def mix(**changes: Any) -> PhotonMix:
    settings: dict[str, Any] = {
        "delays_ns": np.array([5.0]),
        "photons": np.array([1.0]),
        "ambient": np.array(0.0),
        "period_ns": 40.0,
        "fwhm_ns": 1.7,
    }
    return PhotonMix(**(settings | changes))


POSSIBLE: list[Make] = [
    lambda: Camera(width=1, height=1),
    lambda: Camera(width=16384, height=16384),
    lambda: Camera(focal_length_px=1.0),
    lambda: Camera(bits=1, zero_counts=1.0),
    lambda: Camera(bits=16),
    lambda: Camera(volts_per_count=1e-12),
    lambda: Camera(petzval_m=(-1.0, 1.0)),
    lambda: Wall(distance_m=0.01, asr=0.0),
    lambda: Wall(tilt_deg=(59.9, -59.9)),
    lambda: Card(separations_ns=(0.0, 0.0), mpi_ratios=(0.0, 0.0), asr=0.0),
    lambda: Corner(opening_deg=10.0, extents_m=(1e-3, 1e-3), directions=1, asr=0.0),
    lambda: Corner(opening_deg=179.9, directions=10_000),
    lambda: InterReflection(distance_m=1.0, wall_m=1.001, mpi_ratio=0.0, reflector_m=0.5, panel_m=(1e-3, 1e-3)),
    lambda: Stages(f1_hz=1e-3, f2_hz=1e-3),
    lambda: Averaging(integration_length=1.0001),
    lambda: Capacitors(values_ff=(1e-9,) * 12),
    lambda: PixelModel(averaging=AVERAGING, photons_per_cycle=1, cycles=1, gain_mismatch=-1.0),
    lambda: PixelModel(averaging=AVERAGING, dead_time_ns=39.999, jitter_ns=0.0, sample_noise_v=0.0),
    lambda: Condition(asr=0.0, mpi_ratio=0.0, fwhm_ns=0.0),
    lambda: Condition(asr=0.0, mpi_ratio=0.0, direct_ns=0.0, second_ns=39.999).mix(40.0),
    lambda: Trials(condition=Condition(asr=1.0, mpi_ratio=0.0), model=PixelModel(averaging=AVERAGING), runs=2, seed=0),
    lambda: mix(fwhm_ns=0.0, jitter_ns=0.0, period_ns=1e-6),
    lambda: mix(photons=np.array([0.0]), ambient=np.array(1e-9)),
]


@pytest.mark.parametrize("make", POSSIBLE)
def test_settings_at_their_limits_are_simulated(make: Make) -> None:
    match make():
        case Camera() as camera:
            rays = camera.rays(slice(0, 1))
            assert rays.shape == (3, 1, camera.width)
            assert np.isfinite(rays).all()
            assert camera.voltage.saturated_counts == (0.0, 2.0**camera.bits - 1)
        case Wall() | Card() | Corner() | InterReflection() as scene:
            light = scene.light(Camera(width=8, height=6), slice(None))
            assert np.isfinite(light.photons).all()
            assert light.photons.min() >= 0.0
            assert (light.delays_ns[1:] >= light.delays_ns[0])[light.photons[1:] > 0].all()
            assert (light.ambient == scene.asr).all() if isinstance(scene, Card) else light.ambient.min() >= 0.0
        case Stages(f1_hz=f1, f2_hz=f2):
            assert (f1, f2) == (1e-3, 1e-3)
        case Averaging() as averaging:
            weights = averaging.weights(100, photon_rate_hz=1e8)
            assert weights.min() >= 0.0
            np.testing.assert_allclose(weights.sum(axis=1), 1.0)
        case Capacitors() as capacitors:
            # (C1 + C2 + C5 + C6 + C9 + C10) / C1, with equal capacitors
            assert capacitors.integration_length == pytest.approx(6.0)
        case PixelModel() as model:
            assert model.photons == (1 if model.cycles == 1 else 1250)
        case Condition() as condition:
            assert float(condition.mix(40.0).total) == 1.0 + condition.asr + condition.mpi_ratio
        case PhotonMix() as photons:
            assert photons.moments(2)[0] == 1.0
            assert np.abs(photons.moments(2)).max() <= 1.0
        case Trials() as trials:
            assert [run for block in trials.blocks for run in block] == [0, 1]
        case made:
            pytest.fail(f"nothing is said of {made!r}")


IMPOSSIBLE: list[tuple[Make, str]] = [
    (lambda: Camera(width=16385), "width: found 16385 pixels, expected 1 to 16384 pixels"),
    (lambda: Camera(width=0), "width: found 0 pixels"),
    (lambda: Camera(height=16385), "height: found 16385 pixels, expected 1 to 16384"),
    (lambda: Camera(height=0), "height: found 0 pixels"),
    (lambda: Camera(focal_length_px=0.9), "focal length: found 0.9 px, expected 1 px or more"),
    (lambda: Camera(focal_length_px=math.nan), "focal length: found nan px"),
    (lambda: Camera(petzval_m=(0.0, math.inf)), "Petzval curvature: found"),
    (lambda: Camera(petzval_m=(0.0, math.nan)), "Petzval curvature: found"),
    (lambda: Camera(bits=0), "converter: found 0 bits"),
    (lambda: Camera(bits=17), "converter: found 17 bits, expected 1 to 16 bits"),
    (lambda: Camera(bits=12), "zero counts: found 8192.0, expected 0 to 4095, the counts of a converter of 12 bits"),
    (lambda: Camera(zero_counts=-0.5), "zero counts: found -0.5, expected 0 to 16383"),
    (lambda: Camera(zero_counts=math.nan), "zero counts: found nan"),
    (lambda: Camera(volts_per_count=0.0), "volts a count: found 0.0, expected a value above 0"),
    (lambda: Camera(volts_per_count=math.inf), "volts a count: found inf"),
    (lambda: Camera(petzval_m=(1e308, 0.0)), "Petzval curvature: found"),
    (lambda: Camera(dark_offset_v=1e308), "dark offsets: found 1e[+]308 V"),
    (lambda: Camera(fixed_delay_ns=1e308), "fixed pattern: found 1e[+]308 ns"),
    (lambda: Wall(distance_m=1e308), "distance: found 1e[+]308 m"),
    (lambda: Camera(dark_offset_v=-1e-9), "dark offsets: found -1e-09 V, expected 0 to 1e6 V"),
    (lambda: Camera(dark_offset_v=math.nan), "dark offsets: found nan V"),
    (lambda: Camera(fixed_delay_ns=-1e-9), "fixed pattern: found -1e-09 ns, expected 0 to 1e9 ns"),
    (lambda: Camera(fixed_delay_ns=math.inf), "fixed pattern: found inf ns"),
    (lambda: Wall(distance_m=0.009), "distance: found 0.009 m, expected 0.01 to 1e9 m"),
    (lambda: Corner(albedo=0.0), "albedo: found 0, expected above 0"),
    (lambda: Wall(asr=-0.001), "ASR: found -0.001, expected a ratio from 0 to"),
    (lambda: Wall(tilt_deg=(0.0, -60.0)), "tilt: found .* expected angles below 60°"),
    (lambda: Wall(tilt_deg=(60.0, 0.0)), "tilt: found .* expected angles below 60°"),
    (lambda: Card(separations_ns=(3.0, -0.1)), "separations: found"),
    (lambda: Card(mpi_ratios=(0.0, -0.1)), "MPI ratios: found"),
    (lambda: Card(mpi_ratios=(-0.1, 0.3)), "MPI ratios: found"),
    (lambda: Card(distance_m=0.0), "distance: found 0 m"),
    (lambda: Corner(opening_deg=9.9), "opening: found 9.9°"),
    (lambda: Corner(opening_deg=180.0), "opening: found 180°, expected 10° to below 180°"),
    (lambda: Corner(albedo=1.001), "albedo: found 1.001, expected above 0, at most 1"),
    (lambda: Corner(extents_m=(0.0, 1.0)), "extents: found"),
    (lambda: Corner(directions=0), "directions: found 0, expected 1 to 10000"),
    (lambda: Corner(directions=10_001), "directions: found 10001"),
    (lambda: Corner(asr=-1.0), "ASR: found -1"),
    (lambda: InterReflection(wall_m=3.35), "wall: found 3.35 m, expected more than 3.35 m"),
    (lambda: InterReflection(mpi_ratio=-0.1), "MPI ratio: found -0.1"),
    (lambda: InterReflection(panel_m=(1.0, 0.0)), "panel: found"),
    (lambda: InterReflection(reflector_m=0.4), "reflector: found 0.4 m"),
    (lambda: Stages(drive=UNKNOWN_DRIVE), "stages: found pulsed, expected dc or switched"),
    (lambda: Stages(f2_hz=9e-4), "F2: found 0.0009 Hz"),
    (lambda: Stages(f1_hz=9e-4), "F1: found 0.0009 Hz"),
    (lambda: Averaging(integration_length=math.inf), "integration length: found inf"),
    (
        lambda: Averaging(integration_length=1.1e15),
        "integration length: found 1.1e[+]15, expected a number above 1, 1e15",
    ),
    (lambda: PixelModel(averaging=AVERAGING, photons_per_cycle=0), "photons per cycle: found 0"),
    (lambda: PixelModel(averaging=AVERAGING, jitter_ns=-1e-9), "jitter: found -1e-09 ns"),
    (lambda: PixelModel(averaging=AVERAGING, gain_mismatch=-1.001), "gain mismatch: found -1.001"),
    (lambda: PixelModel(averaging=AVERAGING, sample_noise_v=-1e-9), "sample noise: found"),
    (lambda: PixelModel(averaging=AVERAGING, gain_mismatch=1e7), "gain mismatch: found 10000000.0, expected -1 to 1e6"),
    (
        lambda: PixelModel(averaging=AVERAGING, sample_noise_v=1e308),
        "sample noise: found 1e[+]308 V, expected 0 to 1e6 V",
    ),
    (lambda: PixelModel(averaging=AVERAGING, offsets_v=(0.0, -1e308)), "offsets: found"),
    (lambda: pixel_weights(PixelModel(averaging=AVERAGING, cycles=10**20)), "photons: found 5000000000"),
    (
        lambda: pixel_weights(PixelModel(averaging=Averaging(integration_length=1e15))),
        "photons: found 12500000000000000 in a harmonic, expected 1000000000 or less: use a smaller integration length",
    ),
    (lambda: stage_ticks(Stages(f1_hz=1e15), 750, 1.25e8), "F1: found 1e[+]15 Hz, 6e[+]09 times while 750 photons"),
    (lambda: stage_ticks(Stages(f2_hz=1e308), 750, 1.25e8), "F2: found 1e[+]308 Hz"),
    (lambda: Motion(speed_m_s=3e8), "speed: found 3e[+]08 m/s, expected less than the speed of light"),
    (lambda: Motion(frame_rate_hz=1e-300), "frame rate: found 1e-300 Hz"),
    (
        lambda: Trials(condition=Condition(asr=1.0, mpi_ratio=0.0), model=PixelModel(averaging=AVERAGING), runs=10**10),
        "runs",
    ),
    (lambda: Condition(asr=-1e-9, mpi_ratio=0.0), "ASR: found -1e-09"),
    (lambda: Condition(asr=1.0, mpi_ratio=-1e-9), "MPI ratio: found -1e-09"),
    (lambda: Condition(asr=1.0, mpi_ratio=0.0, fwhm_ns=-1e-9), "pulse width: found -1e-09 ns"),
    (lambda: Condition(asr=1.0, mpi_ratio=0.0, direct_ns=-1e-9).mix(40.0), "direct: found -1e-09 ns"),
    (lambda: Condition(asr=1.0, mpi_ratio=1.0, second_ns=40.0).mix(40.0), "second: found 40 ns"),
    (lambda: mix(jitter_ns=-1e-9), "jitter: found -1e-09 ns"),
    (lambda: mix(fwhm_ns=1e308), "pulse width: found 1e[+]308 ns, expected 0 to 1e9 ns"),
    (lambda: mix(fwhm_ns=-1e-9), "pulse width: found -1e-09 ns"),
    (lambda: mix(period_ns=9e-7), "period: found 9e-07 ns"),
    (lambda: mix(photons=np.array([math.inf])), "photons: found one below 0, infinite or NaN, expected finite"),
    (lambda: mix(ambient=np.array(math.nan)), "ambient: found one below 0, infinite or NaN"),
    (lambda: mix(delays_ns=np.array([1.0, 2.0])), "delays: found"),
]


@pytest.mark.parametrize(("make", "message"), IMPOSSIBLE)
def test_settings_beyond_their_limits_are_refused(make: Make, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        make()


def test_the_default_camera_is_qvga_with_14_bits() -> None:
    camera = Camera()
    assert (camera.width, camera.height) == (320, 240)
    assert camera.optics.focal_length_px == 280.0
    assert camera.optics.principal_point_px == (159.5, 119.5)
    voltage = camera.voltage
    assert (voltage.zero_counts, voltage.volts_per_count, voltage.saturated_counts) == (8192.0, 6.0e-5, (0.0, 16383.0))
    assert (camera.curvature_delay_ns(slice(0, 2)) == 0.0).all()
    assert (camera.dark_offsets_v(1, 2) == 0.0).all()
    assert (camera.fixed_delays_ns(1) == 0.0).all()


def test_the_converter_rounds_and_saturates_at_its_ends() -> None:
    camera = Camera(bits=10, zero_counts=512.0, volts_per_count=1e-3)
    volts = np.array([-1.0, -0.512, -0.5114, 0.0, 0.0006, 0.511, 0.6])
    assert camera.counts_from_voltages(volts).tolist() == [0, 0, 1, 512, 513, 1023, 1023]


def test_default_scenes_are_those_of_the_documentation() -> None:
    assert Wall().summary == "wall at 3 m, tilted by 0° and 0°"
    card = Card()
    assert (card.distance_m, card.separations_ns, card.mpi_ratios, card.asr) == (0.75, (3.0, 20.0), (0.05, 0.6), 2.0)
    assert card.clean_share == pytest.approx(1 / 6)
    corner = Corner()
    assert (corner.distance_m, corner.opening_deg, corner.extents_m, corner.albedo) == (2.0, 90.0, (1.4, 2.0), 0.8)
    assert (corner.asr, corner.directions) == (2.0, 300)
    panel = InterReflection()
    assert (panel.distance_m, panel.wall_m, panel.panel_m, panel.mpi_ratio) == (3.35, 4.2, (1.5, 1.8), 0.033)
    assert (panel.reflector_m, panel.asr) == (5.0, 2.0)


def test_the_default_pixel_is_that_of_the_paper() -> None:
    pixel = PixelModel(averaging=Averaging(integration_length=4000.0))
    assert pixel.photons == 50_000
    assert pixel.photon_rate_hz == pytest.approx(5 / 40e-9)
    assert (pixel.dead_time_ns, pixel.jitter_ns, pixel.sample_noise_v, pixel.gain_mismatch) == (0.0, 0.0, 0.0, 0.0)
    assert pixel.offsets_v == (0.0, 0.0)
    assert PixelModel(averaging=AVERAGING, photons_per_cycle=7).photons == 1253
    assert PixelModel(averaging=AVERAGING, photons_per_cycle=7, cycles=3).photons == 21
    condition = Condition(asr=5.0, mpi_ratio=0.3)
    assert (condition.direct_ns, condition.second_ns, condition.fwhm_ns) == (5.0, 16.0, 1.7)
    trials = Trials(condition=condition, model=pixel)
    assert (trials.runs, trials.photon_by_photon, trials.pulse_correction, trials.seed) == (400, False, True, 0)
