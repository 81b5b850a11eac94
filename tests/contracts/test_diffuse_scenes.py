"""A contract for every MPI model on every simulated scene at every integration length; the truth is simulated too."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Optics, Pixel
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.pipeline.frame import (
    ResolvedFrame,
    joined_parts,
    prepare_frame,
    resolve_frame,
    resolve_pixels,
    stages_of,
)
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.kernels import available_kernels
from cadtof_cli.resolver.settings import MpiModel, ResolverSettings
from cadtof_cli.simulation.pixel.averaging import averaging_gain
from cadtof_cli.simulation.pixel.statistics import VoltageStatistics
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Band, Exposure, frame_voltages
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.rooms.cornell import CornellBox
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.simulation.scene.scenes import Card, Corner, InterReflection, Wall
from cadtof_cli.workflows.simulate.record import expose
from tests.support.blocks import blocks_of
from tests.support.diffuse_frames import F
from tests.support.kernels import by_kernel

DIFFUSE = 2048

LENGTHS = (2e3, 1e4, 1e6)

MODELS: tuple[MpiModel, ...] = ("discrete", "diffuse", "auto")

SCENES: dict[str, Scene] = {
    "card": Card(distance_m=3.0, separations_ns=(6.0, 20.0), mpi_ratios=(0.3, 0.6)),
    "weak first": Card(distance_m=1.0, separations_ns=(9.0, 12.0), mpi_ratios=(2.5, 3.0), clean_share=0.0),
    "one share": Card(distance_m=2.0, separations_ns=(9.0, 16.0), mpi_ratios=(0.2, 0.2)),
    "weak second": Card(mpi_ratios=(0.02, 0.02)),
    "one share and delay": Card(distance_m=1.5, separations_ns=(8.0, 8.0), mpi_ratios=(0.1, 0.1), clean_share=0.0),
    "weak ramp": Card(mpi_ratios=(0.005, 0.03)),
    "by a reflector": InterReflection(distance_m=2.0, wall_m=3.0, mpi_ratio=0.1, reflector_m=3.0),
    "wall": Wall(distance_m=2.0),
    "corner": Corner(),
    "room": RandomRoom(seed=5, light_paths=48),
    "cornell": CornellBox(light_paths=48),
}

TAILS = ("corner", "room", "cornell")
"""Scenes whose MPI is a tail."""

CAMERA = Camera(width=96, height=72)


@cache
def exposure(name: str) -> Exposure:
    metadata = CaptureMetadata(pixel=Pixel(integration_length=1e5), optics=CAMERA.optics)
    return Exposure(scene=SCENES[name], camera=CAMERA, metadata=metadata, seed=3)


@cache
def traced(name: str) -> Band:
    return expose(exposure(name))


@cache
def recorded(name: str, length: float) -> tuple[F, F, CaptureMetadata]:
    """Return the voltages of one frame, the true range, and the metadata."""
    usual, whole = exposure(name), traced(name)
    gain = averaging_gain(length) / averaging_gain(usual.integration_length)
    noisy = VoltageStatistics(whole.voltages.means_v, gain * whole.voltages.covariances_v2)
    metadata = replace(usual.metadata, pixel=Pixel(integration_length=length))
    shown = replace(usual, metadata=metadata)
    return frame_voltages(shown, Band(noisy, whole.truth), 0), whole.truth["direct.depth"], metadata


@cache
def resolved(name: str, model: MpiModel, length: float) -> ResolvedFrame:
    volts, _, metadata = recorded(name, length)
    settings = MapSettings(resolver=ResolverSettings(mpi_model=model))
    return resolve_frame(volts, plan=FramePlan(metadata=metadata, settings=settings))


def error_m(frame: ResolvedFrame, truth_m: F) -> F:
    found = np.abs(frame.maps.layer(DIRECT_DEPTH) - truth_m)
    return np.asarray(found[np.isfinite(found)])


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", SCENES)
def test_every_pixel_with_light_has_a_depth_and_a_sigma(name: str, model: MpiModel, length: float) -> None:
    frame, (_, truth_m, _) = resolved(name, model, length), recorded(name, length)
    depth, sigma = (frame.maps.layer(layer) for layer in (DIRECT_DEPTH, DIRECT_SIGMA))
    seen = np.isfinite(truth_m)
    # a tail that is forced on two paths asks for impossible amplitudes in some pixels
    assert np.isfinite(depth[seen]).mean() > (0.95 if model == "diffuse" else 0.97)
    np.testing.assert_array_equal(np.isfinite(sigma), np.isfinite(depth))
    assert (sigma[np.isfinite(sigma)] > 0).all()
    answered_by_tail = (frame.maps.status & DIFFUSE) > 0
    assert not (answered_by_tail & ((frame.maps.status & 3) > 0)).any()
    if model == "discrete":
        assert not answered_by_tail.any()
    if model == "diffuse":
        np.testing.assert_array_equal(answered_by_tail, np.isfinite(depth))


WITHOUT_TAIL = [
    *(
        (name, length)
        for name in ("card", "weak first", "one share", "one share and delay", "wall")
        for length in LENGTHS
    ),
    *(("weak second", length) for length in LENGTHS[1:]),
    ("weak ramp", LENGTHS[2]),
    ("by a reflector", LENGTHS[2]),
]
"""Scenes whose MPI is no tail, with the integration lengths at which this can be seen. At the shortest length, a second
path with a fiftieth of the direct light is hardly seen."""


@pytest.mark.parametrize(("name", "length"), WITHOUT_TAIL)
def test_frames_without_a_tail_have_the_bits_of_the_discrete_model(name: str, length: float) -> None:
    taken, discrete = resolved(name, "auto", length), resolved(name, "discrete", length)
    assert taken.mpi is not None
    assert taken.mpi.taken == "discrete"
    np.testing.assert_array_equal(taken.maps.values, discrete.maps.values)
    np.testing.assert_array_equal(taken.maps.status, discrete.maps.status)


@pytest.mark.parametrize("window", [3, 5, 9])
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("name", ["one share", "one share and delay", "wall", *TAILS])
def test_pooling_does_not_change_the_model_of_a_frame(name: str, length: float, window: int) -> None:
    """Pooled neighbours share noise. This must look neither like MPI nor like a tail that noise hides in each patch."""
    volts, _, metadata = recorded(name, length)
    found = resolve_frame(volts, plan=FramePlan(metadata=metadata, settings=MapSettings(pool=window)))
    assert found.mpi is not None
    assert found.mpi.taken == ("diffuse" if name in TAILS else "discrete")
    if name == "wall":
        assert found.mpi.reason == "no MPI to be seen"


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("name", TAILS)
def test_the_diffuse_model_reduces_the_errors_of_frames_with_a_tail(name: str, length: float) -> None:
    """In rooms the median error is at most half of that of two paths; in a bare corner two paths are good already.

    Sigma accounts for the remaining errors.
    """
    taken, truth_m = resolved(name, "auto", length), recorded(name, length)[1]
    assert taken.mpi is not None
    assert taken.mpi.taken == "diffuse"
    found, two = error_m(taken, truth_m), error_m(resolved(name, "discrete", length), truth_m)
    assert np.median(found) < (1.0 if name == "corner" else 0.5) * np.median(two)
    depth, sigma = (taken.maps.layer(layer) for layer in (DIRECT_DEPTH, DIRECT_SIGMA))
    share = np.mean(np.abs(depth - truth_m)[np.isfinite(depth)] < sigma[np.isfinite(depth)])
    assert 0.4 < share < 0.995


@pytest.mark.parametrize("harmonics", [2, 3])
@pytest.mark.parametrize("period_ns", [60.0, 100.0])
@pytest.mark.parametrize("name", TAILS)
def test_with_slower_modulation_the_error_is_still_halved_and_sigma_is_true(
    name: str, period_ns: float, harmonics: int
) -> None:
    periods = tuple(period_ns / h for h in range(1, harmonics + 1))
    usual = exposure(name)
    shown = replace(usual, metadata=replace(usual.metadata, modulation=Modulation(periods_ns=periods)))
    whole = expose(shown)
    volts, truth = frame_voltages(shown, whole, 0), whole.truth["direct.depth"]
    tail, paths = (
        resolve_frame(volts, plan=FramePlan(metadata=shown.metadata, settings=MapSettings(resolver=settings)))
        for settings in (ResolverSettings(), ResolverSettings(mpi_model="discrete"))
    )
    assert tail.mpi is not None
    assert tail.mpi.taken == "diffuse"
    error = error_m(tail, truth)
    sigma = tail.maps.layer(DIRECT_SIGMA)[np.isfinite(tail.maps.layer(DIRECT_DEPTH))]
    assert np.median(error) < 0.5 * np.median(error_m(paths, truth))
    assert 0.4 < (error < sigma).mean() < 0.97


@pytest.mark.parametrize("size", [(1, 1), (1, 96), (72, 1), (3, 50), (31, 33), (72, 96)])
@pytest.mark.parametrize("model", ["diffuse", "auto"])
def test_frames_of_any_size_have_answers(size: tuple[int, int], model: MpiModel) -> None:
    volts, truth_m, metadata = recorded("room", 1e4)
    cut = np.ascontiguousarray(volts[..., : size[0], : size[1]])
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model=model)))
    depth = resolve_frame(cut, plan=plan).maps.layer(DIRECT_DEPTH)
    assert depth.shape == size
    assert np.isfinite(depth[np.isfinite(truth_m[: size[0], : size[1]])]).mean() > 0.97


def test_a_frame_enlarged_to_a_megapixel_has_the_same_depths() -> None:
    """Every pixel becomes 12 × 12 pixels. The patches stay the same, and so do the depths.

    Only the noise of the pixels at which patches are sampled makes a difference.
    """
    volts, truth_m, metadata = recorded("room", 1e5)
    large = np.repeat(np.repeat(volts, 12, axis=2), 12, axis=3)
    x, y = (12 * c + 5.5 for c in ((CAMERA.width - 1) / 2, (CAMERA.height - 1) / 2))
    focal = 12 * float(metadata.optics.focal_length_px or 0.0)
    wide = replace(metadata, optics=Optics(focal_length_px=focal, principal_point_px=(x, y)))
    assert large[0, 0].size > 9e5
    found = resolve_frame(large, plan=FramePlan(metadata=wide))
    usual = resolved("room", "auto", 1e5)
    median_error, direct = np.median(error_m(usual, truth_m)), "direct.depth"
    enlarged = np.repeat(np.repeat(usual.maps.layer(direct), 12, axis=0), 12, axis=1)
    assert np.median(np.abs(found.maps.layer(direct) - enlarged)) < 0.5 * median_error
    truth = np.repeat(np.repeat(truth_m, 12, axis=0), 12, axis=1)
    assert np.median(error_m(found, truth)) < 1.2 * median_error


def with_lost_pixels(volts: F) -> tuple[F, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    """Return voltages with a lost column, a hole and single pixels of NaN, and where these are."""
    lost = np.zeros(volts.shape[2:], np.bool_)
    lost[:, 17] = lost[20:31, 40:55] = True
    lost[np.random.default_rng(1).random(lost.shape) < 0.02] = True
    return np.where(lost, np.nan, volts), lost


@pytest.mark.parametrize("model", ["diffuse", "auto"])
@pytest.mark.parametrize("name", ["room", "corner"])
def test_pixels_of_nan_have_no_answer_and_do_not_harm_the_others(name: str, model: MpiModel) -> None:
    volts, truth_m, metadata = recorded(name, 1e4)
    broken, lost = with_lost_pixels(volts)
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model=model)))
    found = resolve_frame(broken, plan=plan)
    depth = found.maps.layer(DIRECT_DEPTH)
    np.testing.assert_array_equal(np.isnan(depth[lost]), True)
    assert np.isfinite(depth[~lost & np.isfinite(truth_m)]).mean() > 0.97
    whole = np.median(error_m(resolved(name, model, 1e4), truth_m))
    assert np.median(error_m(found, truth_m)) < 1.5 * whole + 0.002


def averaged(volts: F) -> FrameMean:
    return FrameMean(volts, np.full(volts.shape[2:], 4.0), volts.dtype)


@pytest.mark.parametrize("variant", ["pool 3", "average 4", "z", "unknown optics", "estimated noise", "beyond 6 m"])
def test_the_tail_is_found_with_other_settings_metadata_and_ranges(variant: str) -> None:
    volts, truth_m, metadata = recorded("room", 1e4)
    settings = MapSettings()
    frame: F | FrameMean = volts
    if variant == "pool 3":
        settings = MapSettings(pool=3)
    if variant == "average 4":
        frame = averaged(volts)
    if variant == "z":
        settings = MapSettings(depth="z")
    if variant == "unknown optics":
        metadata = replace(metadata, optics=Optics())
    if variant == "estimated noise":
        metadata = replace(metadata, pixel=Pixel(integration_length=None))
    if variant == "beyond 6 m":
        frame = moved_away(volts, metadata, 4.5)
    found = resolve_frame(frame, plan=FramePlan(metadata=metadata, settings=settings))
    assert found.mpi is not None
    depth = found.maps.layer(DIRECT_DEPTH)
    if variant == "beyond 6 m":
        assert np.isfinite(depth).mean() > 0.97
        return
    assert found.mpi.taken == "diffuse"
    if variant == "z":
        truth_m = truth_m * cosines()
    two = np.median(error_m(resolved("room", "discrete", 1e4), truth_m))
    assert np.nanmedian(np.abs(depth - truth_m)) < 0.75 * two


def cosines() -> F:
    rays = CAMERA.rays(slice(None))
    return np.asarray(1.0 / np.linalg.norm(rays, axis=0))


def moved_away(volts: F, metadata: CaptureMetadata, further_m: float) -> F:
    """Return the voltages of the scene if it were so much farther away."""
    turn = 4 * np.pi * further_m / (0.299792458 * metadata.modulation.periods_ns[0])
    phasors = [(pair[0] + 1j * pair[1]) * np.exp(1j * h * turn) for h, pair in enumerate(volts, 1)]
    return np.stack([np.stack([p.real, p.imag]) for p in phasors])


@pytest.mark.parametrize("periods_ns", [(40.0, 20.0, 40 / 3), (40.0, 20.0, 10.0), (40.0, 20.0, 40 / 3, 10.0)])
@pytest.mark.parametrize("length", [2e3, 1e4])
def test_with_further_harmonics_and_little_light_a_corner_is_not_taken_for_two_paths(
    periods_ns: tuple[float, ...], length: float
) -> None:
    """With little light, two paths also predict the further harmonics of the corner's tail, but with large errors."""
    metadata = CaptureMetadata(
        modulation=Modulation(periods_ns=periods_ns), pixel=Pixel(integration_length=length), optics=CAMERA.optics
    )
    shown = Exposure(scene=SCENES["corner"], camera=CAMERA, metadata=metadata, seed=3)
    band = expose(shown)
    errors = []
    for model in ("auto", "discrete"):
        settings = MapSettings(resolver=ResolverSettings(mpi_model=model))
        found = resolve_frame(frame_voltages(shown, band, 0), plan=FramePlan(metadata=metadata, settings=settings))
        assert model == "discrete" or (found.mpi is not None and found.mpi.taken == "diffuse")
        errors.append(np.median(error_m(found, band.truth["direct.depth"])))
    assert errors[0] < max(0.75 * errors[1], 0.009)


@cache
def of_triangles(name: str, harmonics: int = 2) -> tuple[F, F, CaptureMetadata]:
    """Return the voltages of one frame with triangle modulation, the true range, and the metadata."""
    periods = tuple(40.0 / h for h in range(1, harmonics + 1))
    metadata = replace(recorded(name, 1e4)[2], modulation=Modulation(periods_ns=periods, waveform="triangle"))
    shown = replace(exposure(name), metadata=metadata)
    whole = expose(shown)
    return frame_voltages(shown, whole, 0), whole.truth["direct.depth"], metadata


@pytest.mark.parametrize(("name", "more"), [("corner", 3.0), ("room", 1.2), ("cornell", 1.2)])
def test_errors_with_triangle_modulation_are_nearly_those_with_sines(name: str, more: float) -> None:
    """The other terms of a triangle are those of the tail at further harmonics, not those of paths fitted to noise."""
    volts, truth_m, metadata = of_triangles(name)
    found = resolve_frame(volts, plan=FramePlan(metadata=metadata))
    assert found.mpi is not None
    assert found.mpi.taken == "diffuse"
    error, sigma = np.abs(found.maps.layer(DIRECT_DEPTH) - truth_m), found.maps.layer(DIRECT_SIGMA)
    of_sines = error_m(resolved(name, "auto", 1e4), recorded(name, 1e4)[1])
    assert np.nanmedian(error) < more * np.median(of_sines)
    seen = np.isfinite(error)
    assert 0.5 < np.mean(error[seen] < sigma[seen]) < 0.95
    assert np.mean(error[seen] < 2 * sigma[seen]) > 0.9


@pytest.mark.parametrize("name", ["corner", "room"])
def test_a_third_harmonic_of_a_triangle_reduces_the_errors_of_a_tail(name: str) -> None:
    median = []
    for harmonics in (2, 3):
        volts, truth_m, metadata = of_triangles(name, harmonics)
        found = resolve_frame(volts, plan=FramePlan(metadata=metadata))
        assert found.mpi is not None
        assert found.mpi.taken == "diffuse"
        median.append(np.median(error_m(found, truth_m)))
    assert median[1] < 0.75 * median[0]
    seen, sigma = error_m(found, truth_m), found.maps.layer(DIRECT_SIGMA)
    assert 0.55 < np.mean(seen < sigma[np.isfinite(sigma)]) < 0.97


def test_tails_with_triangle_modulation_have_the_same_bits_in_all_kernels_blocks_and_parts() -> None:
    volts, _, metadata = of_triangles("room")
    whole = resolve_frame(volts, plan=FramePlan(metadata=metadata))
    for kernel in available_kernels():
        other = by_kernel(kernel, resolve_frame, volts, plan=FramePlan(metadata=metadata))
        np.testing.assert_array_equal(other.maps.values, whole.maps.values, kernel)
    with blocks_of(997):
        cut = resolve_frame(volts, plan=FramePlan(metadata=metadata))
    np.testing.assert_array_equal(cut.maps.values, whole.maps.values)
    stages = stages_of(volts, FramePlan(metadata=metadata))
    pixels = prepare_frame(volts, stages)
    parts = [resolve_pixels(part, stages) for part in pixels.parts(5)]
    np.testing.assert_array_equal(joined_parts(pixels, parts).maps.values, whole.maps.values)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_frame_without_any_signal_has_no_depth(model: MpiModel, value: float) -> None:
    volts, _, metadata = recorded("room", 1e4)
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model=model)))
    assert np.isnan(resolve_frame(np.full_like(volts, value), plan=plan).maps.layer(DIRECT_DEPTH)).all()
