"""A lamp beside the camera: the range follows from the length of the light's way, which is computed here in space."""

from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Optics, Pixel, Pulse
from cadtof_cli.errors import SettingsError
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.optics import LampBeside
from cadtof_cli.pipeline.first_phasor import first_phasor_depth
from cadtof_cli.pipeline.frame import joined_parts, prepare_frame, resolve_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.one_pixel import pixel_evidence
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.units import unambiguous_range_m
from tests.support.diffuse_frames import F, phasors_of, slopes
from tests.support.kernels import by_kernel
from tests.support.run_cadtof import cadtof

OFFSETS = [(0.1, 0.0, 0.0), (0.0, -0.05, 0.0), (0.02, 0.03, 0.1), (0.0, 0.0, -0.2)]
SIZE = (48, 64)


def rays() -> F:
    x, y = slopes(*SIZE, focal_px=60.0)
    r = np.stack([x, y, np.ones(SIZE)])
    return np.asarray(r / np.linalg.norm(r, axis=0))


def half_way(range_m: F, offset: tuple[float, float, float]) -> F:
    """Return half the way from the lamp to the surface and on to the camera."""
    to_lamp = np.linalg.norm(rays() * range_m - np.array(offset)[:, None, None], axis=0)
    return np.asarray(0.5 * (to_lamp + range_m))


def metadata(offset: tuple[float, float, float] | None, focal_px: float | None = 60.0) -> CaptureMetadata:
    return CaptureMetadata(
        modulation=Modulation(amplitude_v=1.0),
        pixel=Pixel(integration_length=1e5),
        pulse=Pulse(fwhm_ns=0.0),
        optics=Optics(focal_length_px=focal_px, lamp_offset_m=offset),
    )


def volts(half_m: F) -> F:
    p = phasors_of(half_m, n_av=1e5)
    return np.stack([np.stack([one.real, one.imag]) for one in p])


@pytest.mark.parametrize("offset", OFFSETS)
def test_the_range_is_that_from_the_camera(offset: tuple[float, float, float]) -> None:
    range_m = np.linspace(0.3, 5.0, SIZE[0] * SIZE[1]).reshape(SIZE)
    lamp = LampBeside.of(Optics(focal_length_px=60.0, lamp_offset_m=offset), SIZE)
    assert lamp is not None
    found = lamp.range_m(half_way(range_m, offset).ravel(), slice(None))
    np.testing.assert_allclose(found, range_m.ravel(), atol=1e-9)
    np.testing.assert_allclose(lamp.half_way_m(range_m.ravel()), half_way(range_m, offset).ravel(), atol=1e-12)


@pytest.mark.parametrize("offset", [(0.1, 0.02, 0.0), (0.5, 0.0, 0.0)])
@pytest.mark.parametrize("depth", ["range", "z"])
@pytest.mark.parametrize("kernel", [None, "numpy"])
def test_light_that_went_less_far_than_the_lamp_is_away_comes_from_beyond_the_range(
    depth: str, kernel: str | None, offset: tuple[float, float, float]
) -> None:
    """Half a way of 2 cm cannot be, with a lamp 10 cm beside the camera; 6.016 m can. Without a message, the depth was 0."""
    lamp = LampBeside.of(Optics(focal_length_px=60.0, lamp_offset_m=offset), SIZE)
    assert lamp is not None
    half = np.full(SIZE, 0.02 + unambiguous_range_m(40.0))
    truth = lamp.range_m(half.ravel(), slice(None)).reshape(SIZE)
    assert truth.min() > 5.8
    plan = FramePlan(metadata=metadata(offset), settings=MapSettings(depth="z" if depth == "z" else "range"))
    maps = by_kernel(kernel, resolve_frame, volts(half), plan=plan).maps
    error = maps.layer(DIRECT_DEPTH) - (truth * rays()[2] if depth == "z" else truth)
    assert abs(np.median(error)) < 5e-4
    np.testing.assert_allclose(
        first_phasor_depth(volts(half), plan=plan), truth * (rays()[2] if depth == "z" else 1), atol=0.05
    )


@pytest.mark.parametrize("offset", [None, (0.0, 0.0, 0.0)])
def test_a_lamp_at_the_camera_needs_no_correction(offset: tuple[float, float, float] | None) -> None:
    assert LampBeside.of(Optics(lamp_offset_m=offset), SIZE) is None


def test_a_lamp_needs_the_focal_length() -> None:
    with pytest.raises(SettingsError, match="focal_length_px"):
        LampBeside.of(Optics(lamp_offset_m=(0.1, 0.0, 0.0)), SIZE)


@pytest.mark.parametrize("depth", ["range", "z"])
@pytest.mark.parametrize("kernel", [None, "numpy"])
def test_maps_hold_depth_from_the_camera(depth: str, kernel: str | None) -> None:
    offset = (0.1, 0.02, 0.0)
    range_m = np.full(SIZE, 0.8)
    truth = range_m * rays()[2] if depth == "z" else range_m
    plan = FramePlan(metadata=metadata(offset), settings=MapSettings(depth="z" if depth == "z" else "range"))
    found = by_kernel(kernel, resolve_frame, volts(half_way(range_m, offset)), plan=plan).maps.layer(DIRECT_DEPTH)
    # the noise of one pixel is some 3 mm; the lamp moves the depth by 3 mm to 3 cm
    assert abs(np.median(found - truth)) < 2e-4
    left, right = (np.median((found - truth)[:, part]) for part in (slice(0, 16), slice(48, 64)))
    assert max(abs(left), abs(right)) < 5e-4


@pytest.mark.parametrize("offset", [*OFFSETS, (0.5, -0.3, 0.1)])
def test_the_growth_of_the_range_is_its_derivative(offset: tuple[float, float, float]) -> None:
    range_m = np.linspace(0.3, 5.0, SIZE[0] * SIZE[1]).reshape(SIZE)
    lamp = LampBeside.of(Optics(focal_length_px=60.0, lamp_offset_m=offset), SIZE)
    assert lamp is not None
    more, half = (half_way(range_m + step, offset).ravel() for step in (1e-6, 0.0))
    np.testing.assert_allclose(lamp.range_per_half_way(half, slice(None)), 1e-6 / (more - half), rtol=1e-4)


@pytest.mark.parametrize("depth", ["range", "z"])
@pytest.mark.parametrize("kernel", [None, "numpy"])
def test_sigma_is_that_of_the_depth_from_the_camera(depth: str, kernel: str | None) -> None:
    """A lamp .5 m to the side makes the range grow a third faster than half the way of the light, .3 m before the camera."""
    offset = (0.5, 0.0, 0.0)
    range_m = np.full(SIZE, 0.3)
    growth = 1e-6 / (half_way(range_m + 1e-6, offset) - half_way(range_m, offset))
    stored, settings = volts(half_way(range_m, offset)), MapSettings(depth="z" if depth == "z" else "range")
    plan, at_camera = (FramePlan(metadata=metadata(lamp), settings=settings) for lamp in (offset, None))
    found, of_half_way = (
        by_kernel(kernel, resolve_frame, stored, plan=one).maps.layer(DIRECT_SIGMA) for one in (plan, at_camera)
    )
    assert growth.min() > 1.1
    np.testing.assert_allclose(found, of_half_way * growth, rtol=0.05)
    stages = stages_of(stored, plan)
    evidence = pixel_evidence(prepare_frame(stored, stages), 5, stages)
    assert evidence.one is not None
    assert evidence.one[0].sigma_m == pytest.approx(found[0, 5], rel=1e-5)


def test_a_frame_with_a_lamp_is_resolved_in_parts_with_the_same_maps() -> None:
    offset = (0.1, 0.02, 0.0)
    plan = FramePlan(metadata=metadata(offset))
    frame = volts(half_way(np.full(SIZE, 0.8), offset))
    stages = stages_of(frame, plan)
    pixels = prepare_frame(frame, stages)
    split = joined_parts(pixels, [resolve_pixels(part, stages) for part in pixels.parts(5)])
    whole = joined_parts(pixels, [resolve_pixels(pixels, stages)])
    np.testing.assert_array_equal(split.maps.values, whole.maps.values)


def test_a_pixel_without_an_answer_stays_without() -> None:
    stored = volts(np.full(SIZE, 0.8))
    stored[:, :, 3, 4] = np.nan
    maps = resolve_frame(stored, plan=FramePlan(metadata=metadata((0.1, 0.0, 0.0)))).maps
    assert np.isnan(maps.layer(DIRECT_DEPTH)[3, 4])
    assert np.isfinite(maps.layer(DIRECT_DEPTH)).sum() == SIZE[0] * SIZE[1] - 1


def test_a_simulated_capture_names_its_lamp(tmp_path: Path) -> None:
    out = tmp_path / "room"
    size = ("--width", "32", "--height", "24", "--light-paths", "4")
    cadtof("simulate", "--scene", "room", "--seed", "3", *size, "--lamp-offset", "0.1,0,0", "-o", str(out))
    assert "lamp_offset_m = [0.1, 0.0, 0.0]" in (out / "capture.toml").read_text()


@pytest.mark.parametrize("depth", ["range", "z"])
def test_the_first_phasor_and_one_pixel_are_measured_from_the_camera_too(depth: str) -> None:
    offset = (0.1, 0.02, 0.0)
    range_m = np.full(SIZE, 0.8)
    truth = range_m * rays()[2] if depth == "z" else range_m
    plan = FramePlan(metadata=metadata(offset), settings=MapSettings(depth="z" if depth == "z" else "range"))
    stored = volts(half_way(range_m, offset))
    found = first_phasor_depth(stored, plan=plan)
    for part in (slice(0, 16), slice(48, 64)):
        assert abs(np.median((found - truth)[:, part])) < 1e-3
    stages = stages_of(stored, plan)
    evidence = pixel_evidence(prepare_frame(stored, stages), 5, stages)
    assert evidence.one is not None
    resolved = resolve_frame(stored, plan=plan).maps.layer(DIRECT_DEPTH)
    assert evidence.one[0].depth_m == pytest.approx(resolved[0, 5], abs=1e-6)
