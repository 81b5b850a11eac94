"""One part of a calibration alone, applied as `resolve` does, removes what the camera adds and changes nothing else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.petzval import PetzvalCalibration
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.calibration.store import Part, load_calibration, save_part
from cadtof_cli.capture.metadata import CaptureMetadata, Optics, Pixel
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.phasors.response import HarmonicResponse
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.calibrations import PETZVAL_QUALITY, curved, response_quality
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, T1_NS

F = NDArray[np.float64]

SHAPE = (12, 16)
RANGE_M = C_M_PER_NS * T1_NS / 2
METADATA = CaptureMetadata(pixel=Pixel(integration_length=1e5))
ORIGIN = Origin(captures=("made up",), frames=10, pixels=SHAPE, periods_ns=(40.0, 20.0), waveform="sine")
K2_M, K4_M = 0.06, -0.02
POINT_PX = (9.0, 4.0)
PULSE = {h: np.exp(-((h * 2 * np.pi * 1.7 / 2.354820045 / T1_NS) ** 2) / 2) for h in (1, 2)}
"""Share of each harmonic that a pulse of 1.7 ns leaves."""


def volts(*paths: tuple[F | float, F]) -> F:
    """Return noiseless voltages, (2, 2, Y, X), of paths given by amplitude and range in m, with a pulse of 1.7 ns."""
    planes = []
    for h in (1, 2):
        phasor = PULSE[h] * sum(a * np.exp(2j * np.pi * h * range_m / RANGE_M) for a, range_m in paths)
        planes.append(AMPLITUDE_V * np.stack([np.real(phasor), np.imag(phasor)]))
    return np.stack(planes)


def curvature_m(point_px: tuple[float, float]) -> F:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    rho = np.hypot(x - point_px[0], y - point_px[1]) / (np.hypot(*SHAPE) / 2)
    return np.asarray(K2_M * rho**2 + K4_M * rho**4)


def maps_of(
    frame: F, folder: Path, *parts: Part, order: str = "2", metadata: CaptureMetadata = METADATA, curved: bool = True
) -> DepthMaps:
    for part in parts:
        save_part(folder, part)
    calibration = load_calibration(folder) if parts else None
    use = CalibrationUse(folder, calibration.digest, curved) if calibration else None
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(order=order)), calibration=use)
    return resolve_frame(frame, plan=plan, calibration=calibration).maps


def ranges_m(seed: int = 0) -> F:
    """Return ranges over nearly the whole unambiguous range, in random order, (Y, X)."""
    return (
        np.random.default_rng(seed).permutation(np.linspace(0.01, RANGE_M - 0.01, SHAPE[0] * SHAPE[1])).reshape(SHAPE)
    )


def petzval(point_px: tuple[float, float] = POINT_PX) -> PetzvalCalibration:
    return PetzvalCalibration(ORIGIN, curved(K2_M, K4_M, point_px), PETZVAL_QUALITY)


@pytest.mark.parametrize("order", ["1", "2"])
def test_the_dark_part_alone_removes_offsets(tmp_path: Path, order: str) -> None:
    rng = np.random.default_rng(1)
    offset = rng.normal(0.0, 0.02, (2, 2, *SHAPE)).astype(np.float32)
    defects = np.zeros(SHAPE, np.uint32)
    defects[3, 5] = 1
    near_m, far_m = ranges_m() * 0.4 + 0.1, ranges_m(1) * 0.4 + 3.0
    clean = volts((0.3, near_m)) if order == "1" else volts((0.3, near_m), (0.1, far_m))
    dark = DarkCalibration(ORIGIN, offset, np.full_like(offset, 1e-4), defects)
    maps = maps_of(clean + offset, tmp_path, dark, order=order)
    sound = defects == 0
    np.testing.assert_allclose(maps.layer("direct.depth")[sound], near_m[sound], atol=2e-6)
    np.testing.assert_allclose(maps.layer("direct.amplitude")[sound], 0.3 * AMPLITUDE_V, rtol=1e-5)
    if order == "2":
        np.testing.assert_allclose(maps.layer("mpi.depth")[sound], far_m[sound], atol=2e-5)
    answer = StatusBit.ONE_PATH if order == "1" else StatusBit.TWO_PATHS
    assert (maps.status[sound] == answer | StatusBit.CALIBRATED).all()
    assert maps.status[3, 5] == StatusBit.HOT_PIXEL | StatusBit.CALIBRATED
    for name in ("direct.depth", "mpi.depth", "direct.amplitude", "direct.sigma", "confidence"):
        assert np.isnan(maps.layer(name)[3, 5])


def test_the_petzval_part_alone_removes_field_curvature(tmp_path: Path) -> None:
    """The curvature is up to 6 cm. Without the correction, pixels off the axis are wrong, and ranges at the end wrap."""
    truth_m = ranges_m()
    recorded = truth_m + curvature_m(POINT_PX)
    assert (recorded > RANGE_M).any()
    maps = maps_of(volts((0.3, recorded)), tmp_path, petzval(), order="1")
    np.testing.assert_allclose(maps.layer("direct.depth"), truth_m, atol=2e-6)
    np.testing.assert_allclose(maps.layer("direct.amplitude"), 0.3 * AMPLITUDE_V, rtol=1e-5)
    straight = maps_of(volts((0.3, recorded)), tmp_path / "uncalibrated", order="1")
    np.testing.assert_allclose(straight.layer("direct.depth"), recorded % RANGE_M, atol=2e-6)


def test_field_curvature_is_removed_from_both_paths(tmp_path: Path) -> None:
    near_m, far_m = ranges_m() * 0.3 + 0.2, ranges_m(1) * 0.4 + 3.0
    curvature = curvature_m(POINT_PX)
    maps = maps_of(volts((0.3, near_m + curvature), (0.1, far_m + curvature)), tmp_path, petzval())
    np.testing.assert_allclose(maps.layer("direct.depth"), near_m, atol=2e-6)
    np.testing.assert_allclose(maps.layer("mpi.depth"), far_m, atol=2e-5)


def response(curvature: tuple[float, float], **maps: F) -> ResponseCalibration:
    responses = tuple(HarmonicResponse(h, ((1, complex(pulse)),)) for h, pulse in PULSE.items())
    phase = np.asarray(maps.get("phase", np.zeros((2, *SHAPE))), np.float32)
    gain = np.asarray(maps.get("gain", np.ones((2, *SHAPE))), np.float32)
    return ResponseCalibration(ORIGIN, responses, phase, gain, curved(*curvature, POINT_PX), response_quality(2))


@pytest.mark.parametrize("point_px", [POINT_PX, (2.0, 7.0), None])
def test_without_a_petzval_part_the_curvature_of_the_response_part_is_removed(
    tmp_path: Path, point_px: tuple[float, float] | None
) -> None:
    """ρ counts from the principal point with which the part was measured, whatever the capture says or leaves out."""
    metadata = replace(METADATA, optics=Optics(focal_length_px=14.0, principal_point_px=point_px))
    truth_m = ranges_m()
    recorded = volts((0.3, truth_m + curvature_m(POINT_PX)))
    maps = maps_of(recorded, tmp_path, response((K2_M, K4_M)), order="1", metadata=metadata)
    np.testing.assert_allclose(maps.layer("direct.depth"), truth_m, atol=2e-6)


def test_the_petzval_part_replaces_the_curvature_of_the_response_part(tmp_path: Path) -> None:
    truth_m = ranges_m()
    recorded = volts((0.3, truth_m + curvature_m(POINT_PX)))
    maps = maps_of(recorded, tmp_path, response((0.5, 0.3)), petzval(), order="1")
    np.testing.assert_allclose(maps.layer("direct.depth"), truth_m, atol=2e-6)
    curved = maps_of(recorded, tmp_path / "curved", response((0.5, 0.3)), petzval(), order="1", curved=False)
    np.testing.assert_allclose(curved.layer("direct.depth"), (truth_m + curvature_m(POINT_PX)) % RANGE_M, atol=2e-6)


def test_the_response_part_removes_phase_and_gain_of_each_pixel_and_harmonic(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    phase, gain = rng.normal(0.0, 0.2, (2, *SHAPE)), rng.uniform(0.7, 1.3, (2, *SHAPE))
    near_m, far_m = ranges_m() * 0.3 + 0.2, ranges_m(1) * 0.4 + 3.0
    clean = volts((0.3, near_m), (0.1, far_m))
    turned = gain * np.exp(1j * phase) * (clean[:, 0] + 1j * clean[:, 1])
    recorded = np.stack([turned.real, turned.imag], axis=1)
    maps = maps_of(recorded, tmp_path, response((0.0, 0.0), phase=phase, gain=gain))
    np.testing.assert_allclose(maps.layer("direct.depth"), near_m, atol=2e-6)
    np.testing.assert_allclose(maps.layer("mpi.depth"), far_m, atol=2e-5)
    np.testing.assert_allclose(maps.layer("direct.amplitude"), 0.3 * AMPLITUDE_V, rtol=1e-5)
