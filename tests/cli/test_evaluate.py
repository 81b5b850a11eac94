"""`cadtof evaluate`: errors against truth, held against numbers computed here."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from tests.support.captures import VOLTS_PER_COUNT, ZERO_COUNTS, layers_of, record, write_exr, write_frame
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, T1_NS, Light, depth_m, step_frame, step_truth
from tests.support.run_cadtof import cadtof

KEYS = ["median_cm", "p90_cm", "rmse_cm", "bias_cm", "valid"]


def _truth(path: Path, *, known: NDArray[np.bool_] | None = None, height: int = 24) -> Path:
    truth = step_truth(height=height).astype(np.float32)
    if known is not None:
        truth[~known] = np.nan
    write_exr(path, {"direct.depth": truth})
    return path


def _expected(errors_cm: NDArray[Any], valid: float) -> dict[str, Any]:
    size = np.abs(errors_cm)
    return {
        # quantiles are taken of counts in bins of 10 µm
        "median_cm": pytest.approx(np.quantile(size, 0.5, method="inverted_cdf"), abs=0.00051),
        "p90_cm": pytest.approx(np.quantile(size, 0.9, method="inverted_cdf"), abs=0.00051),
        "rmse_cm": pytest.approx(np.sqrt(np.mean(size**2)), rel=1e-5),
        "bias_cm": pytest.approx(np.mean(errors_cm), rel=1e-4, abs=1e-6),
        "valid": pytest.approx(valid),
    }


def _first_phasor_m(file: Path) -> NDArray[Any]:
    volts = VOLTS_PER_COUNT * (tifffile.imread(file).astype(np.float64) - ZERO_COUNTS)
    phase = np.arctan2(volts[1], volts[0]) % (2 * np.pi)
    return np.asarray(phase * C_M_PER_NS * T1_NS / (4 * np.pi))


def test_errors_are_those_of_the_maps(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=3), tmp_path / "out"
    pages = tifffile.imread(capture.files[0])
    pages[:, 5, 6] = 16383
    tifffile.imwrite(capture.files[0], pages, photometric="minisblack", metadata=None)
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    known = np.random.default_rng(1).random((24, 32)) < 0.8
    known[5, 6] = True
    truth = _truth(tmp_path / "truth.exr", known=known)
    done = cadtof("evaluate", out, "--truth", truth, "--json")
    assert (done.status, done.err) == (0, "")
    found = json.loads(done.out)
    assert list(found) == ["frames", "direct", "first_phasor"]
    assert found["frames"] == 3
    assert list(found["direct"]) == list(found["first_phasor"]) == KEYS
    valid = (3 * known.sum() - 1) / (3 * known.sum())
    direct = [layers_of(out / f"frame_{index}.tif")["direct.depth"] for index in range(3)]
    first = [_first_phasor_m(file) for file in capture.files]
    first[0][5, 6] = np.nan
    for name, depths in (("direct", direct), ("first_phasor", first)):
        errors = 100 * (np.stack(depths).astype(np.float64) - step_truth().astype(np.float32))[:, known]
        assert found[name] == _expected(errors[np.isfinite(errors)], valid)
    assert found["direct"]["rmse_cm"] < 2
    assert found["first_phasor"]["rmse_cm"] > 10


def test_the_first_phasor_of_a_far_wall_lies_in_the_far_half_of_the_range(tmp_path: Path) -> None:
    """25 ns are 3.75 m, more than half of 6 m: the phase there is above π, not below 0."""
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    far = Light(asr=2.0, direct_ns=25.0).voltages(np.random.default_rng(1), 1e5, 24 * 32)
    write_frame(capture.files[0], AMPLITUDE_V * far.reshape(2, 2, 24, 32))
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.full((24, 32), depth_m(25.0), np.float32)})
    found = json.loads(cadtof("evaluate", out, "--truth", tmp_path / "truth.exr", "--json").out)
    assert found["first_phasor"]["rmse_cm"] < 1.0
    assert found["direct"]["rmse_cm"] < 1.0


def test_recordings_are_found_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The record of a run holds its inputs as they were typed, and where that was."""
    record(tmp_path / "place" / "capture")
    truth, elsewhere = _truth(tmp_path / "truth.exr"), tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(tmp_path / "place")
    assert cadtof("resolve", "capture", "-o", tmp_path / "out", "-j", 1).status == 0
    arguments = json.loads((tmp_path / "out" / "run.json").read_text())["arguments"]
    assert arguments["inputs"] == ["capture"]
    assert arguments["absolute_inputs"] == [str(tmp_path / "place" / "capture")]
    monkeypatch.chdir(elsewhere)
    done = cadtof("evaluate", tmp_path / "out", "--truth", truth, "--json")
    assert (done.status, done.err) == (0, "")
    assert json.loads(done.out)["first_phasor"]["valid"] == 1.0


def test_one_map_and_its_table(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    done = cadtof("evaluate", out / "frame_1.tif", "--truth", _truth(tmp_path / "truth.exr"))
    assert (done.status, done.err) == (0, "")
    title, first, direct = done.out.splitlines()
    assert "median" in title
    assert "1 frames" in title
    error = 100 * (_first_phasor_m(capture.files[1]) - step_truth())
    assert first.startswith("first phasor")
    assert float(first.split()[3]) == pytest.approx(np.quantile(np.abs(error), 0.9), abs=0.02)
    assert float(first.split()[5]) == pytest.approx(error.mean(), abs=0.01)
    assert direct.startswith("direct path")
    assert direct.split()[-1] == "100.0%"


def test_recordings_that_are_gone_cost_only_the_first_phasor(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    truth = _truth(tmp_path / "truth.exr")
    shutil.rmtree(capture.folder)
    done = cadtof("evaluate", out, "--truth", truth, "--json")
    assert "the recorded frames are not where they were, so the first phasor is not evaluated" in done.err
    assert (done.status, json.loads(done.out)["first_phasor"]) == (0, None)
    for content in ("{", "[]", '{"arguments": 3}', None):
        if content is None:
            (out / "run.json").unlink()
        else:
            (out / "run.json").write_text(content)
        done = cadtof("evaluate", out, "--truth", truth)
        assert (done.status, done.err) == (0, "no run.json beside the maps, so the first phasor is not evaluated\n")
        assert "direct path" in done.out


def test_maps_without_an_answer(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    write_frame(capture.files[0], np.zeros((2, 2, 24, 32)))
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    done = cadtof("evaluate", out, "--truth", _truth(tmp_path / "truth.exr"), "--json")
    assert done.status == 0
    assert json.loads(done.out)["direct"] == dict.fromkeys(KEYS[:-1]) | {"valid": 0.0}
    assert "–" in cadtof("evaluate", out, "--truth", tmp_path / "truth.exr").out


def test_what_cannot_be_compared(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    write_frame(capture.files[0], step_frame(np.random.default_rng(0)))
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "z", "-j", 1, "--depth", "z").status == 0
    truth, small = _truth(tmp_path / "truth.exr"), _truth(tmp_path / "small.exr", height=20)
    write_exr(tmp_path / "other.exr", {"Y": np.zeros((24, 32), np.float32)})
    (tmp_path / "empty").mkdir()
    for maps, against, told in (
        (out, small, f"{out / 'frame_0.tif'}: found 32 × 24 pixels, expected 32 × 20 as in {small}"),
        (out, tmp_path / "other.exr", f"{tmp_path / 'other.exr'}: found layers Y; expected direct.depth"),
        (out, tmp_path / "gone.exr", f"{tmp_path / 'gone.exr'}: cannot be read: No such file or directory"),
        (tmp_path / "gone", truth, f"{tmp_path / 'gone'}: no such file or folder; expected maps that"),
        (tmp_path / "empty", truth, f"{tmp_path / 'empty'}: found no maps (.exr, .tif), expected those of"),
        (tmp_path / "z", truth, f"{tmp_path / 'z'}: holds z depth, and truth is radial range; resolve with"),
    ):
        done = cadtof("evaluate", maps, "--truth", against)
        assert done.err.startswith(f"Error: {told}")
        assert done.status in {1, 2}
        assert done.out == ""
