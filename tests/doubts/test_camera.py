"""Errors of a camera that a frame shows if no calibration takes them out."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Pulse, Voltage
from cadtof_cli.doubts.camera import other_offsets, stepped, striped, unequal_harmonics
from cadtof_cli.doubts.frame import camera_doubts
from cadtof_cli.doubts.other_noise import other_noise
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.phasors.voltages import pixel_phasor_map
from tests.support.boxes import AMPLITUDE_V, KNOWN, N_AV, SIZE, frame
from tests.support.captures import record
from tests.support.run_cadtof import cadtof


@pytest.mark.parametrize("asr", [0.3, 1.0, 5.0, 50.0])
@pytest.mark.parametrize("n_av", [1e3, 1e5, 1e6])
def test_a_camera_without_errors_raises_no_doubt(asr: float, n_av: float) -> None:
    known = replace(KNOWN, pixel=Pixel(integration_length=n_av))
    assert camera_doubts(frame(n_av=n_av, asr=asr), known) == ()
    assert camera_doubts(frame(n_av=n_av, asr=asr, mpi=0.3), known) == ()
    assert camera_doubts(frame(n_av=n_av, asr=asr), CaptureMetadata()) == ()


@pytest.mark.parametrize(("seen", "words"), [(1e4, " times too small"), (1e6, " times too large")])
def test_another_integration_length_is_doubted(seen: float, words: str) -> None:
    """A frame at night, of a tenth of the photons, and one of ten times as many."""
    (doubt,) = camera_doubts(frame(n_av=seen), KNOWN)
    assert words in doubt


def test_the_calibration_of_another_camera_and_mirrored_frames_are_told() -> None:
    """Thousands of neighbours show offsets of the size of the noise. Smaller ones do not matter."""
    rng = np.random.default_rng(3)
    for size in (0.0, 2e-4, 1e-3, 5e-3):
        offset_v = rng.normal(0.0, size, (2, 2, *SIZE))
        volts, known = frame() + offset_v, (offset_v + rng.normal(0.0, 1e-4, (2, 2, *SIZE))).astype(np.float32)
        assert other_offsets(volts, KNOWN, known, (1e-4, 1e-4)) is None
        for other in (volts[..., ::-1], volts[..., ::-1, ::-1], frame()):
            told = other_offsets(other, KNOWN, known, (1e-4, 1e-4))
            assert (told is not None) == (size >= 1e-3)
        assert other_offsets(volts, KNOWN, known[..., ::-1], (0.0, 0.0)) is None


def test_offsets_that_saturation_steps_or_errors_hide_are_no_other_offsets() -> None:
    """Saturated neighbours do not differ, most differences below a step are rounded to 0, and of differences as small as
    their errors, those that look large are not."""
    rng = np.random.default_rng(3)
    shape = (2, 2, *SIZE)
    offset_v, error_v = rng.normal(0.0, 5e-3, shape), rng.normal(0.0, 1e-4, shape)
    least, most = np.quantile(frame(), (0.4, 0.6))
    clipped = np.clip(frame() + offset_v, least, most)
    limits = replace(KNOWN, voltage=Voltage(saturated_counts=(least, most)))
    assert other_offsets(clipped, limits, (offset_v + error_v).astype(np.float32), (1e-4, 1e-4)) is None
    steps = replace(KNOWN, voltage=Voltage(zero_counts=100.0, volts_per_count=8e-3))
    counts = np.rint((frame() + 0.3 * offset_v) / 8e-3 + 100.0).astype(np.uint8)
    assert other_offsets(counts, steps, (0.3 * offset_v + error_v).astype(np.float32), (1e-4, 1e-4)) is None
    slope_v = np.broadcast_to(2e-3 * np.arange(SIZE[0])[:, np.newaxis], shape)
    measured = (slope_v + 10.0 * error_v).astype(np.float32)
    assert other_offsets(frame() + slope_v, KNOWN, measured, (1e-3, 1e-3)) is None


def test_other_offsets_of_a_small_sensor_are_told() -> None:
    rng = np.random.default_rng(3)
    told = []
    for seed in range(20):
        offset_v = rng.normal(0.0, 2e-3, (2, 2, 16, 12))
        seen = frame(size=(16, 12), seed=seed) + offset_v
        assert other_offsets(seen, KNOWN, offset_v.astype(np.float32), (1e-4, 1e-4)) is None
        told.append(other_offsets(seen[..., ::-1], KNOWN, offset_v.astype(np.float32), (1e-4, 1e-4)) is not None)
    assert np.mean(told) > 0.8


def test_another_integration_length_is_doubted_behind_a_calibration() -> None:
    """Offsets of 5 mV are 12 times the noise; with them taken out, the noise shows."""
    offset_v = np.random.default_rng(3).normal(0.0, 5e-3, (2, 2, *SIZE))
    for seen, words in ((1e4, " times too small"), (1e5, None), (1e6, " times too large")):
        volts = frame(n_av=seen) + offset_v
        calibrated = pixel_phasor_map(
            ideal_response(KNOWN),
            KNOWN,
            volts.dtype,
            offset_v=offset_v.reshape(2, 2, -1),
            phase_rad=None,
            gain=None,
            pixels=SIZE[0] * SIZE[1],
        )
        told = other_noise(volts, KNOWN, calibrated)
        assert words in told if told and words else told is words
        assert " times too small" in str(other_noise(volts, KNOWN))


def fence(*, stripes: bool) -> NDArray[np.float64]:
    """Return volts, (H, 2, Y, X), of wires of one or two pixels along both diagonals, or of upright bars, before a wall."""
    row, column = np.indices(SIZE)
    wire = (column * 7 % 16 < 6) if stripes else ((row + column) % 6 == 0) | ((row - column) % 6 == 0)
    phase, light = np.where(wire, 0.6, 1.8), np.where(wire, 1.0, 0.7) / 6.0
    phasors = light * np.exp(1j * np.array([1, 2])[:, None, None] * phase)
    pulse = np.exp(-((np.array([1, 2]) * 2.0 * np.pi * 1.7 / 2.3548 / 40.0) ** 2) / 2.0)[:, None, None, None]
    noise = np.random.default_rng(1).normal(0.0, 0.5 / np.sqrt(N_AV), (2, 2, *SIZE))
    return np.asarray(AMPLITUDE_V * (pulse * np.stack([phasors.real, phasors.imag], axis=1) + noise))


@pytest.mark.parametrize("stripes", [False, True])
def test_fine_patterns_of_a_scene_are_no_errors_of_the_camera(stripes: bool) -> None:
    """Depth and brightness change all planes together, errors do not. The further terms of a triangle hide that."""
    volts, errors = fence(stripes=stripes), np.random.default_rng(2).normal(0.0, 2e-3, (2, 2, *SIZE))
    assert camera_doubts(volts, KNOWN) == ()
    of_columns = camera_doubts(volts + errors[:, :, :1], KNOWN)
    assert any(doubt.startswith("columns have offsets") for doubt in of_columns) or not stripes
    assert any(" times too small" in doubt for doubt in camera_doubts(volts + 3.0 * errors, KNOWN))
    (doubt,) = camera_doubts(volts, replace(KNOWN, modulation=Modulation(waveform="triangle")))
    also = "scene of fine stripes, such as a fence" if stripes else "view of fine mesh, such as a fence"
    assert f"Only a {also}, looks like that, too" in doubt


def test_lines_are_doubted_where_too_few_pixels_tell_a_scene_of_stripes() -> None:
    volts = frame() + np.random.default_rng(2).normal(0.0, 2e-3, (2, 2, 1, SIZE[1]))
    volts[:, :, ::2] = np.nan
    assert "columns have offsets" in str(striped(volts, KNOWN, "columns"))


def test_an_offset_that_all_pixels_share_is_doubted_of_a_sine() -> None:
    """The further terms of a triangle look the same, so nothing is said of it."""
    offset = 0.01 * AMPLITUDE_V * np.ones((2, 2, 1, 1))
    (doubt,) = camera_doubts(frame() + offset, KNOWN)
    assert doubt.startswith("all pixels share light or an offset (0.08")
    assert camera_doubts(frame() + offset, replace(KNOWN, modulation=Modulation(waveform="triangle"))) == ()


def test_pixels_without_a_first_harmonic_do_not_hide_the_noise_of_the_others() -> None:
    volts = frame(n_av=1e4)
    volts[0, :, :, 30:] = np.nan
    (doubt,) = camera_doubts(volts, KNOWN)
    assert " times too small" in doubt


def test_texture_that_scatters_three_times_as_much_as_noise_is_not_doubted() -> None:
    assert camera_doubts(frame(n_av=N_AV / 5.0), KNOWN) == ()


def test_noise_that_rounding_hides_is_not_judged() -> None:
    counts = np.rint(frame() / 2e-3 + 100.0).astype(np.uint8)
    assert camera_doubts(counts, replace(KNOWN, voltage=Voltage(zero_counts=100.0, volts_per_count=2e-3))) == ()


@pytest.mark.parametrize("known", [KNOWN, CaptureMetadata()])
@pytest.mark.parametrize("lines", ["rows", "columns"])
def test_offsets_of_rows_or_columns_are_doubted(lines: str, known: CaptureMetadata) -> None:
    shape = (2, 2, SIZE[0], 1) if lines == "rows" else (2, 2, 1, SIZE[1])
    offsets = np.random.default_rng(2).normal(0.0, 2e-3, shape)
    (doubt,) = camera_doubts(frame() + offsets, known)
    assert doubt.startswith(f"{lines} have offsets of their own, ")
    assert 1.5 < float(doubt.split(", ")[1].split(" mV")[0]) < 3.0
    assert camera_doubts(frame() + 0.05 * offsets, known) == ()


def test_offsets_of_rows_are_not_told_again_as_a_step_between_the_halves() -> None:
    offsets = np.random.default_rng(1).normal(0.0, 2e-3, (SIZE[0], 1))
    assert stepped(frame() + offsets, KNOWN) is not None
    (doubt,) = camera_doubts(frame() + offsets, KNOWN)
    assert doubt.startswith("rows have offsets of their own, ")


def test_posts_and_shelves_are_no_offsets() -> None:
    """Every eighth column and row shows a nearer surface, over the whole frame."""
    volts = frame(asr=1.0)
    volts[:, :, :, ::8] *= -0.5
    volts[:, :, ::8] *= -0.5
    assert striped(volts, KNOWN, "rows") is None
    assert striped(volts, KNOWN, "columns") is None


def test_ripples_of_a_surface_are_no_offsets() -> None:
    """With little ambient light they exceed the noise. They are two thousandths of the light."""
    rng = np.random.default_rng(3)
    volts = 0.2 * rng.normal(1.0, 2e-3, (1, 1, 1, SIZE[1])) * np.array([[0.8, 0.6], [0.3, 0.9]])[..., None, None]
    volts = volts + rng.normal(0.0, 1e-4, (2, 2, *SIZE))
    assert striped(volts, KNOWN, "columns") is None
    assert striped(volts + rng.normal(0.0, 2e-3, (2, 2, 1, SIZE[1])), KNOWN, "columns") is not None


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.2])
@pytest.mark.parametrize("harmonic", [2, 3])
def test_a_harmonic_of_another_amplitude_at_all_depths_is_doubted(harmonic: int, factor: float) -> None:
    """A third harmonic that is a tenth weaker than the others moves depths by 24 cm."""
    volts = frame(second=factor, asr=2.0) if harmonic == 2 else frame(third=factor, asr=2.0)
    periods_ns = (40.0, 20.0, 40.0 / 3.0)[:harmonic]
    (doubt,) = camera_doubts(volts, CaptureMetadata(modulation=Modulation(periods_ns=periods_ns)))
    assert doubt.startswith(f"harmonic {harmonic} is ")
    assert abs(float(doubt.split(" is ")[1].split(" times")[0]) - factor) < 0.02
    assert "calibrate response" in doubt


@pytest.mark.parametrize("mpi", [0.0, 0.1, 0.3])
def test_three_equal_harmonics_are_not_doubted(mpi: float) -> None:
    known = replace(KNOWN, modulation=Modulation(periods_ns=(40.0, 20.0, 40.0 / 3.0)))
    assert camera_doubts(frame(third=1.0, mpi=mpi, asr=2.0), known) == ()


def test_a_pulse_that_is_longer_than_the_metadata_say_is_doubted() -> None:
    (doubt,) = camera_doubts(frame(fwhm_ns=6.0, asr=2.0), KNOWN)
    assert "correct fwhm_ns" in doubt


def test_a_triangle_wave_is_not_compared() -> None:
    known = CaptureMetadata(modulation=Modulation(waveform="triangle"))
    assert camera_doubts(frame(second=0.5, asr=2.0), known) == ()


@pytest.mark.parametrize("shape", [(1, 1), (1, 320), (320, 1), (2, 2), (3, 50), (64, 80)])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, 0.0])
def test_frames_of_few_pixels_or_without_sound_ones_raise_no_doubt(shape: tuple[int, int], value: float) -> None:
    assert camera_doubts(np.full((2, 2, *shape), value), CaptureMetadata()) == ()
    assert camera_doubts(np.full((2, 2, *shape), value), KNOWN) == ()


def test_resolve_tells_unless_one_path_is_asked_for(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    text = (capture.folder / "capture.toml").read_text()
    (capture.folder / "capture.toml").write_text(
        text.replace("integration_length = 100000\n", "integration_length = 1e7\n")
    )
    told = cadtof("resolve", capture.folder, "-o", tmp_path / "maps", "-j", 1).err
    assert f"warning: {capture.folder}: neighbouring pixels scatter as with integration_length = " in told
    assert (
        "neighbouring pixels"
        not in cadtof("resolve", capture.folder, "-o", tmp_path / "one", "--order", 1, "-j", 1).err
    )


def test_resolve_does_not_tell_what_a_calibration_takes_out(tmp_path: Path) -> None:
    """The pixels and the columns have offsets of their own."""
    rng = np.random.default_rng(5)
    offsets = rng.normal(0.0, 2e-3, (2, 2, *SIZE)) + rng.normal(0.0, 2e-3, (2, 2, 1, SIZE[1]))
    for name, stack in (
        ("dark", [rng.normal(0.0, 0.5 / np.sqrt(N_AV) * AMPLITUDE_V, offsets.shape) for _ in range(4)]),
        ("lit", [frame()]),
    ):
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "frames.npy", np.array(stack) + offsets)
        (tmp_path / name / "capture.toml").write_text("[pixel]\nintegration_length = 1e5\n")
    camera = tmp_path / "camera"
    assert cadtof("calibrate", "dark", tmp_path / "dark", "-o", camera).status == 0
    raw = cadtof("resolve", tmp_path / "lit", "-o", tmp_path / "raw", "-j", 1).err
    assert "neighbouring pixels scatter as with" in raw
    assert "run calibrate dark" in raw
    calibrated = cadtof("resolve", tmp_path / "lit", "-o", tmp_path / "maps", "--calibration", camera, "-j", 1).err
    assert "warning" not in calibrated


def test_errors_are_doubted_in_a_frame_as_large_as_cameras_record() -> None:
    """Only some of its pixels are looked at; they must be enough to tell."""
    size = (480, 640)
    volts, offsets = frame(size=size, asr=2.0), np.random.default_rng(2).normal(0.0, 2e-3, (1, 640))
    assert camera_doubts(volts, KNOWN) == ()
    errors = {
        " times too small": frame(size=size, n_av=1e4),
        "rows have offsets of their own": volts + offsets[:, :480].T,
        "columns have offsets of their own": volts + offsets,
        "harmonic 2 is ": frame(size=size, second=0.8, asr=2.0),
    }
    for words, found in errors.items():
        (doubt,) = camera_doubts(found, KNOWN)
        assert words in doubt


@pytest.mark.parametrize("phase", [0.0, 2.0, 4.0])
def test_a_harmonic_is_not_compared_in_a_view_of_one_depth(phase: float) -> None:
    """MPI may be the same in all pixels of a wall, and makes a harmonic weaker, too."""
    phases = phase + np.random.default_rng(1).normal(0.0, 0.1, SIZE)
    spread = phase + np.random.default_rng(1).uniform(0.0, 3.0, SIZE)
    for seen, is_told in ((phases, False), (spread, True)):
        phasors = np.array([0.3, 0.24])[:, None, None] * np.exp(1j * np.array([1, 2])[:, None, None] * seen)
        volts = AMPLITUDE_V * np.stack([phasors.real, phasors.imag], axis=1)
        told = unequal_harmonics(volts, CaptureMetadata(pulse=Pulse(fwhm_ns=0.0)))
        assert (told is not None) == is_told


@pytest.mark.parametrize(("size", "is_told"), [((8, 16), True), ((7, 18), False)])
def test_harmonics_are_compared_from_64_bright_pixels(size: tuple[int, int], is_told: bool) -> None:
    """Half of the pixels are brighter than the median."""
    assert (unequal_harmonics(frame(size=size, second=0.8, asr=2.0), KNOWN) is not None) == is_told


@pytest.mark.parametrize(("size", "is_told"), [((8, 16), True), ((8, 15), False)])
def test_noise_is_judged_in_frames_of_few_pixels(size: tuple[int, int], is_told: bool) -> None:
    """All of their pixels are looked at, in pairs."""
    assert (other_noise(frame(size=size, n_av=1e3), KNOWN) is not None) == is_told


def test_a_large_frame_is_not_copied_to_find_errors_of_the_camera() -> None:
    """In few of its pixels they show as well, and a run waits for the answer."""
    volts = np.random.default_rng(1).normal(0.0, 1e-3, (2, 2, 480, 640)).astype(np.float32)
    large = volts.repeat(2, axis=3)
    tracemalloc.start()
    camera_doubts(large, KNOWN)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < large.nbytes / 2


@pytest.mark.parametrize(
    ("seen", "words"),
    [(N_AV / 11.0, " times too small"), (N_AV / 5.5, None), (3.0 * N_AV, None), (5.5 * N_AV, " times too large")],
)
@pytest.mark.parametrize("step_v", [None, 5e-5])
def test_the_noise_is_told_in_numbers_if_it_is_far_from_that_of_the_integration_length(
    seen: float, words: str | None, step_v: float | None
) -> None:
    """As volts, and in counts whose step is a ninth of the noise."""
    stored: NDArray[np.generic] = frame(n_av=seen, asr=50.0)
    known = KNOWN
    if step_v is not None:
        stored = np.rint(frame(n_av=seen, asr=50.0) / step_v + 20000.0).astype(np.uint16)
        known = replace(KNOWN, voltage=Voltage(zero_counts=20000.0, volts_per_count=step_v))
    told = other_noise(stored, known)
    assert (told is not None) == (words is not None)
    if told is not None and words is not None:
        before, after = told.split(words)[0].rsplit("about ", 1)
        assert float(before.split("integration_length = ")[1].split(" instead")[0]) == pytest.approx(seen, rel=0.25)
        assert float(after) == pytest.approx(max(seen / N_AV, N_AV / seen) ** 0.5, rel=0.12)


@pytest.mark.parametrize(("asr", "is_told"), [(0.1, False), (0.5, True)])
def test_the_noise_of_laser_light_alone_is_not_judged(asr: float, is_told: bool) -> None:
    """It is hardly any, and texture scatters more."""
    bright = frame(n_av=1e3, asr=asr)[:, :, 16:]
    assert (other_noise(bright, KNOWN) is not None) == is_told


@pytest.mark.parametrize(("factor", "is_told"), [(0.98, False), (0.96, True), (1.02, False), (1.04, True)])
def test_a_harmonic_is_doubted_if_depths_are_wrong_by_centimetres(factor: float, is_told: bool) -> None:
    told = unequal_harmonics(frame(second=factor, asr=2.0, n_av=1e7), KNOWN)
    assert (told is not None) == is_told


@pytest.mark.parametrize(
    ("count", "along", "is_told"), [(48, 40, True), (47, 40, False), (60, 24, True), (60, 23, False)]
)
def test_lines_are_compared_if_there_are_enough(count: int, along: int, is_told: bool) -> None:
    rng = np.random.default_rng(1)
    volts = rng.normal(0.0, 5e-4, (2, 2, count, along)) + rng.normal(0.0, 5e-3, (2, 2, count, 1))
    known = replace(KNOWN, modulation=Modulation(waveform="triangle"))
    assert (striped(volts, known, "rows") is not None) == is_told
    assert (striped(volts.swapaxes(2, 3), known, "columns") is not None) == is_told


def test_errors_are_told_of_one_harmonic_too() -> None:
    """One path explains all light of it, so a scene cannot be told from errors."""
    known = replace(KNOWN, modulation=Modulation(periods_ns=(40.0,)))
    assert camera_doubts(frame()[:1], known) == ()
    assert " times too small" in str(other_noise(frame(n_av=1e4)[:1], known))
    offsets = np.random.default_rng(2).normal(0.0, 2e-3, (1, 2, SIZE[0], 1))
    (doubt,) = camera_doubts(frame()[:1] + offsets, known)
    assert doubt.startswith("rows have offsets of their own, ")
