"""A contract for every calibration: resolving removes the defects, the truth is recovered, and files are exact.

The captures have all defects at once. The truth comes from `tests.support.defects`, which knows no series and no phasor.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.calibration.parts import PART_KINDS, PartKind
from cadtof_cli.calibration.store import Calibration, digest_of, load_calibration, save_part
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Waveform
from cadtof_cli.errors import MetadataError, SettingsError
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.campaign import ALL_DEFECTS, CARD_M, calibrate, camera, card, record_campaign
from tests.support.campaign import wall as frames_of_wall
from tests.support.defects import DefectiveCamera, Defects

WAVEFORMS: tuple[Waveform, ...] = ("sine", "triangle")


@dataclass(frozen=True)
class Measured:
    """A camera with known defects, and the calibration that `cadtof calibrate` made from its captures."""

    camera: DefectiveCamera
    folder: Path
    calibration: Calibration


@pytest.fixture(scope="module", params=WAVEFORMS)
def measured(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Measured:
    folder = tmp_path_factory.mktemp(f"campaign_{request.param}")
    campaign = record_campaign(folder, camera(waveform=request.param))
    out = folder / "calibration"
    calibrate(campaign, out)
    calibration = load_calibration(out)
    lost = set(PART_KINDS).difference(calibration.digests)
    assert not lost, f"no step of `calibrate` in tests/support/campaign.py measures {', '.join(lost)}: add it there"
    return Measured(campaign.seen, out, calibration)


def volts_without_defects(measured: Measured, distance_m: float) -> NDArray[np.float64]:
    """Return one frame of a wall by a camera without defects, in V."""
    ideal = camera(Defects(), waveform=measured.camera.metadata.modulation.waveform)
    return (frames_of_wall(ideal, distance_m, count=1, seed=50)[0].astype(np.float64) - 8192.0) * 6.0e-5


def field_curvature_m(measured: Measured, coefficients_m: tuple[float, float] | None = None) -> NDArray[np.float64]:
    """Return Δ = k2 ρ² + k4 ρ⁴ in m, (Y, X), computed here apart from the package; by default, with the coefficients
    of the Petzval part."""
    petzval = measured.calibration.petzval
    assert petzval is not None
    k2, k4 = coefficients_m or (petzval.curvature.k2_m, petzval.curvature.k4_m)
    height, width = measured.camera.pixels
    y, x = np.mgrid[:height, :width]
    rho2 = ((x - (width - 1) / 2) ** 2 + (y - (height - 1) / 2) ** 2) / (0.25 * (height**2 + width**2))
    return np.asarray(k2 * rho2 + k4 * rho2**2)


def resolved(volts: NDArray[np.float64], measured: Measured, folder: Path | None, *, order: str = "auto") -> DepthMaps:
    """Return the maps of voltages as `cadtof resolve` makes them, with the parts in a folder, or without a calibration.

    The MPI model is discrete, so that each pixel is resolved alone. A diffuse tail follows from the whole frame, so a
    change of one pixel would move other pixels.
    """
    metadata = replace(measured.camera.metadata, voltage=CaptureMetadata().voltage)
    calibration = None if folder is None else load_calibration(folder)
    use = CalibrationUse(folder, calibration.digest) if folder and calibration else None
    settings = MapSettings(resolver=ResolverSettings(mpi_model="discrete", order=order))
    plan = FramePlan(metadata=metadata, settings=settings, calibration=use)
    return resolve_frame(volts, plan=plan, calibration=calibration).maps


def test_resolving_with_the_dark_part_removes_offsets(measured: Measured, tmp_path: Path) -> None:
    """Voltages with the offsets added, and removed by the part, resolve to the same values as without offsets.

    Only sigma, and the bits that depend on it, differ: the measured offsets have noise of their own.
    """
    dark = measured.calibration.dark
    assert dark is not None
    save_part(tmp_path, dark)
    volts = volts_without_defects(measured, 2.0)
    before = resolved(volts, measured, None, order="1")
    after = resolved(volts + dark.offset_v, measured, tmp_path, order="1")
    sound = np.uint32(~StatusBit.ILL_CONDITIONED)
    assert (after.status[~dark.hot] & sound == before.status[~dark.hot] & sound | StatusBit.CALIBRATED).all()
    assert (after.layer("direct.sigma")[~dark.hot] > before.layer("direct.sigma")[~dark.hot]).all()
    for name in ("direct.depth", "direct.amplitude", "confidence"):
        np.testing.assert_allclose(after.layer(name)[~dark.hot], before.layer(name)[~dark.hot], rtol=0, atol=2e-4)
    assert np.isnan(after.layer("direct.depth")[dark.hot]).all()


def test_resolving_with_the_petzval_part_removes_field_curvature(measured: Measured, tmp_path: Path) -> None:
    """The Petzval part alone takes k2 ρ² + k4 ρ⁴ from every range, and changes nothing else."""
    petzval = measured.calibration.petzval
    assert petzval is not None
    save_part(tmp_path, petzval)
    volts = volts_without_defects(measured, 2.0)
    before, after = resolved(volts, measured, None), resolved(volts, measured, tmp_path)
    shift = before.layer("direct.depth") - after.layer("direct.depth")
    np.testing.assert_allclose(shift, field_curvature_m(measured), rtol=0, atol=2e-6)
    assert np.ptp(shift) > 0.03
    np.testing.assert_allclose(after.layer("direct.amplitude"), before.layer("direct.amplitude"), rtol=0, atol=1e-7)


def recorded_v(
    calibration: Calibration, amplitudes: NDArray[np.float64], ranges_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return voltages of paths, (P, Y, X), by the parts: offset + A·gain·Σ_paths a·Σ_k G[h,k]·exp(ik(h·x + phase))."""
    dark, response = calibration.dark, calibration.response
    assert dark is not None
    assert response is not None
    x = ranges_m * 4.0 * np.pi / (0.299792458 * 40.0)
    planes = []
    for one, phase, gain in zip(response.responses, response.phase_rad, response.gain, strict=True):
        theta = one.harmonic * x + phase
        answer = 0.2746 * gain * sum((amplitudes * g * np.exp(1j * k * theta)).sum(axis=0) for k, g in one.terms)
        planes.append(np.stack([answer.real, answer.imag]))
    return np.stack(planes) + dark.offset_v


def test_voltages_with_every_defect_resolve_to_their_paths(measured: Measured) -> None:
    """Noiseless voltages, made from known paths with series, maps, offsets and curvature, resolve to these paths."""
    dark = measured.calibration.dark
    assert dark is not None
    rng = np.random.default_rng(2)
    shape = measured.camera.pixels
    near = rng.uniform(0.3, 1.9, shape)
    ranges = np.stack([near, near + rng.uniform(1.2, 2.8, shape)])
    amplitudes = np.stack([rng.uniform(0.15, 0.3, shape), rng.uniform(0.05, 0.14, shape)])
    volts = recorded_v(measured.calibration, amplitudes, ranges + field_curvature_m(measured))
    maps = resolved(volts, measured, measured.folder, order="2")
    sound = ~dark.hot
    for name, path in (("direct", 0), ("mpi", 1)):
        error = np.abs(maps.layer(f"{name}.depth") - ranges[path])[sound]
        if measured.camera.metadata.modulation.waveform == "sine":
            assert error.max() < 2e-5
        else:
            # the search ends well below the noise; for a few pairs of paths, another pair fits equally well
            assert np.mean(error < 0.1 * maps.layer(f"{name}.sigma")[sound]) >= 0.995
    assert np.isnan(maps.layer("direct.depth")[dark.hot]).all()


def test_dark_truth_is_recovered(measured: Measured) -> None:
    """Offsets of ± 20 mV are found: no pixel is off by more than chance allows, and errors scatter as predicted."""
    dark, drawn = measured.calibration.dark, measured.camera.drawn()
    assert dark is not None
    sound = ~(drawn.hot | drawn.noisy)
    error = (dark.offset_v - drawn.offset_v)[:, :, sound]
    scatter = error / dark.quality()["offset_stderr_v"]
    assert scatter.std() == pytest.approx(1.0, abs=0.2)
    assert np.abs(scatter).max() < 6.0
    assert abs(error.mean()) < 3.0 * dark.quality()["offset_stderr_v"] / np.sqrt(error.size) + 1e-6
    assert (dark.hot == ~sound).all()


def test_response_truth_is_recovered(measured: Measured) -> None:
    response, sensor, drawn = measured.calibration.response, measured.camera, measured.camera.drawn()
    assert response is not None
    sound = ~(drawn.hot | drawn.noisy)
    rad_per_m = 2.0 * np.pi / 40.0 * 2.0 / 0.299792458
    curved = rad_per_m * sensor.curvature_m()
    found_curved = rad_per_m * field_curvature_m(measured, (response.curvature.k2_m, response.curvature.k4_m))
    for row, one in enumerate(response.responses):
        truth = drawn.phase_rad[row] + ALL_DEFECTS.phase_rad[row] + (row + 1) * curved
        found = response.phase_rad[row] + np.angle(one.main) + (row + 1) * found_curved
        error = np.angle(np.exp(1j * (found - truth)))[sound]
        stderr = response.quality.phase_stderr_rad[row]
        assert error.std() < 1.3 * stderr
        assert abs(error.mean()) < 1e-3
    gain = response.gain[1] * abs(response.responses[1].main) / abs(response.responses[0].main)
    pulse = [np.exp(-((h * 2 * np.pi * 1.7 / 2.354820045 / 40.0) ** 2) / 2) for h in (1, 2)]
    expected = 0.8 * drawn.gain[1] * pulse[1] / pulse[0]
    assert np.median(gain[sound] / expected[sound]) == pytest.approx(1.0, abs=1e-3)


def test_imbalance_is_recovered(measured: Measured) -> None:
    """If SC2 is stronger by 5 %, G[h,−1]/conj(G[h,1]) = −.05/2.05 with any waveform."""
    response = measured.calibration.response
    assert response is not None
    for one, errors in zip(response.responses, response.quality.term_stderr, strict=True):
        ratio = one.mirror / np.conj(one.main)
        assert abs(ratio - (1 - 1.05) / (1 + 1.05)) < 4.0 * max(errors)


def test_petzval_truth_is_recovered(measured: Measured) -> None:
    petzval = measured.calibration.petzval
    assert petzval is not None
    assert abs(petzval.curvature.k2_m - 0.06) < 3.0 * petzval.curvature.k2_stderr_m
    assert abs(petzval.curvature.k4_m + 0.02) < 3.0 * petzval.curvature.k4_stderr_m
    for wall, tilt in zip(petzval.quality.walls, ((3.0, -2.0), (-2.0, 4.0)), strict=True):
        np.testing.assert_allclose(wall.slopes, np.tan(np.radians(tilt)), atol=2e-3)
    assert [wall.distance_m for wall in petzval.quality.walls] == pytest.approx([1.0, 3.0], abs=2e-3)


def test_all_parts_together_remove_the_bias_of_depth(measured: Measured) -> None:
    """On the two-path card with all defects, the median error of direct depth is below .2 cm, for triangles .5 cm."""
    sensor = measured.camera
    frame = card(sensor, count=1, seed=40)[0]
    use = CalibrationUse(measured.folder, measured.calibration.digest)
    plan = FramePlan(metadata=sensor.metadata, calibration=use)
    maps = resolve_frame(frame, plan=plan, calibration=measured.calibration).maps
    error = 100.0 * (maps.layer("direct.depth") - CARD_M)
    two = (maps.status & 16) > 0
    assert two.mean() > 0.7
    limit = 0.2 if sensor.metadata.modulation.waveform == "sine" else 0.5
    assert abs(np.median(error[two])) < limit
    assert abs(np.nanmedian(error[~two])) < limit
    assert ((maps.status & 64) > 0).all()
    raw = resolve_frame(frame, plan=replace(plan, calibration=None)).maps
    assert np.nanmedian(np.abs(100.0 * (raw.layer("direct.depth") - CARD_M))) > 1.0


@pytest.mark.parametrize("kind", PART_KINDS)
def test_save_and_load_is_exact(measured: Measured, kind: PartKind, tmp_path: Path) -> None:
    part = getattr(measured.calibration, kind)
    save_part(tmp_path / "copy", part)
    again = getattr(load_calibration(tmp_path / "copy"), kind)
    assert digest_of(again) == digest_of(part)
    assert again.tables() == part.tables()
    assert again.origin == part.origin
    for name, plane in part.maps().items():
        np.testing.assert_array_equal(again.maps()[name], plane)


@pytest.mark.parametrize("kind", PART_KINDS)
def test_captures_of_another_camera_are_refused(measured: Measured, kind: PartKind) -> None:
    part = getattr(measured.calibration, kind)
    calibration = Calibration(**{kind: part})
    metadata = measured.camera.metadata
    other: Waveform = "sine" if metadata.modulation.waveform == "triangle" else "triangle"
    calibration.require_match(metadata, measured.camera.pixels)
    for other_metadata, pixels, difference in (
        (metadata, (24, 32), "size is 32 × 24 pixels in the capture and 80 × 60 pixels"),
        (replace(metadata, modulation=Modulation(waveform=other)), None, f"waveform is {other} in the capture"),
        (
            replace(metadata, modulation=replace(metadata.modulation, periods_ns=(60.0, 30.0))),
            None,
            r"periods_ns is [60.0, 30.0] in the capture and [40.0, 20.0]",
        ),
    ):
        with pytest.raises(SettingsError, match=rf"the {kind} calibration does not belong.*{re.escape(difference)}"):
            calibration.require_match(other_metadata, pixels)


@pytest.mark.parametrize("kind", PART_KINDS)
def test_a_part_changed_by_hand_is_refused(measured: Measured, kind: PartKind, tmp_path: Path) -> None:
    save_part(tmp_path, getattr(measured.calibration, kind))
    path = tmp_path / f"{kind}.toml"
    text = path.read_text()
    path.write_text(re.sub(r"frames = \d+", "frames = 3", text))
    with pytest.raises(MetadataError, match=rf"{kind}\.toml: does not match its digest"):
        load_calibration(tmp_path)
    path.write_text(text.replace("[origin]", "[orgin]"))
    with pytest.raises(MetadataError, match=rf"{kind}\.toml: not a {kind} calibration: key 'origin' is missing"):
        load_calibration(tmp_path)
