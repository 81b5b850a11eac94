"""Scenes agree with geometry by hand, and two ways of integrating light agree with each other."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, band_rows, expose_band
from cadtof_cli.simulation.scene.geometry import (
    Surface,
    bounce_by_directions,
    bounce_by_patches,
    cosine_directions,
    hits,
    irradiance,
)
from cadtof_cli.simulation.scene.light import Light, Scene
from cadtof_cli.simulation.scene.scenes import SCENES, Card, Corner, InterReflection, Wall

C_M_PER_NS = 0.299792458
CAMERA = Camera(width=64, height=48)
ALL_ROWS = slice(0, 48)


def exposure(scene: Scene, camera: Camera = CAMERA) -> Exposure:
    return Exposure(scene=scene, camera=camera, metadata=CaptureMetadata(pixel=Pixel(integration_length=1e5)))


def first_phasor_range_m(scene: Scene, camera: Camera = CAMERA) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    means = expose_band(exposure(scene, camera), slice(0, camera.height)).voltages.means_v
    phase = np.mod(np.arctan2(means[0, 1], means[0, 0]), 2 * np.pi)
    return np.asarray(phase * C_M_PER_NS * 40.0 / (4 * np.pi))


@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (20.0, 0.0), (-10.0, 15.0)])
def test_wall_has_the_range_of_a_tilted_plane(tilt_deg: tuple[float, float]) -> None:
    depth = Wall(distance_m=2.5, tilt_deg=tilt_deg).light(CAMERA, ALL_ROWS).truth(1.0)["direct.depth"]
    y, x = np.mgrid[0:48, 0:64]
    x, y = (x - 31.5) / 56.0, (y - 23.5) / 56.0
    slope_x, slope_y = (math.tan(math.radians(angle)) for angle in tilt_deg)
    expected = 2.5 * np.sqrt(1 + x**2 + y**2) / (1 + slope_x * x + slope_y * y)
    np.testing.assert_allclose(depth, expected, rtol=1e-12)


def test_wall_falls_off_with_the_square_of_distance_and_the_cosine() -> None:
    light = Wall(distance_m=2.0, asr=3.0).light(Camera(width=65, height=49), slice(0, 49))
    assert light.photons[0, 24, 32] == pytest.approx(1.0)
    edge = 32 / (0.875 * 65)
    assert light.photons[0, 24, 64] == pytest.approx((1 + edge**2) ** -1.5)
    np.testing.assert_allclose(light.ambient, 3.0)


def test_wall_has_no_mpi() -> None:
    truth = Wall().light(CAMERA, ALL_ROWS).truth(0.2746)
    assert np.isnan(truth["mpi.depth"]).all()
    assert (truth["mpi.amplitude"] == 0).all()
    assert (truth["mpi.ratio"] == 0).all()


def test_truth_amplitudes_are_shares_of_all_light() -> None:
    truth = Card(asr=2.0, mpi_ratios=(0.3, 0.3)).light(CAMERA, ALL_ROWS).truth(0.2746)
    assert truth["direct.amplitude"][-1, 0] == pytest.approx(0.2746 / 3.3)
    assert truth["mpi.amplitude"][-1, 0] == pytest.approx(0.2746 * 0.3 / 3.3)
    assert truth["direct.amplitude"][0, 0] == pytest.approx(0.2746 / 3.0)


def test_card_spreads_separation_across_and_ratio_down() -> None:
    truth = Card().light(CAMERA, ALL_ROWS).truth(1.0)
    np.testing.assert_allclose(truth["direct.depth"], 0.75)
    assert np.isnan(truth["mpi.delay"][:8]).all()
    np.testing.assert_allclose(truth["mpi.delay"][8:, 0], 3.0)
    np.testing.assert_allclose(truth["mpi.delay"][8:, -1], 20.0)
    assert truth["mpi.ratio"][8, 0] == pytest.approx(0.05)
    assert truth["mpi.ratio"][-1, 0] == pytest.approx(0.6)
    np.testing.assert_allclose(truth["mpi.depth"][-1, -1], 0.75 + 20.0 * C_M_PER_NS / 2)


def test_cosine_directions_have_the_density_of_a_flat_receiver() -> None:
    x, _, z = cosine_directions(5000)
    np.testing.assert_allclose(x**2 + _**2 + z**2, 1.0)
    assert z.mean() == pytest.approx(2 / 3, abs=1e-3)
    # An upright wall that fills half the view of a floor has the form factor 1/2; from 45° up it is (1 − cos 45°)/2.
    assert (x > 0).mean() == pytest.approx(0.5, abs=2e-3)
    assert (z < x).mean() == pytest.approx((1 - math.cos(math.radians(45))) / 2, abs=2e-3)


def test_no_two_cosine_directions_lie_close_together() -> None:
    """Seen from above, each direction has an area of π/n in the unit disc; a square of this area is 1.77/√n wide."""
    x, y, _ = cosine_directions(1000)
    apart = np.hypot(x[:, np.newaxis] - x, y[:, np.newaxis] - y)
    np.fill_diagonal(apart, np.inf)
    assert apart.min() > 1.5 / math.sqrt(1000)


def test_two_ways_of_integrating_a_bounce_agree() -> None:
    """Directions from the point and patches of the other surface are independent sums of the same integral."""
    left, right = Corner(extents_m=(0.6, 0.8)).surfaces()
    rays = np.array([-0.12, 0.05, 1.0]).reshape(3, 1, 1)
    seen = hits((left, right), rays)
    assert seen.surface[0, 0] == 0
    by_directions = bounce_by_directions(seen, right, count=60_000)
    by_patches = bounce_by_patches(seen, right, count=150)
    total = by_patches.irradiance.sum()
    assert by_directions.irradiance.sum() == pytest.approx(total, rel=3e-3)
    mean, other = (
        (bounce.irradiance * bounce.lengths_m).sum() / bounce.irradiance.sum() for bounce in (by_directions, by_patches)
    )
    assert mean == pytest.approx(other, rel=1e-3)


def test_a_bounce_from_a_small_patch_is_the_product_of_its_factors() -> None:
    """A patch of 1 cm², at 45° to the light and to the point, sends ρ/π · E · cos · cos · dA / d² to the point."""
    patch = Surface(
        origin_m=(1.0, 0.0, 1.0),
        across=(math.sqrt(0.5), 0.0, math.sqrt(0.5)),
        along=(0.0, 1.0, 0.0),
        extents_m=(-0.005, 0.005, -0.005, 0.005),
        albedo=0.5,
    )
    target = Surface(origin_m=(0.0, 0.0, 2.0), across=(1.0, 0.0, 0.0), along=(0.0, 1.0, 0.0), albedo=0.5)
    seen = hits((target,), np.array([0.0, 0.0, 1.0]).reshape(3, 1, 1))
    assert bounce_by_patches(seen, patch, count=4).irradiance.sum() == pytest.approx(0.0, abs=1e-12)
    facing = Surface(
        origin_m=(1.0, 0.0, 1.0),
        across=(0.0, 0.0, 1.0),
        along=(0.0, 1.0, 0.0),
        extents_m=(-0.005, 0.005, -0.005, 0.005),
        albedo=0.5,
    )
    cosine = math.sqrt(0.5)
    lit = cosine / 2.0
    expected = 0.5 / math.pi * lit * cosine * cosine * 1e-4 / 2.0
    bounce = bounce_by_patches(seen, facing, count=4)
    assert bounce.irradiance.sum() == pytest.approx(expected, rel=1e-4)
    np.testing.assert_allclose(bounce.lengths_m, 2 * math.sqrt(2.0), atol=0.01)


def test_corner_mpi_is_later_and_gathers_at_the_edge() -> None:
    light = Corner().light(CAMERA, ALL_ROWS)
    carrying = light.photons[1:] > 0
    assert (np.where(carrying, light.delays_ns[1:] - light.delays_ns[0], 1.0) > 0).all()
    truth = light.truth(1.0)
    middle = truth["mpi.delay"][24, 32:]
    assert (np.diff(middle) > -0.05).all()
    assert middle[0] < 0.5
    assert middle[-1] > 3.0
    ratio = truth["mpi.ratio"][24]
    assert ratio[31] > 2 * ratio[0]
    assert len(np.unique(np.round(light.delays_ns[1:, 24, 50][carrying[:, 24, 50]], 3))) > 20


def test_corner_is_symmetric_and_blurred_by_its_mpi() -> None:
    truth = Corner().light(CAMERA, ALL_ROWS).truth(1.0)
    np.testing.assert_allclose(truth["direct.depth"], truth["direct.depth"][:, ::-1], rtol=1e-12)
    error = first_phasor_range_m(Corner()) - truth["direct.depth"]
    assert error.min() > -1e-3
    assert 0.03 < np.median(error) < 0.15


def test_inter_reflection_makes_the_panel_look_2_cm_nearer() -> None:
    """Fig. 4(c): 335 cm without the second object, about 333 cm with it."""
    centre = (24, 32)
    camera = Camera(width=65, height=49)
    without = first_phasor_range_m(InterReflection(mpi_ratio=0.0), camera)[centre]
    with_object = first_phasor_range_m(InterReflection(), camera)[centre]
    assert without == pytest.approx(3.35, abs=1e-6)
    assert with_object == pytest.approx(3.33, abs=0.003)


def test_inter_reflection_has_the_ratio_it_was_given_in_the_middle() -> None:
    truth = InterReflection(mpi_ratio=0.2).light(Camera(width=65, height=49), slice(0, 49)).truth(1.0)
    assert truth["mpi.ratio"][24, 32] == pytest.approx(0.2, rel=1e-9)
    assert truth["mpi.ratio"][0, 0] == 0


def test_petzval_curvature_shifts_the_measured_range_and_not_the_truth() -> None:
    flat, curved = Camera(width=64, height=48), Camera(width=64, height=48, petzval_m=(0.05, -0.02))
    shift = first_phasor_range_m(Wall(), curved) - first_phasor_range_m(Wall(), flat)
    y, x = np.mgrid[0:48, 0:64]
    rho = np.hypot(x - 31.5, y - 23.5) / math.hypot(32, 24)
    np.testing.assert_allclose(shift, 0.05 * rho**2 - 0.02 * rho**4, atol=1e-9)
    with_curve = expose_band(exposure(Wall(), curved), ALL_ROWS).truth["direct.depth"]
    np.testing.assert_array_equal(with_curve, expose_band(exposure(Wall()), ALL_ROWS).truth["direct.depth"])


def test_fixed_pattern_is_fixed_and_as_wide_as_asked() -> None:
    camera = Camera(width=64, height=48, fixed_delay_ns=0.1, dark_offset_v=0.002)
    assert camera.fixed_delays_ns(1).std() == pytest.approx(0.1, rel=0.05)
    np.testing.assert_array_equal(camera.fixed_delays_ns(1), camera.fixed_delays_ns(1))
    assert camera.dark_offsets_v(1, 2).std() == pytest.approx(0.002, rel=0.05)
    shift = first_phasor_range_m(Wall(), camera) - first_phasor_range_m(Wall())
    np.testing.assert_allclose(shift, camera.fixed_delays_ns(0) * C_M_PER_NS / 2, atol=1e-9)


def test_delays_and_offsets_of_a_seed_have_nothing_to_do_with_each_other() -> None:
    camera = Camera(width=64, height=48, fixed_delay_ns=0.1, dark_offset_v=0.002)
    patterns = np.concatenate([camera.fixed_delays_ns(1)[np.newaxis], *camera.dark_offsets_v(1, 2)]).reshape(5, -1)
    assert np.abs(np.corrcoef(patterns) - np.eye(5)).max() < 5 / np.sqrt(48 * 64)


def test_bands_cover_every_row_once() -> None:
    assert [row for rows in band_rows(21) for row in range(21)[rows]] == list(range(21))


@pytest.mark.parametrize("name", SCENES)
def test_scenes_have_a_name_and_say_what_they_are(name: str) -> None:
    assert len(SCENES[name]().summary) > 10


def test_a_scene_beyond_the_unambiguous_range_is_refused() -> None:
    with pytest.raises(
        SettingsError, match=r"direct path of 7.208 m, expected less than the unambiguous range of 5.996 m"
    ):
        expose_band(exposure(Wall(distance_m=5.9)), ALL_ROWS)


def test_a_scene_just_within_a_short_range_is_not() -> None:
    """A period of 5 ns has an unambiguous range of 0.749 m."""
    metadata = CaptureMetadata(modulation=Modulation(periods_ns=(5.0, 2.5)), pixel=Pixel(integration_length=1e5))
    band = expose_band(Exposure(scene=Wall(distance_m=0.5), camera=CAMERA, metadata=metadata), ALL_ROWS)
    assert 0.55 < np.nanmax(band.truth["direct.depth"]) < 0.749


def test_the_reflector_is_a_square_of_one_and_a_half_metres_at_the_side() -> None:
    panel, wall, reflector = InterReflection().surfaces()
    assert (panel.origin_m, wall.origin_m) == ((0.0, 0.0, 3.35), (0.0, 0.0, 4.2))
    assert (panel.albedo, wall.albedo) == (0.8, 0.4)
    assert panel.extents_m == (-0.75, 0.75, -0.9, 0.9)
    assert reflector.origin_m == pytest.approx((5.0, 0.0, 0.45 * 3.35))
    assert reflector.extents_m == (-0.75, 0.75, -0.75, 0.75)
    assert np.cross(reflector.across, reflector.along).tolist() in ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0])


def test_every_channel_has_an_offset_of_its_own() -> None:
    drawn = Camera(width=64, height=48, dark_offset_v=0.01).dark_offsets_v(3, 2)
    assert drawn.shape == (2, 2, 48, 64)
    assert np.abs(np.corrcoef(drawn.reshape(4, -1)) - np.eye(4)).max() < 5 / np.sqrt(48 * 64)
    assert drawn.std() == pytest.approx(0.01, rel=0.03)
    np.testing.assert_array_equal(Camera(width=64, height=48, dark_offset_v=0.01).dark_offsets_v(3, 2), drawn)


def test_a_pixel_that_sees_nothing_has_no_truth() -> None:
    seen = hits(Corner(extents_m=(0.2, 0.4)).surfaces(), CAMERA.rays(ALL_ROWS))
    assert (seen.surface[0, 0], seen.albedo[0, 0], seen.irradiance[0, 0]) == (-1, 0.0, 0.0)
    assert np.isnan(seen.points_m[:, 0, 0]).all()
    truth = Corner(extents_m=(0.2, 0.4)).light(CAMERA, ALL_ROWS).truth(1.0)
    assert np.isnan(truth["direct.depth"][0, 0])
    assert np.isfinite(truth["direct.depth"][24, 32])
    assert np.isfinite(expose_band(exposure(Corner(extents_m=(0.2, 0.4), asr=0.0)), ALL_ROWS).voltages.means_v).all()


@pytest.mark.parametrize(("width", "height"), [(1, 5), (5, 1), (1, 1)])
def test_a_card_of_one_column_or_row_has_the_first_separation_and_ratio(width: int, height: int) -> None:
    card = Card(separations_ns=(2.0, 9.0), mpi_ratios=(0.3, 0.9), clean_share=0.0)
    light = card.light(Camera(width=width, height=height), slice(None))
    assert light.delays_ns[1, 0, 0] - light.delays_ns[0, 0, 0] == pytest.approx(2.0)
    assert light.photons[1, 0, 0] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("x", "y", "hit"), [(0.0, 0.0, True), (2.0, 1.0, True), (2.001, 0.5, False), (1.0, -0.001, False)]
)
def test_the_edge_of_a_surface_belongs_to_it(x: float, y: float, hit: bool) -> None:
    surface = Surface(
        origin_m=(0.0, 0.0, 3.0), across=(1.0, 0.0, 0.0), along=(0.0, 1.0, 0.0), extents_m=(0.0, 2.0, 0.0, 1.0)
    )
    times = surface.distances(np.array([[x], [y], [0.0]]), np.array([[0.0], [0.0], [1.5]]))
    assert times[0] == (2.0 if hit else np.inf)


@pytest.mark.parametrize("scene", [Corner(), Corner(opening_deg=70.0), InterReflection()])
def test_surfaces_are_measured_in_metres_along_two_upright_directions(scene: Corner | InterReflection) -> None:
    for surface in scene.surfaces():
        axes = np.array([surface.across, surface.along])
        np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-12)


@pytest.mark.parametrize("distance_m", [0.8, 2.0, 4.5])
def test_photons_count_one_where_the_wall_faces_the_light(distance_m: float) -> None:
    light = Wall(distance_m=distance_m).light(Camera(width=41, height=31), slice(None))
    assert light.photons[0, 15, 20] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("tilt_deg", [(25.0, 0.0), (-10.0, 35.0)])
def test_a_tilted_wall_gets_less_light_by_the_cosine_of_incidence(tilt_deg: tuple[float, float]) -> None:
    """Light goes with cos θ/r², and is 1 for a wall at this distance that faces the lamp."""
    light = Wall(distance_m=2.0, tilt_deg=tilt_deg, asr=3.0).light(CAMERA, ALL_ROWS)
    x, y, z = CAMERA.rays(ALL_ROWS)
    slope_x, slope_y = (math.tan(math.radians(angle)) for angle in tilt_deg)
    normal = np.array([slope_x, slope_y, 1.0]) / math.sqrt(1.0 + slope_x**2 + slope_y**2)
    length = np.sqrt(1.0 + x * x + y * y)
    range_m = 2.0 * length / (1.0 + slope_x * x + slope_y * y)
    cosine = (normal[0] * x + normal[1] * y + normal[2] * z) / length
    np.testing.assert_allclose(light.photons[0], 4.0 * cosine / range_m**2, rtol=1e-9)


def test_bounces_that_carry_no_light_have_the_length_zero() -> None:
    """The reflector is behind the target's front: its patches do not light the front, and all directions miss it."""
    target = Surface(origin_m=(0.0, 0.0, 2.0), across=(1.0, 0.0, 0.0), along=(0.0, 1.0, 0.0), albedo=0.5)
    aside = Surface(
        origin_m=(1.0, 0.0, 3.0),
        across=(1.0, 0.0, 0.0),
        along=(0.0, 1.0, 0.0),
        extents_m=(-0.5, 0.5, -0.5, 0.5),
        albedo=0.5,
    )
    seen = hits((target,), np.array([0.0, 0.0, 1.0]).reshape(3, 1, 1))
    for bounce in (bounce_by_patches(seen, aside, count=4), bounce_by_directions(seen, aside, count=50)):
        assert (bounce.irradiance == 0.0).all()
        assert (bounce.lengths_m == 0.0).all()


@pytest.mark.parametrize("photons", [1e-3, 1.0, 250.0])
def test_truth_amplitudes_do_not_depend_on_how_many_photons_there_are(photons: float) -> None:
    light = Card(asr=2.0).light(CAMERA, ALL_ROWS)
    few = replace(light, photons=photons * light.photons, ambient=photons * light.ambient).truth(0.2746)
    for name, plane in light.truth(0.2746).items():
        np.testing.assert_allclose(few[name], plane, rtol=1e-12, err_msg=name)


@pytest.mark.parametrize(("height", "clean"), [(48, 8), (50, 8), (3, 0), (4, 1), (9, 2)])
def test_the_upper_sixth_of_a_card_is_clean_to_the_nearest_row(height: int, clean: int) -> None:
    ratio = Card(clean_share=1 / 6).light(Camera(width=4, height=height), slice(None)).truth(1.0)["mpi.ratio"]
    assert (ratio[:clean] == 0.0).all()
    assert (ratio[clean:] > 0.0).all()


def test_light_falls_on_the_front_of_a_surface_and_not_on_its_back() -> None:
    points = np.array([[0.0], [0.0], [2.0]])
    facing = np.array([[0.0], [0.0], [-1.0]])
    assert irradiance(points, facing)[0] == pytest.approx(1 / 4)
    assert irradiance(points, -facing)[0] == 0.0
    assert irradiance(np.full((3, 1), np.nan), facing)[0] == 0.0


def test_a_pixel_that_no_light_reaches_has_no_amplitude() -> None:
    dark = Light(delays_ns=np.zeros((2, 1, 1)), photons=np.zeros((2, 1, 1)), ambient=np.zeros((1, 1)))
    truth = dark.truth(0.2746)
    assert (truth["direct.amplitude"][0, 0], truth["mpi.amplitude"][0, 0]) == (0.0, 0.0)
    assert np.isnan([truth[name][0, 0] for name in ("direct.depth", "mpi.depth", "mpi.ratio", "mpi.delay")]).all()
