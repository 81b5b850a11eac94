"""Parts of a calibration: their origin, the maps that store them, and errors in a calibration folder."""

import hashlib
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.calibration.apply import CalibrationNoise, frame_correction
from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.parts import PART_KINDS, Origin, named_planes, stacked
from cadtof_cli.calibration.petzval import PetzvalCalibration, PetzvalQuality, WallFit
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.calibration.store import (
    Calibration,
    cached_calibration,
    current_calibration,
    digest_of,
    is_calibration_folder,
    load_calibration,
    save_part,
)
from cadtof_cli.capture.discovery import OUTPUT_FILES
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Optics, Voltage
from cadtof_cli.errors import MetadataError, OutputError, SettingsError
from cadtof_cli.files.layers import read_layers
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import HarmonicResponse
from tests.support.calibrations import curved, made_up_calibration, response_quality

SHAPE = (4, 6)


def origin(**changes: Any) -> Origin:
    settings: dict[str, Any] = {
        "captures": ("a", "b"),
        "frames": 3,
        "pixels": SHAPE,
        "periods_ns": (40.0, 20.0),
        "waveform": "sine",
        "created": "2026-01-01T00:00:00+00:00",
    }
    return Origin(**(settings | changes))


def dark(*, used: dict[str, str] | None = None, offset: float = 0.01) -> DarkCalibration:
    shape = (2, 2, *SHAPE)
    values = np.linspace(offset, 2 * offset, np.prod(shape), dtype=np.float32).reshape(shape)
    return DarkCalibration(origin(used=used or {}), values, 0.1 * values, np.zeros(SHAPE, np.uint32))


def petzval(used: dict[str, str] | None = None) -> PetzvalCalibration:
    walls = (
        WallFit(1.0, 0.001, True, (0.1, -0.2), 0.02, 0.003, 0.003, 20),
        WallFit(3.0, 0.0, False, (0.0, 0.3), 1, 2, 3, 4),
    )
    return PetzvalCalibration(
        origin(used=used or {}),
        curved(0.06, -0.02, (2.5, 1.5), k2_stderr_m=0.1, k4_stderr_m=0.2),
        PetzvalQuality(1, 2, 3, 0.5, 70, True, walls, ("a finding",)),
    )


@pytest.mark.parametrize(
    "changes", [{"frames": 0}, {"pixels": (0, 6)}, {"waveform": "square"}, {"periods_ns": ()}, {"pixels": (1, 2, 3)}]
)
def test_an_impossible_origin_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="found"):
        origin(**changes)


def test_a_folder_with_any_part_is_no_capture() -> None:
    unknown = {f"{kind}.toml" for kind in PART_KINDS} - OUTPUT_FILES
    assert not unknown, f"capture/discovery.py: OUTPUT_FILES needs {', '.join(unknown)}: --recursive skips calibrations"


def test_an_origin_of_one_frame_of_one_pixel_is_accepted() -> None:
    one = origin(frames=1, pixels=(1, 1), periods_ns=(40.0, 20.0, 10.0))
    assert one.harmonics == (1, 2, 4)


def test_planes_are_named_and_stacked_in_order() -> None:
    planes = np.arange(24.0).reshape(2, 2, 2, 3)
    assert list(named_planes("phase", planes[0], (1, 2))) == ["phase.H1", "phase.H2"]
    maps = named_planes("offset", planes, (1, 3), 2)
    assert list(maps) == ["offset.H1.SC1", "offset.H1.SC2", "offset.H3.SC1", "offset.H3.SC2"]
    np.testing.assert_array_equal(maps["offset.H3.SC1"], planes[1, 0])
    np.testing.assert_array_equal(stacked(dict(reversed(maps.items())), "offset", (1, 3), 2), planes.reshape(4, 2, 3))
    with pytest.raises(MetadataError, match=r"no map named b.H2, found b.H1"):
        stacked({"b.H1": planes[0, 0]}, "b", (1, 2))


def test_maps_of_a_part_cannot_be_changed() -> None:
    made_up = made_up_calibration(CaptureMetadata(), SHAPE, {"dark", "response"})
    dark, response = made_up.dark, made_up.response
    assert dark is not None
    assert response is not None
    for values in (dark.offset_v, dark.noise_v, dark.defects, response.phase_rad, response.gain):
        with pytest.raises(ValueError, match="read-only"):
            values[...] = 0


def test_maps_of_another_size_are_refused() -> None:
    good = np.zeros((2, 2, *SHAPE), np.float32)
    with pytest.raises(ValueError, match="offset_v: found shape"):
        DarkCalibration(origin(), good[:1], good, np.zeros(SHAPE, np.uint32))
    with pytest.raises(ValueError, match="noise_v: found shape"):
        DarkCalibration(origin(), good, good[:, :1], np.zeros(SHAPE, np.uint32))
    with pytest.raises(ValueError, match="defects: found shape"):
        DarkCalibration(origin(), good, good, np.zeros((4, 5), np.uint32))
    with pytest.raises(ValueError, match="expected finite numbers"):
        curved(float("nan"), 0.0, (1.0, 1.0))


@pytest.mark.parametrize("wrong", ["harmonics", "shape", "nan", "zero", "quality"])
def test_an_impossible_response_is_refused(wrong: str) -> None:
    responses = tuple(HarmonicResponse(h, ((1, 1.0 + 0j),)) for h in ((1, 2) if wrong != "harmonics" else (1, 3)))
    phase, gain = np.zeros((2, *SHAPE), np.float32), np.ones((2, *SHAPE), np.float32)
    if wrong == "shape":
        phase = phase[:1]
    elif wrong == "nan":
        phase[1, 2, 3] = np.nan
    elif wrong == "zero":
        gain[0, 0, 0] = 0.0
    quality = response_quality(2 - (wrong == "quality"))
    with pytest.raises(ValueError, match=r"found|gain"):
        ResponseCalibration(origin(), responses, phase, gain, curved(0.0, 0.0, (0.0, 0.0)), quality)


def test_a_part_measured_with_another_dark_part_is_stale() -> None:
    first, other = dark(), dark(offset=0.02)
    good = petzval({"dark": digest_of(first)})
    assert Calibration(dark=first, petzval=good).stale() == ()
    (message,) = Calibration(dark=other, petzval=good).stale()
    assert message.startswith("the petzval calibration was measured with another dark calibration: repeat")
    (message,) = Calibration(petzval=good).stale()
    assert message.startswith(
        "the petzval calibration was measured with a dark calibration, which is missing here: bring"
    )
    (message,) = Calibration(dark=first, petzval=petzval()).stale()
    assert message.startswith("the petzval calibration was measured without a dark calibration: repeat")


def test_a_dark_part_without_noise_is_stale() -> None:
    silent = replace(dark(), figures=dict.fromkeys(dark().quality(), 0.0))
    (message,) = Calibration(dark=silent).stale()
    assert message.startswith("the dark calibration holds no noise")


def test_dark_frames_with_another_zero_than_the_capture_are_doubted(tmp_path: Path) -> None:
    """The offsets were measured from another zero, so all voltages would be off by the difference."""
    save_part(tmp_path, replace(dark(), zero_v=8192 * 6e-5))
    kept = load_calibration(tmp_path)
    assert kept.dark is not None
    assert kept.dark.zero_v == 8192 * 6e-5

    def doubts(zero: float | None, scale: float | None) -> tuple[str, ...]:
        return kept.doubts(CaptureMetadata(voltage=Voltage(zero_counts=zero, volts_per_count=scale)))

    # the same zero, also in files whose counts are shifted to the left, or in volts; volts; a zero that a program has subtracted
    for zero, scale in ((8192.0, 6e-5), (32768.0, 1.5e-5), (8192 * 6e-5, None), (None, None), (0.0, 6e-5)):
        assert not doubts(zero, scale)
    (message,) = doubts(8230.0, 6e-5)
    assert "was 0.49152 V in the dark frames" in message
    assert "2.28 mV off" in message
    assert not Calibration(dark=dark()).doubts(CaptureMetadata(voltage=Voltage(zero_counts=8230.0)))
    kept = Calibration(petzval=petzval())
    assert not doubts(8230.0, 6e-5)


def test_a_capture_with_another_focal_length_than_the_petzval_walls_is_doubted() -> None:
    """Field curvature is measured as what no flat wall explains, and the focal length decides how a flat wall looks."""
    walls_px = petzval().quality.focal_length_px

    def doubts(focal_length_px: float | None) -> tuple[str, ...]:
        return Calibration(petzval=petzval()).doubts(CaptureMetadata(optics=Optics(focal_length_px=focal_length_px)))

    for same in (None, walls_px, 1.015 * walls_px):
        assert not doubts(same)
    (message,) = doubts(1.2 * walls_px)
    assert f"{1.2 * walls_px:.6g} in the capture and {walls_px:.6g} in the petzval" in message
    assert not Calibration(dark=dark()).doubts(CaptureMetadata(optics=Optics(focal_length_px=1.2 * walls_px)))


def test_figures_are_read_as_written_and_a_change_of_the_file_is_refused(tmp_path: Path) -> None:
    """Figures are read from the file and not computed again, because the version that made them may have computed them
    differently.
    """
    part = replace(dark(), figures={"noise_v": 1.25e-3, "offset_mean_v": 0.01})
    save_part(tmp_path, part)
    found = load_calibration(tmp_path).dark
    assert found is not None
    assert found.quality() == part.figures
    text = (tmp_path / "dark.toml").read_text()
    assert "# its maps are in dark.exr\n" in text
    (tmp_path / "dark.toml").write_text(text.replace("0.00125", "0.00126"))
    with pytest.raises(MetadataError, match="does not match its digest"):
        load_calibration(tmp_path)


@pytest.mark.parametrize("key", ["k6_m", "coefficients.k6_m", "part.note", "lens.k6_m"])
def test_an_unknown_key_is_refused(tmp_path: Path, key: str) -> None:
    """Its value would have no effect, and the digest does not contain it."""
    save_part(tmp_path, petzval())
    table, _, name = key.rpartition(".")
    text, head = (tmp_path / "petzval.toml").read_text(), f"[{table}]\n"
    if not table:
        changed = f"{name} = 1\n{text}"
    elif head in text:
        changed = text.replace(head, f"{head}{name} = 1\n")
    else:
        changed = f"{text}\n{head}{name} = 1\n"
    (tmp_path / "petzval.toml").write_text(changed)
    with pytest.raises(MetadataError, match=f"has the unknown key {'lens' if table == 'lens' else key}, which"):
        load_calibration(tmp_path)


def test_the_digest_changes_with_every_change_of_a_part(tmp_path: Path) -> None:
    assert digest_of(dark()) == digest_of(dark())
    assert digest_of(dark()) != digest_of(dark(offset=0.0100001))
    assert digest_of(dark()) != digest_of(dark(used={"x": "y"}))
    assert len(digest_of(dark())) == 16
    assert Calibration(dark=dark()).digest != Calibration(petzval=petzval()).digest
    assert len(Calibration(dark=dark()).digest) == 16
    save_part(tmp_path, dark())
    save_part(tmp_path, petzval())
    found = load_calibration(tmp_path)
    assert found.digests == {"dark": digest_of(dark()), "petzval": digest_of(petzval())}
    assert found.petzval is not None
    assert found.petzval.quality == petzval().quality
    assert cached_calibration(tmp_path, found.digest).digest == found.digest
    with pytest.raises(
        MetadataError, match=f"another calibration .digest {found.digest}. than when the run began .digest {'0' * 16}"
    ):
        cached_calibration(tmp_path, "0" * 16)


def test_a_calibration_is_read_again_only_when_its_files_have_changed(tmp_path: Path) -> None:
    save_part(tmp_path, dark())
    first = current_calibration(tmp_path)
    assert current_calibration(tmp_path) is first
    assert cached_calibration(tmp_path, first.digest) is first
    save_part(tmp_path, petzval())
    assert current_calibration(tmp_path).petzval is not None


def test_the_digest_can_be_computed_from_the_files(tmp_path: Path) -> None:
    """The digest is over the TOML file as sorted JSON, without the digest itself, and then all planes sorted by name.

    A digest that an earlier version made thus stays valid.
    """
    save_part(tmp_path, dark())
    document = tomllib.loads((tmp_path / "dark.toml").read_text())
    recorded = document["part"].pop("digest")
    digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode())
    for name, plane in sorted(read_layers(tmp_path / "dark.exr").items()):
        digest.update(name.encode() + plane.tobytes())
    assert recorded == digest.hexdigest()[:16]


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("frames = 3", "frames = 0", "not a dark calibration: found 0 frames of"),
        ("frames = 3", "", "not a dark calibration: key 'frames' is missing"),
        ("pixels = [", "pixels = 7 # [", "a key is unknown, or its value is of another kind"),
    ],
)
def test_the_message_tells_what_is_wrong_with_a_part(before: str, after: str, message: str, tmp_path: Path) -> None:
    save_part(tmp_path, dark())
    text = (tmp_path / "dark.toml").read_text()
    assert before in text
    (tmp_path / "dark.toml").write_text(text.replace(before, after))
    with pytest.raises(MetadataError, match=re.escape(message)):
        load_calibration(tmp_path)


def test_a_folder_with_a_part_is_that_of_a_calibration(tmp_path: Path) -> None:
    assert not is_calibration_folder(tmp_path)
    assert not is_calibration_folder(tmp_path / "nothing")
    save_part(tmp_path, petzval())
    assert is_calibration_folder(tmp_path)


def test_maps_that_are_cut_off_cannot_be_read(tmp_path: Path) -> None:
    _, maps = sorted(save_part(tmp_path, dark()), key=lambda path: path.suffix == ".exr")
    maps.write_bytes(maps.read_bytes()[:200])
    with pytest.raises(MetadataError, match=r"^[^:]*dark\.exr: damaged EXR: "):
        load_calibration(tmp_path)


def test_the_message_about_a_folder_without_a_calibration_tells_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(MetadataError, match="nowhere: no such folder; expected one that `cadtof calibrate"):
        load_calibration(tmp_path / "nowhere")
    with pytest.raises(
        MetadataError, match=r"no calibration in it; expected dark\.toml, response\.toml, petzval\.toml, or some"
    ):
        load_calibration(tmp_path)
    save_part(tmp_path, petzval())
    assert load_calibration(tmp_path).dark is None


def test_a_calibration_of_another_camera_corrects_no_frames() -> None:
    """`frame_correction` itself refuses it, so that no caller can forget to ask."""
    metadata = CaptureMetadata(voltage=Voltage(volts_per_count=1e-4, zero_counts=0.0))
    known = Calibration(dark=dark())
    assert frame_correction(known, metadata, np.dtype(np.uint16), SHAPE).phasor_map.own.shape == (2, 2, 24)
    with pytest.raises(SettingsError, match="the dark calibration does not belong"):
        frame_correction(known, metadata, np.dtype(np.uint16), (3, 8))
    triangle = replace(metadata, modulation=Modulation(waveform="triangle"))
    with pytest.raises(SettingsError, match="the dark calibration does not belong"):
        frame_correction(known, triangle, np.dtype(np.uint16), SHAPE)


def test_a_part_creates_its_folder_and_is_replaced_only_with_overwrite(tmp_path: Path) -> None:
    folder = tmp_path / "cameras" / "first"
    save_part(folder, petzval())
    other = replace(petzval(), curvature=curved(0.07, -0.02, (2.5, 1.5)))
    with pytest.raises(OutputError, match=r"petzval\.toml: already exists; add --overwrite"):
        save_part(folder, other)
    found = load_calibration(folder).petzval
    assert found is not None
    assert found.curvature.k2_m == 0.06
    save_part(folder, other, overwrite=True)
    found = load_calibration(folder).petzval
    assert found is not None
    assert found.curvature.k2_m == 0.07


@pytest.mark.parametrize(
    ("periods_ns", "matches"),
    [((40.0, 13.33), True), ((40.0, 13.333333), True), ((40.0, 20.0), False), ((41.0, 13.6666), False)],
)
def test_a_period_is_the_harmonic_that_it_rounds_to(periods_ns: tuple[float, ...], matches: bool) -> None:
    metadata, part = CaptureMetadata(modulation=Modulation(periods_ns=periods_ns)), origin(periods_ns=(40.0, 13.3333))
    if matches:
        part.require_match(metadata, SHAPE, kind="dark")
        return
    with pytest.raises(SettingsError, match="does not belong to this capture: periods_ns is"):
        part.require_match(metadata, SHAPE, kind="dark")


def test_the_standard_error_of_offsets_follows_from_the_noise_of_their_harmonic() -> None:
    frames = 9
    noise = np.ones((2, 2, *SHAPE), np.float32)
    noise[0], noise[1] = 3e-4, 1e-4
    known = DarkCalibration(origin(frames=frames), 0.0 * noise, noise, np.zeros(SHAPE, np.uint32))
    first, second = known.offset_stderr_v()
    assert first == pytest.approx(3.0 * second)
    assert np.sqrt(first * second) == pytest.approx(np.sqrt(3.0) * 1e-4 / 3.0, rel=0.3)
    single = DarkCalibration(origin(frames=1), noise, 0.0 * noise, np.zeros(SHAPE, np.uint32))
    assert single.offset_stderr_v() == (0.0, 0.0)


def test_a_response_measured_with_another_lamp_is_refused() -> None:
    """The lamp's way would be taken out twice, or not at all."""
    offset = (0.1, 0.0, 0.0)
    metadata = CaptureMetadata(optics=Optics(focal_length_px=70.0, lamp_offset_m=offset))
    made = made_up_calibration(CaptureMetadata(), SHAPE, ("dark", "response"))
    with pytest.raises(
        SettingsError, match=r"the response calibration does not belong .*lamp_offset_m is \[0.1, 0.0, 0.0\]"
    ):
        made.require_match(metadata, SHAPE)
    assert made.response is not None
    same = replace(made, response=replace(made.response, lamp_offset_m=offset))
    same.require_match(metadata, SHAPE)
    with pytest.raises(SettingsError, match=r"lamp_offset_m is \[0.0, 0.0, 0.0\] in the capture"):
        same.require_match(CaptureMetadata(), SHAPE)
    replace(same, response=None).require_match(CaptureMetadata(), SHAPE)


def test_a_response_keeps_field_curvature_and_lamp(tmp_path: Path) -> None:
    made = made_up_calibration(CaptureMetadata(), SHAPE, ("response",)).response
    assert made is not None
    save_part(tmp_path, replace(made, lamp_offset_m=(0.1, -0.02, 0.03)))
    found = load_calibration(tmp_path).response
    assert found is not None
    assert (found.curvature, found.lamp_offset_m) == (made.curvature, (0.1, -0.02, 0.03))


def test_a_calibration_names_its_parts_with_a_few_words_about_each() -> None:
    made_up = made_up_calibration(CaptureMetadata(), SHAPE, PART_KINDS)
    assert made_up.dark is not None
    assert made_up.response is not None
    defects = np.zeros(SHAPE, np.uint32)
    defects[1, 2:4] = 1
    every = replace(made_up, dark=replace(made_up.dark, defects=defects))
    whole = "dark (2 bad pixels), response (k = 1, -1), petzval (k2 = 0.0500 m, k4 = -0.0300 m)"
    assert every.summary == whole
    found = replace(every, petzval=None).summary
    assert found == "dark (2 bad pixels), response (k = 1, -1; with the field curvature it found)"
    terms = (*((k, 0.1 + 0j) for k in (-7, 5, 9, -3, -1, 0)), (1, 1.0 + 0j))
    for count, words in ((6, "k = 0, 1, -1, -3, 5, -7"), (7, "k = 0, 1, -1, -3, 5, -7 …")):
        kept = tuple(term for term in terms if count == 7 or term[0] != 9)
        assert replace(made_up.response, responses=tuple(HarmonicResponse(h, kept) for h in (1, 2))).summary == words


def test_the_field_curvature_of_a_part_is_that_of_its_pixels() -> None:
    """Δ = .06·ρ² − .02·ρ⁴ about the pixel (2.5, 1.5), the middle of 6 × 4 pixels; ρ is 1 at half their diagonal."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rho2 = ((x - 2.5) ** 2 + (y - 1.5) ** 2) / (0.25 * (SHAPE[0] ** 2 + SHAPE[1] ** 2))
    np.testing.assert_allclose(petzval().range_offset_m, 0.06 * rho2 - 0.02 * rho2**2)


def test_the_noise_of_a_calibration_is_added_to_that_of_a_recording() -> None:
    """The variance of dark frames is added, and that of targets times |p|²; a mean does not make them smaller."""
    noise = noise_model(CaptureMetadata(), integration_length=1e5, quantised=False)
    left = CalibrationNoise(dark=(1e-9, 2e-9), response=(4e-9, 8e-9))
    for power, frames in ((1.0, 1.0), (0.25, 4.0), (0.0, 2.0)):
        found = left.added_to(noise, powers=np.array([power, power]), frames=frames)
        for before, after, dark, share in zip(noise.each, found.each, left.dark, left.response, strict=True):
            assert after.floor - before.floor == pytest.approx(frames * (dark + max(power, 1e-6) * share), rel=0.1)
    halves = left.added_to(noise, powers=np.array([0.5, 0.5]), frames=1.0).each
    assert halves[0].floor - noise.each[0].floor == pytest.approx(1e-9 + 0.5 * 4e-9, rel=1e-6)


def test_a_correction_holds_what_each_part_says_of_the_pixels() -> None:
    metadata = CaptureMetadata()
    made = made_up_calibration(metadata, SHAPE, PART_KINDS)
    assert made.dark is not None
    assert made.response is not None
    defects = np.zeros(SHAPE, np.uint32)
    defects[1, 2] = 1
    dark = replace(made.dark, defects=defects)
    response = replace(made.response, quality=response_quality(2, phase_stderr_rad=3e-4))
    found = frame_correction(replace(made, dark=dark, response=response), metadata, np.dtype(np.float32), SHAPE)
    assert found.hot is not None
    assert found.noise is not None
    np.testing.assert_array_equal(np.flatnonzero(found.hot), [1 * SHAPE[1] + 2])
    np.testing.assert_array_equal(np.isnan(dark.sound_offset_v).all(axis=(0, 1)), defects == 1)
    np.testing.assert_array_equal(dark.sound_offset_v[:, :, 0], dark.offset_v[:, :, 0])
    amplitude_v = metadata.modulation.amplitude_v
    mains = [abs(one.main) for one in response.responses]
    errors = [volts / amplitude_v / main for volts, main in zip(dark.offset_stderr_v(), mains, strict=True)]
    assert found.noise.dark == pytest.approx([error**2 for error in errors])
    assert found.noise.response == pytest.approx([9e-8, 9e-8])
    without = frame_correction(Calibration(petzval=made.petzval), metadata, np.dtype(np.float32), SHAPE)
    assert (without.noise, without.hot, without.response) == (None, None, None)
    clean = replace(made, dark=replace(dark, defects=0 * defects))
    assert frame_correction(clean, metadata, np.dtype(np.float32), SHAPE).hot is None
