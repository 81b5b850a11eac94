"""The first phasor alone, with which the resolver is compared: it gets all that the resolver gets."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.petzval import PetzvalCalibration
from cadtof_cli.calibration.store import load_calibration, save_part
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.pipeline.first_phasor import first_phasor_depth
from cadtof_cli.pipeline.plan import FramePlan
from tests.support.calibrations import PETZVAL_QUALITY
from tests.support.captures import VOLTS_PER_COUNT, ZERO_COUNTS, record, write_exr, write_frame
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, T1_NS, Light, depth_m
from tests.support.run_cadtof import cadtof, program

SHAPE = (24, 32)
ORIGIN = Origin(captures=("made up",), frames=10, pixels=SHAPE, periods_ns=(40.0, 20.0), waveform="sine")


def _triangle_volts(delays_ns: NDArray[np.float64], fwhm_ns: float) -> NDArray[np.float64]:
    """Return what triangle modulation records of a path, without noise: (8/π²)·(m_1 + conj(m_3)/9 + m_5/25 + …)."""
    s = fwhm_ns / 2.354820045

    def moment(k: int) -> NDArray[np.complex128]:
        turn = 2 * np.pi * k / T1_NS
        return np.asarray(0.2 * np.exp(-((turn * s) ** 2) / 2) * np.exp(1j * turn * delays_ns))

    planes = []
    for h in (1, 2):
        terms = [moment(k * h) if k % 4 == 1 else np.conj(moment(k * h)) for k in range(1, 60, 2)]
        sum_ = np.sum([term / k**2 for term, k in zip(terms, range(1, 60, 2), strict=True)], axis=0)
        planes.append(np.stack([sum_.real, sum_.imag]) * 8 / np.pi**2)
    return AMPLITUDE_V * np.stack(planes)


def test_depths_are_right_if_triangle_modulation_is_known() -> None:
    """If a triangle is taken for a sine, the depth from the fundamental is up to 6 cm wrong for a single path."""
    delays = np.linspace(0.05, T1_NS - 0.05, 24 * 32).reshape(SHAPE)
    sine = CaptureMetadata(pixel=Pixel(integration_length=1e5))
    triangle = replace(sine, modulation=Modulation(waveform="triangle"))
    volts = _triangle_volts(delays, sine.pulse.fwhm_ns)
    truth = C_M_PER_NS * delays / 2
    errors = [first_phasor_depth(volts, plan=FramePlan(metadata=one)) - truth for one in (sine, triangle)]
    assert 0.04 < np.abs(errors[0]).max() < 0.08
    assert np.abs(errors[1]).max() < 1e-4


def _calibration(folder: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Write offsets of 30 mV, a hot pixel and field curvature; return the offsets and the curvature in m."""
    rng = np.random.default_rng(4)
    offset = (0.03 * rng.choice([-1.0, 1.0], (2, 2, *SHAPE))).astype(np.float32)
    defects = np.zeros(SHAPE, np.uint32)
    defects[3, 5] = 1
    save_part(folder, DarkCalibration(ORIGIN, offset, np.full_like(offset, 1e-4), defects))
    save_part(folder, PetzvalCalibration(ORIGIN, 0.4, 0.1, (15.0, 10.0), PETZVAL_QUALITY))
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rho2 = ((x - 15.0) ** 2 + (y - 10.0) ** 2) / (np.hypot(*SHAPE) / 2) ** 2
    return offset.astype(np.float64), 0.4 * rho2 + 0.1 * rho2**2


def test_the_first_phasor_gets_the_calibration_pixels_and_flags_of_the_resolver(tmp_path: Path) -> None:
    """Offsets, a curved field, and no MPI: with the calibration both methods are right, without it both are wrong."""
    capture = record(tmp_path / "capture")
    offset, curve = _calibration(tmp_path / "calibration")
    turn = 2 * np.pi / T1_NS * (10.0 + 2.0 * curve / C_M_PER_NS)
    pulse = [Light(asr=1.0, direct_ns=0.0).moment(h).real for h in (1, 2)]
    volts = np.stack([pulse[h - 1] * np.stack([np.cos(h * turn), np.sin(h * turn)]) for h in (1, 2)])
    volts = AMPLITUDE_V * (volts + np.random.default_rng(1).normal(scale=0.5 / np.sqrt(1e5), size=volts.shape))
    write_frame(capture.files[0], volts + offset)
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.full(SHAPE, depth_m(10.0), np.float32)})
    found = {}
    for name, more in (("with", ("--calibration", tmp_path / "calibration")), ("without", ())):
        out = tmp_path / name
        assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q", "--mpi-model", "discrete", *more).status == 0
        done = cadtof("evaluate", out, "--truth", tmp_path / "truth.exr", "--json")
        assert (done.status, done.err) == (0, "")
        found[name] = json.loads(done.out)
        assert found[name]["direct"]["valid"] == found[name]["first_phasor"]["valid"]
    assert found["with"]["direct"]["valid"] == (24 * 32 - 1) / (24 * 32)
    assert max(found["with"]["first_phasor"]["rmse_cm"], found["with"]["direct"]["rmse_cm"]) < 1.0
    assert min(found["without"]["first_phasor"]["rmse_cm"], found["without"]["direct"]["rmse_cm"]) > 20.0


def test_the_calibration_is_found_after_a_move_and_a_changed_one_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "place"
    record(place / "capture")
    _calibration(place / "calibration")
    write_exr(place / "truth.exr", {"direct.depth": np.full(SHAPE, 2.0, np.float32)})
    monkeypatch.chdir(place)
    options = ("-o", "out", "-j", 1, "-q", "--calibration", "calibration")
    assert cadtof("resolve", "capture", *options).status == 0
    monkeypatch.chdir(tmp_path)
    place.rename(tmp_path / "moved")
    arguments = ("evaluate", "moved/out", "--truth", "moved/truth.exr", "--json")
    done = cadtof(*arguments)
    assert (done.status, done.err) == (0, "")
    assert json.loads(done.out)["first_phasor"]["valid"] > 0.9
    (tmp_path / "moved" / "calibration" / "petzval.toml").unlink()
    # in a new process, because this one keeps the calibration that it has read
    done = program(*arguments)
    assert "so the first phasor is left out" in done.err
    assert (done.status, json.loads(done.out)["first_phasor"]) == (0, None)


@pytest.mark.parametrize("command", ["evaluate", "profile", "preview"])
def test_a_calibration_that_was_replaced_after_the_run_is_reported(command: str, tmp_path: Path) -> None:
    """The run has ended, so the message must not say that the calibration or the settings changed during it."""
    capture, calibration, out = record(tmp_path / "capture"), tmp_path / "calibration", tmp_path / "out"
    _calibration(calibration)
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q", "--calibration", calibration).status == 0
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.full(SHAPE, 2.0, np.float32)})
    save_part(calibration, PetzvalCalibration(ORIGIN, 0.3, 0.1, (15.0, 10.0), PETZVAL_QUALITY), overwrite=True)
    before = json.loads((out / "run.json").read_text())["calibration"]["digest"]
    now = load_calibration(calibration).digest
    more = {"profile": ("--row", 3), "preview": ("-o", tmp_path / "a.png")}.get(command, ())
    done = program(command, out, "--truth", tmp_path / "truth.exr", *more)
    assert done.status == 0
    assert done.err.strip() == (
        "the calibration of the run has changed or is gone, so the first phasor is left out: "
        f"{calibration}: holds another calibration (digest {now}) than when the run began (digest {before}); resolve again to"
        " apply it"
    )


def test_a_frame_that_was_replaced_after_the_run_is_reported(tmp_path: Path) -> None:
    """Another frame of the same size and type would give the first phasor of another scene."""
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.full(SHAPE, 2.0, np.float32)})
    shutil.copy(capture.files[0], capture.files[1])
    done = cadtof("evaluate", out, "--truth", tmp_path / "truth.exr", "--json")
    changed = out / f"frame_1{capture.files[1].suffix}"
    assert done.err == f"{changed}: its recorded frame has changed since the run, so the first phasor is left out\n"
    assert (done.status, json.loads(done.out)["first_phasor"]) == (0, None)
    # a copy with the same values is the same frame, whatever its time
    capture.files[1].unlink()
    record(tmp_path / "again", frames=2)
    shutil.copy(tmp_path / "again" / capture.files[1].name, capture.files[1])
    assert cadtof("evaluate", out, "--truth", tmp_path / "truth.exr", "--json").err == ""


@pytest.mark.parametrize("command", ["evaluate", "profile", "preview", "report"])
def test_settings_that_were_edited_after_the_run_are_reported(command: str, tmp_path: Path) -> None:
    """With another zero, the first phasor would be decimetres off, as if the resolver had removed that."""
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.full(SHAPE, 2.0, np.float32)})
    toml = capture.folder / "capture.toml"
    toml.write_text(toml.read_text().replace("8192.0", "7900.0"))
    more = {"profile": ("--row", 3), "preview": ("-o", tmp_path / "a.png"), "report": ("-o", tmp_path / "a.html")}
    done = cadtof(command, out, "--truth", tmp_path / "truth.exr", *more.get(command, ()))
    assert done.status == 0
    told = "voltage.zero_counts has changed from 8192.0 to 7900.0 since the run, so the first phasor is left out\n"
    assert done.err.count(f"{capture.folder}: {told}") == 1
    # an option of the run counts, too, and captures that were moved with the run are known by their settings
    toml.write_text(toml.read_text().replace("7900.0", "8192.0"))
    place = (tmp_path / "moved").resolve()
    place.mkdir()
    for folder in (capture.folder, out):
        folder.rename(place / folder.name)
    assert "first phasor" in cadtof("evaluate", place / "out", "--truth", tmp_path / "truth.exr").out


def test_the_first_phasor_of_averaged_frames_is_that_of_their_mean(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=5), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q", "--average", 2, "--frames", "1:5").status == 0
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.full(SHAPE, 2.0, np.float32)})
    done = cadtof("evaluate", out, "--truth", tmp_path / "truth.exr", "--json")
    assert done.err == ""
    errors = []
    for first in (1, 3):
        counts = np.mean([tifffile.imread(file).astype(float) for file in capture.files[first : first + 2]], axis=0)
        volts = VOLTS_PER_COUNT * (counts - ZERO_COUNTS)
        phase = np.arctan2(volts[1], volts[0]) % (2 * np.pi)
        errors.append(100 * (phase * C_M_PER_NS * T1_NS / (4 * np.pi) - 2.0))
    assert json.loads(done.out)["first_phasor"]["rmse_cm"] == pytest.approx(
        np.sqrt(np.mean(np.square(errors))), rel=1e-6
    )
