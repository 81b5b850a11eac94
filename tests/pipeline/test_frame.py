"""A frame prepared once and resolved in parts has the bits of a frame resolved whole."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli import resolve, simulate_scene
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.metadata import CaptureMetadata, Optics, Pixel, Pulse
from cadtof_cli.maps.layers import IN_KERNEL, Layer
from cadtof_cli.phasors.frame_mean import frame_mean
from cadtof_cli.pipeline.frame import joined_parts, prepare_frame, resolve_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.one_pixel import pixel_evidence
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan, MapSettings
from cadtof_cli.pipeline.stages import frame_stages
from cadtof_cli.resolver.diffuse.grid import View, patch_grid
from cadtof_cli.resolver.kernels import available_kernels
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.blocks import blocks_of
from tests.support.calibrations import made_up_calibration
from tests.support.diffuse_frames import Tail, phasors_of, wall_range
from tests.support.forward import step_frame
from tests.support.kernels import by_kernel

SIZE = (13, 7)


def frames(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(8)
    return [step_frame(rng, height=SIZE[0], width=SIZE[1]).reshape(2, 2, *SIZE) for _ in range(count)]


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("settings", [MapSettings(), MapSettings(pool=3), MapSettings(pool=3, average=3)])
def test_parts_that_were_pickled_and_resolved_join_to_the_whole_frame(settings: MapSettings, known: bool) -> None:
    metadata = CaptureMetadata(pixel=Pixel(integration_length=1e5 if known else None))
    plan = FramePlan(metadata=metadata, settings=settings)
    mean = frame_mean(frames(settings.average), saturated_counts=None)
    whole = resolve_frame(mean, plan=plan)
    assert whole.noise.estimated is not known
    assert np.isfinite(whole.maps.layer("direct.depth")).any()
    for count in (2, 5):
        stages = stages_of(mean, plan)
        prepared = prepare_frame(mean, stages)
        parts = [pickle.loads(pickle.dumps(part)) for part in prepared.parts(count)]
        assert sum(part.stored.shape[2] for part in parts) == SIZE[0] * SIZE[1]
        joined = joined_parts(parts[0], [resolve_pixels(part, stages) for part in parts])
        assert joined.noise.integration_length == whole.noise.integration_length
        np.testing.assert_array_equal(joined.maps.values, whole.maps.values)
        np.testing.assert_array_equal(joined.maps.status, whole.maps.status)


def test_every_frame_has_maps_of_its_own() -> None:
    plan = FramePlan(metadata=CaptureMetadata(pixel=Pixel(integration_length=1e5)))
    one, other = (resolve_frame(frame, plan=plan).maps for frame in frames(2))
    assert not np.shares_memory(one.pages, other.pages)
    assert (one.values != other.values).any()


def test_arrays_that_frames_share_are_read_only() -> None:
    metadata = CaptureMetadata(optics=Optics(focal_length_px=280.0), pixel=Pixel(integration_length=1e5))
    stages = frame_stages(
        FramePlan(metadata=metadata, settings=MapSettings(depth="z")), None, np.dtype(np.float64), SIZE
    )
    grid = patch_grid(24, 32, View(30.0, (15.5, 11.5)))
    for shared in (stages.correction.phasor_map.own, stages.depth.planar_per_range, grid.ray, grid.slope):
        assert shared is not None
        with pytest.raises(ValueError, match="read-only"):
            shared[..., 0] = 0.0


def test_min_confidence_is_compared_with_the_confidence_in_volts() -> None:
    metadata = CaptureMetadata(pixel=Pixel(integration_length=1e5))
    frame = frames(1)[0]
    confidence_v = np.hypot(*frame[0])
    min_confidence_v = float(np.median(confidence_v))
    plan = FramePlan(metadata=metadata, settings=MapSettings(min_confidence_v=min_confidence_v))
    low = (resolve_frame(frame, plan=plan).maps.status & StatusBit.LOW_CONFIDENCE) > 0
    pulse = np.exp(-((2 * np.pi * 1.7 / 2.354820045 / 40.0) ** 2) / 2)  # confidence is corrected for it
    np.testing.assert_array_equal(low, confidence_v / pulse < min_confidence_v)


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_min_confidence_hides_pixels_of_a_room_and_changes_no_other_pixel(waveform: str) -> None:
    """Surfaces that get no answer light the others all the same. Before, depths of a room were 4 cm wrong without them."""
    camera = {"width": 96, "height": 72, "focal_length_px": 84.0}
    (corner,) = simulate_scene("corner", seed=1, modulation={"waveform": waveform}, camera=camera).frames
    whole = resolve(corner)
    assert (whole.status & StatusBit.DIFFUSE_MPI > 0).all()
    least_v = float(np.quantile(whole["confidence"], 0.9))
    part = resolve(corner, min_confidence_v=least_v)
    low = whole["confidence"] < np.float32(least_v)
    np.testing.assert_array_equal(part.status == StatusBit.LOW_CONFIDENCE, low)
    for name in ("direct.depth", "direct.sigma", "mpi.depth", "mpi.amplitude"):
        np.testing.assert_array_equal(part[name], np.where(low, np.nan, whole[name]))


def room(size: tuple[int, int], focal_px: float) -> tuple[NDArray[np.float64], FramePlan]:
    """Return the voltages of a wall with a tail at every pixel, (2, 2, Y, X), and a plan that takes it for diffuse MPI."""
    p = phasors_of(wall_range(*size, focal_px, 2.0), {h: Tail(0.3, 3.0, 10.0).phasor(h) for h in (1, 2)})
    metadata = CaptureMetadata(
        pixel=Pixel(integration_length=1e5), optics=Optics(focal_length_px=focal_px), pulse=Pulse(fwhm_ns=0.0)
    )
    volts = np.stack([p.real, p.imag], axis=1) * metadata.modulation.amplitude_v
    return volts, FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model="diffuse")))


@pytest.mark.parametrize("kernel", available_kernels())
@pytest.mark.parametrize("pattern", ["rows", "columns", "chequerboard", "grid"])
@pytest.mark.parametrize("first", [0, 1])
def test_a_pattern_of_pixels_without_light_leaves_a_room_its_tail(pattern: str, first: int, kernel: str) -> None:
    """Before, a room got separate paths if just the pixels that are sampled had no light, and a tail if others had none."""
    size = 192, 240
    volts, plan = room(size, 210.0)
    y, x = np.mgrid[: size[0], : size[1]] + first
    odd = {"rows": y % 2, "columns": x % 2, "chequerboard": (x + y + first) % 2, "grid": (x % 2) | (y % 2)}[pattern]
    volts[:, :, odd == 1] = np.nan
    status = by_kernel(kernel, resolve_frame, volts, plan=plan).maps.status
    np.testing.assert_array_equal(status, np.where(odd == 1, StatusBit.NOT_FINITE, StatusBit.DIFFUSE_MPI))


@pytest.mark.parametrize("kernel", available_kernels())
def test_a_room_is_predicted_from_the_calibrated_values_of_its_pixels(kernel: str) -> None:
    """With the offsets and hot pixels of a camera, which the calibration knows, a room has the depths that it has without."""
    size = 96, 120
    volts, plan = room(size, 105.0)
    dark = made_up_calibration(plan.metadata, size, ("dark",)).dark
    assert dark is not None
    calibration = Calibration(dark=replace(dark, noise_v=np.zeros_like(dark.noise_v)))
    use = CalibrationUse(Path("made up"), calibration.digest)
    found = by_kernel(
        kernel, resolve_frame, volts + dark.offset_v, plan=replace(plan, calibration=use), calibration=calibration
    ).maps
    volts[:, :, dark.hot] = np.nan
    expected = by_kernel(kernel, resolve_frame, volts, plan=plan).maps
    np.testing.assert_array_equal(
        found.status, np.where(dark.hot, StatusBit.HOT_PIXEL, StatusBit.DIFFUSE_MPI) | StatusBit.CALIBRATED
    )
    for name in ("direct.depth", "direct.sigma", "mpi.amplitude"):
        np.testing.assert_allclose(found.layer(name), expected.layer(name), rtol=1e-5)


def test_a_layer_that_the_compiled_kernel_does_not_know_has_its_own_values(monkeypatch: pytest.MonkeyPatch) -> None:
    far = Layer("mpi.behind", "m", lambda source: (source.resolved.paths.phase_rad[1], source.metres))
    monkeypatch.setattr("cadtof_cli.maps.layers.wanted_layers", lambda **_: (*IN_KERNEL, far))
    # no other test has this plan, whose stages are kept
    settings = MapSettings(resolver=ResolverSettings(false_alarm=0.0123))
    plan = FramePlan(metadata=CaptureMetadata(pixel=Pixel(integration_length=1e5)), settings=settings)
    with blocks_of(17):
        maps = resolve_frame(frames(1)[0], plan=plan).maps
    assert np.isfinite(maps.layer("mpi.behind")).any()
    np.testing.assert_array_equal(maps.layer("mpi.behind"), maps.layer("mpi.depth"))


def test_random_starts_of_one_pixel_are_those_of_the_frame() -> None:
    settings = MapSettings(resolver=ResolverSettings(solver="lm", order="2", starts=1))
    plan = FramePlan(metadata=CaptureMetadata(pixel=Pixel(integration_length=1e5)), settings=settings)
    frame = frames(1)[0]
    maps = resolve_frame(frame, plan=plan).maps
    stages = stages_of(frame, plan)
    pixels, volts = prepare_frame(frame, stages), plan.metadata.modulation.amplitude_v
    for index in range(0, SIZE[0] * SIZE[1], 5):
        paths = pixel_evidence(pixels, index, stages).resolved.paths
        map_v = maps.layer("direct.amplitude").reshape(-1)[index]
        assert map_v == pytest.approx(paths.amplitude[0, 0] * volts, rel=1e-6, nan_ok=True)
