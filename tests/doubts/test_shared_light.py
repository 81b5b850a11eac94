"""Light or an offset that all pixels of a frame share: fog, a dirty window, stray light of the lens, offsets that drifted."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli import simulate_scene
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pulse, Voltage
from cadtof_cli.doubts.frame import doubts_before_run
from cadtof_cli.doubts.shared_light import shared_in_words, shared_light, wrong_zero, wrong_zero_in_words
from cadtof_cli.phasors.voltages import ideal_phasor_map
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan
from cadtof_cli.units import C_M_PER_NS
from tests.support.run_cadtof import cadtof

AMPLITUDE_V, N_AV, SIZE = 0.2746, 1e5, (60, 80)
HARMONICS = [(1, 2), (1, 2, 3)]
C = NDArray[np.complex128]


def path(range_m: NDArray[np.float64] | float, h: int) -> C:
    """The phasor of light that comes back from a range, 40 ns."""
    return np.asarray(np.exp(4j * np.pi * h * np.asarray(range_m) / C_M_PER_NS / 40.0))


def yard() -> NDArray[np.float64]:
    """Ranges of a floor, a wall and two boxes, 1.2 to 3 m, (Y, X)."""
    row, column = np.indices(SIZE)
    range_m: NDArray[np.float64] = np.minimum(2.6 + 0.005 * column, 60.0 / (row + 1.0))
    range_m[20:50, 10:25] = 1.9
    range_m[30:55, 50:70] = 1.2
    return range_m


def phasors(
    harmonics: tuple[int, ...],
    shared: tuple[complex, ...],
    *,
    range_m: NDArray[np.float64],
    seed: int = 3,
    scatter: float = 0.5 / np.sqrt(N_AV),
) -> C:
    """Phasors, (H, n), of surfaces with an ASR of 2 and of what all pixels share, in units of the surfaces' light."""
    rng = np.random.default_rng(seed)
    found = []
    for h, part in zip(harmonics, shared, strict=True):
        light = (path(range_m, h) * np.clip(2.0 / range_m, 0.5, 1.5) + part) / 3.0
        found.append(light + scatter * (rng.normal(size=SIZE) + 1j * rng.normal(size=SIZE)))
    return np.array(found).reshape(len(harmonics), -1)


@pytest.mark.parametrize("harmonics", HARMONICS)
@pytest.mark.parametrize("share", [0.03, 0.1, 0.5])
@pytest.mark.parametrize("at_m", [0.02, 1.0])
def test_light_that_all_pixels_share_is_found(harmonics: tuple[int, ...], share: float, at_m: float) -> None:
    """As of a fogged window at 2 cm, or of a reflector whose light the lens scatters."""
    shared = tuple(complex(share * path(at_m, h)) for h in harmonics)
    found = shared_light(phasors(harmonics, shared, range_m=yard()), harmonics)
    assert found is not None
    np.testing.assert_allclose(found / found[0], np.array(shared) / shared[0], atol=0.25)
    assert 0.7 * share < abs(found[0]) < 1.4 * share


@pytest.mark.parametrize("harmonics", HARMONICS)
def test_an_offset_of_all_pixels_is_found(harmonics: tuple[int, ...]) -> None:
    assert shared_light(phasors(harmonics, (0.05 - 0.05j,) * len(harmonics), range_m=yard()), harmonics) is not None


def test_a_view_most_of_which_holds_0_v_has_no_wrong_zero() -> None:
    """As of a camera of few bits before the sky. Its misfits are 0, and were divided by."""
    light = phasors((1, 2), (0.0, 0.0), range_m=yard())
    light[:, : light.shape[1] * 2 // 3] = 0.0
    assert wrong_zero(light, np.full(light.shape, 1e-4 + 1e-4j), (1, 2)) is None


def test_motion_before_a_view_of_few_depths_is_no_light_that_pixels_share() -> None:
    """Each harmonic sees the surfaces a little farther away, as at 1 m/s. The same view behind a fogged window is told."""
    steps = 1.0 + 0.5 * (np.indices(SIZE)[0] // 15)
    moved = np.concatenate([phasors((h,), (0.0,), range_m=steps + 0.017 * h, seed=h, scatter=5e-4) for h in (1, 2)])
    assert shared_light(moved, (1, 2)) is None
    behind = tuple(complex(0.1 * path(0.02, h)) for h in (1, 2))
    assert shared_light(phasors((1, 2), behind, range_m=steps, scatter=5e-4), (1, 2)) is not None


@pytest.mark.parametrize("harmonics", HARMONICS)
def test_a_sound_frame_shares_nothing(harmonics: tuple[int, ...]) -> None:
    """Not even one with a second path 1 m behind every surface, or a flat wall with a pane."""
    nothing = (0.0,) * len(harmonics)
    assert shared_light(phasors(harmonics, nothing, range_m=yard()), harmonics) is None
    behind = phasors(harmonics, nothing, range_m=yard()) + 0.3 * phasors(
        harmonics, nothing, range_m=yard() + 1.0, seed=4
    )
    assert shared_light(behind, harmonics) is None
    pane = tuple(complex(0.3 * path(1.0, h)) for h in harmonics)
    wall = 2.0 + 0.001 * np.indices(SIZE)[1]
    assert shared_light(phasors(harmonics, pane, range_m=wall), harmonics) is None


def test_the_light_of_a_small_room_is_left_to_its_model() -> None:
    """It is nearly the same everywhere, later than the surfaces, and shorter at harmonic 2."""
    room = (0.3 * np.exp(3.6j), 0.2 * np.exp(7.2j))
    assert shared_light(phasors((1, 2), room, range_m=yard()), (1, 2)) is None


@pytest.mark.parametrize(("share", "told"), [(0.005, False), (0.02, True), (0.9, True)])
def test_what_moves_depths_by_millimetres_is_not_doubted(share: float, told: bool) -> None:
    shared = tuple(complex(share * path(0.02, h)) for h in (1, 2))
    found = shared_light(phasors((1, 2), shared, range_m=yard(), scatter=1e-5), (1, 2))
    assert (found is not None) == told


def test_pixels_without_sound_light_do_not_count() -> None:
    """A quarter of the pixels is black or holds no numbers, and another quarter has two paths."""
    shared = tuple(complex(0.1 * path(0.02, h)) for h in (1, 2))
    lit = phasors((1, 2), shared, range_m=yard(), scatter=1e-4)
    rng = np.random.default_rng(8)
    black = 0.05 * (rng.normal(size=(2, 800)) + 1j * rng.normal(size=(2, 800)))
    void = np.array([[np.nan, np.inf, 1e200, 30.0]] * 2).repeat(100, axis=1)
    others = 0.2 * np.array([path(rng.uniform(1.0, 5.0, 1200), h) for h in (1, 2)])
    mixed = np.concatenate([lit, black, void], axis=1)
    mixed[:, :1200] += others
    found, alone = shared_light(mixed, (1, 2)), shared_light(lit, (1, 2))
    assert found is not None
    assert alone is not None
    assert np.abs(found - alone).max() < 0.01


def _volts(shared: tuple[complex, ...]) -> NDArray[np.float64]:
    """Voltages, (2, 2, Y, X), of a pulse without a width."""
    lit = phasors((1, 2), shared, range_m=yard()).reshape(2, *SIZE)
    return AMPLITUDE_V * np.stack([lit.real, lit.imag], axis=1)


def _told(stored: NDArray[np.float64], metadata: CaptureMetadata) -> bool:
    return shared_in_words(stored, metadata, ideal_phasor_map(metadata, stored.dtype)) is not None


def test_saturated_pixels_do_not_count() -> None:
    metadata = CaptureMetadata(pulse=Pulse(fwhm_ns=0.0))
    volts = _volts((0.1, 0.1))
    volts[:, :, ::2] = 0.25
    assert not _told(volts, metadata)
    assert _told(volts, replace(metadata, voltage=Voltage(saturated_counts=(-0.25, 0.25))))


def test_triangle_waves_tell_nothing_and_no_response_with_further_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    metadata = CaptureMetadata(pulse=Pulse(fwhm_ns=0.0))
    volts = _volts((0.1, 0.1))
    assert _told(volts, metadata)
    assert not _told(volts, replace(metadata, modulation=Modulation(waveform="triangle")))
    monkeypatch.setattr(FramePlan, "read_calibration", lambda _: Calibration())
    use = CalibrationUse(Path("is not read"), "", sine=False)
    assert doubts_before_run(volts, FramePlan(metadata=metadata, calibration=use)) == ()


def test_resolve_tells_of_offsets_that_drift_after_the_calibration(tmp_path: Path) -> None:
    rng, noise = np.random.default_rng(5), 0.5 / np.sqrt(N_AV) * AMPLITUDE_V
    offsets = rng.normal(0.0, 2e-3, (2, 2, *SIZE))
    lit = phasors((1, 2), (0.0, 0.0), range_m=yard()).reshape(2, *SIZE)
    lit *= np.exp(-((2.0 * np.pi * np.array([1.0, 2.0]) * 1.7 / 2.3548 / 40.0) ** 2) / 2.0)[:, np.newaxis, np.newaxis]
    volts = AMPLITUDE_V * np.stack([lit.real, lit.imag], axis=1) + offsets
    frames = {
        "dark": [rng.normal(0.0, noise, offsets.shape) + offsets for _ in range(4)],
        "steady": [volts],
        "drifted": [volts + np.array([3e-3, -3e-3])[:, np.newaxis, np.newaxis]],
    }
    for name, stack in frames.items():
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "frames.npy", np.array(stack))
        (tmp_path / name / "capture.toml").write_text("[pixel]\nintegration_length = 1e5\n")
    camera = tmp_path / "camera"
    assert cadtof("calibrate", "dark", tmp_path / "dark", "-o", camera).status == 0
    told = {
        name: cadtof("resolve", tmp_path / name, "-o", tmp_path / f"{name}_maps", "--calibration", camera, "-j", 1).err
        for name in ("steady", "drifted")
    }
    assert "warning" not in told["steady"]
    assert f"warning: {tmp_path / 'drifted'}: all pixels share light or an offset (0.0" in told["drifted"]


@pytest.mark.parametrize("seed", [2, 3])
def test_in_a_view_of_one_depth_nothing_is_told(seed: int) -> None:
    modulation, size = {"periods_ns": (40.0, 20.0, 40.0 / 3.0)}, {"width": 160, "height": 120}
    card = simulate_scene("card", seed=seed, integration_length=10.0 ** (seed + 2), modulation=modulation, camera=size)
    frame = card.frames[0]
    phasor_map = ideal_phasor_map(frame.metadata, frame.stored.dtype)
    assert shared_in_words(frame.stored, frame.metadata, phasor_map) is None


@pytest.mark.parametrize("harmonics", HARMONICS)
@pytest.mark.parametrize("off_v", [0.058, -0.02])
def test_a_wrong_zero_is_found_in_views_of_one_depth(harmonics: tuple[int, ...], off_v: float) -> None:
    """A flat wall came out up to 3 m off with a sigma of millimetres, in silence: 58 mV are more than its own light."""
    wall = phasors(harmonics, (0.0,) * len(harmonics), range_m=np.full(SIZE, 3.0) + np.indices(SIZE)[1] * 2e-3)
    unit = np.full(wall.shape, (1.0 + 1.0j) / AMPLITUDE_V)
    found = wrong_zero(wall + off_v * unit, unit, harmonics)
    assert found == pytest.approx(off_v, abs=2e-4)
    assert wrong_zero(wall, unit, harmonics) is None


@pytest.mark.parametrize("off_v", [0.0054, -0.0054])
def test_a_wrong_zero_of_two_hundredths_of_the_amplitude_is_found(off_v: float) -> None:
    wall = phasors((1, 2), (0.0, 0.0), range_m=np.full(SIZE, 3.0) + np.indices(SIZE)[1] * 2e-3, scatter=1e-4)
    unit = np.full(wall.shape, (1.0 + 1.0j) / AMPLITUDE_V)
    assert wrong_zero(wall + off_v * unit, unit, (1, 2)) == pytest.approx(off_v, abs=2e-4)


@pytest.mark.parametrize("frames", [{}, {"distance_m": 1.0, "mpi_ratios": (0.5, 0.9), "separations_ns": (6.0, 9.0)}])
def test_strong_mpi_in_a_view_of_one_depth_is_no_wrong_zero(frames: dict[str, Any]) -> None:
    frame = simulate_scene("card", camera={"width": 80, "height": 60}, **frames).frames[0]
    phasor_map = ideal_phasor_map(frame.metadata, frame.stored.dtype)
    assert wrong_zero_in_words(frame.stored, frame.metadata, phasor_map) is None


def test_a_wrong_zero_is_told_with_the_right_one_for_later_frames_too(tmp_path: Path) -> None:
    """`info`, the warning of `resolve` before the first map and its note on the frame name the zero that fits."""
    assert cadtof("simulate", "--scene", "wall", "--width", 80, "--height", 60, "-o", tmp_path / "wall").status == 0
    settings = tmp_path / "wall" / "capture.toml"
    settings.write_text(settings.read_text().replace("zero_counts = 8192.0", "zero_counts = 7500.0"))
    told = "0 V is probably 819"
    info = cadtof("info", tmp_path / "wall", "--jobs", 1)
    assert (info.status, told in info.err) == (1, True)
    done = cadtof("resolve", tmp_path / "wall", "-o", tmp_path / "maps", "--jobs", 1)
    assert f"warning: {tmp_path / 'wall'}: all stored values seem to be +69" in done.err
    assert f"{tmp_path / 'maps'}: 1 more map: correct zero_counts, " in done.err
    assert told in json.loads((tmp_path / "maps" / "frames.jsonl").read_text())["reason"]


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.float64])
@pytest.mark.parametrize("off", [-600, 400])
def test_the_zero_that_fits_is_told_in_stored_values(dtype: type[np.generic], off: int) -> None:
    """With a step of 60 µV, in a view of several depths and in pixels that are not saturated."""
    zero = 8192 if dtype == np.uint16 else 100
    volts = _volts((0.0, 0.0))
    stored = np.rint(volts / 6e-5 + zero + off).astype(dtype)
    stored[:, :, ::3] = 12000
    voltage = Voltage(zero_counts=zero, volts_per_count=6e-5, saturated_counts=(-12000.0, 12000.0))
    metadata = CaptureMetadata(pulse=Pulse(fwhm_ns=0.0), voltage=voltage)
    told = str(wrong_zero_in_words(stored, metadata, ideal_phasor_map(metadata, stored.dtype)))
    found, probable = told.split(" seem to be ")[1].split(" off, 0 V is probably ")
    assert float(found) == pytest.approx(off, abs=5.0)
    assert float(probable.split(" instead")[0]) == pytest.approx(zero + off, abs=5.0)
    assert f"instead of {zero}: correct zero_counts" in told
    right = replace(metadata, voltage=replace(voltage, zero_counts=float(zero + off)))
    assert wrong_zero_in_words(stored, right, ideal_phasor_map(right, stored.dtype)) is None


@pytest.mark.parametrize(("late", "is_told"), [(-0.3, True), (0.3, False), (2.3, False), (2.8, True)])
def test_light_that_comes_after_the_surfaces_is_left_to_mpi(late: float, is_told: bool) -> None:
    """A small room sends it back; before the surfaces, or long after them, none does."""
    surfaces = np.angle(path(yard(), 1) * np.clip(2.0 / yard(), 0.5, 1.5)).ravel()
    middle = float(np.angle(np.exp(1j * surfaces).mean()))
    shared = tuple(complex(0.2 * np.exp(1j * h * (middle + late))) for h in (1, 2))
    found = shared_light(phasors((1, 2), shared, range_m=yard(), scatter=1e-4), (1, 2))
    assert (found is not None) == is_told


@pytest.mark.parametrize(("share", "told"), [(0.8, True), (1.4, False)])
def test_more_light_than_that_of_the_surfaces_is_not_told(share: float, told: bool) -> None:
    shared = tuple(complex(share * path(0.02, h)) for h in (1, 2))
    found = shared_light(phasors((1, 2), shared, range_m=yard(), scatter=1e-5), (1, 2))
    assert (found is not None) == told


@pytest.mark.parametrize(("pixels", "is_told"), [(64, True), (63, False)])
def test_few_pixels_share_nothing(pixels: int, is_told: bool) -> None:
    """NaN, dark and too bright pixels do not count."""
    shared = tuple(complex(0.1 * path(0.02, h)) for h in (1, 2))
    lit = phasors((1, 2), shared, range_m=yard(), scatter=1e-5)[:, ::75][:, :64]
    others = np.array([[np.nan, 1e-3, 5.0]] * 2).repeat(10, axis=1)
    assert lit.shape[1] == 64
    mixed = np.concatenate([lit[:, :pixels], others], axis=1)
    assert (shared_light(mixed, (1, 2)) is not None) == is_told
    unit = np.full(lit.shape, 1.0 + 1.0j)
    off = lit[:, :pixels] - 0.1 * path(0.02, 1) / 3.0 + 0.05 * unit[:, :pixels]
    assert shared_light(mixed[:1], (1,)) is None
    assert wrong_zero(off[:1], unit[:1, :pixels], (1,)) is None


@pytest.mark.parametrize(("scatter", "is_told"), [(1e-3, True), (9e-3, False)])
def test_an_offset_of_about_the_noise_is_no_wrong_zero(scatter: float, is_told: bool) -> None:
    wall = phasors((1, 2), (0.0, 0.0), range_m=yard(), scatter=scatter)
    unit = np.full(wall.shape, (1.0 + 1.0j) / AMPLITUDE_V)
    assert (wrong_zero(wall + 5.4e-3 * unit, unit, (1, 2)) is not None) == is_told


def test_a_large_frame_is_not_judged_by_a_third_of_its_columns() -> None:
    """These are dead. Of 480 · 600 pixels, the others tell."""
    volts = _volts((0.1, 0.1)).repeat(8, axis=2).repeat(8, axis=3)[..., :600]
    metadata = CaptureMetadata(pulse=Pulse(fwhm_ns=0.0))
    assert _told(volts, metadata)
    volts[..., ::3] = np.nan
    assert _told(volts, metadata)


def test_light_without_noise_shares_nothing() -> None:
    """As of a simulated wall at 0 m: one path explains it to the last bit."""
    ones = np.ones((2, 100), np.complex128)
    assert shared_light(ones, (1, 2)) is None
    assert wrong_zero(ones, 1e-4 * (1.0 + 1.0j) * ones, (1, 2)) is None
