"""What `inspect` says of a pixel is what a run writes of it."""

import numpy as np

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.pipeline.frame import prepare_frame, resolve_frame, stages_of
from cadtof_cli.pipeline.one_pixel import pixel_evidence
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.units import metres_per_radian
from tests.support.campaign import camera, card
from tests.support.defects import Defects


def test_a_random_search_starts_where_it_starts_in_the_whole_frame() -> None:
    """With one start per pixel, some searches end elsewhere if they begin with the starts of another pixel."""
    resolver = ResolverSettings(solver="lm", order="2", starts=1, false_alarm=0.5)
    metadata = CaptureMetadata(
        modulation=Modulation(periods_ns=(40.0, 20.0, 40.0 / 3.0)), pixel=Pixel(integration_length=1e5)
    )
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=resolver))
    stored = 0.05 * np.random.default_rng(1).normal(size=(3, 2, 8, 8))
    depth_m = resolve_frame(stored, plan=plan).maps.layer(DIRECT_DEPTH).ravel()
    stages = stages_of(stored, plan)
    pixels = prepare_frame(stored, stages)
    phases = [pixel_evidence(pixels, index, stages).resolved.paths.phase_rad[0, 0] for index in range(64)]
    np.testing.assert_allclose(np.array(phases) * metres_per_radian(40.0), depth_m, rtol=1e-5)


def test_the_covariance_of_phasors_turns_with_the_light() -> None:
    """Light that comes a quarter of the first period later turns its phasor by 90°, and that of the second harmonic by 180°."""
    resolver = ResolverSettings(order="1", mpi_model="discrete")
    plan = FramePlan(
        metadata=CaptureMetadata(pixel=Pixel(integration_length=1e5)), settings=MapSettings(resolver=resolver)
    )
    found = []
    for phase in (0.7, 0.7 + np.pi / 2.0):
        angles = phase * np.array([1.0, 2.0])
        volts = 0.1 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        stored = np.broadcast_to(volts[..., np.newaxis, np.newaxis], (2, 2, 8, 8)).copy()
        stages = stages_of(stored, plan)
        found.append(pixel_evidence(prepare_frame(stored, stages), 9, stages).covariance)
    before, after = found
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    assert abs(before[0, 0, 1]) > 0.1 * before[0, 0, 0]
    np.testing.assert_allclose(after[0], quarter @ before[0] @ quarter.T, rtol=1e-6)
    np.testing.assert_allclose(after[1], before[1], rtol=1e-6)


def test_two_paths_of_a_triangle_have_the_sigma_of_the_maps() -> None:
    """Other pairs explain the phasors of close paths nearly as well, and widen it many times over in some pixels."""
    sensor = camera(Defects(), waveform="triangle", n_av=1e6)
    stored = card(sensor, count=1, seed=4, separations_ns=(4.0, 8.0))[0]
    plan = FramePlan(
        metadata=sensor.metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model="discrete", order="2"))
    )
    stages = stages_of(stored, plan)
    pixels, sigma_m = prepare_frame(stored, stages), resolve_frame(stored, plan=plan).maps.layer(DIRECT_SIGMA).ravel()
    for index in range(1000, sigma_m.size, 97):
        two = pixel_evidence(pixels, index, stages).two
        assert two is not None
        np.testing.assert_allclose(two[0].sigma_m, sigma_m[index], rtol=1e-5)
