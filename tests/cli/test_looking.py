"""`cadtof info`, `evaluate` and `preview`: numbers and pictures of small captures and their maps."""

import json
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from tests.support.forward import step_truth
from tests.support.recorded import exr_layers, tiff_capture
from tests.support.run_cadtof import cadtof


def test_evaluate_and_preview(tmp_path: Path) -> None:
    capture, out, truth = tiff_capture(tmp_path / "c"), tmp_path / "out", tmp_path / "truth.exr"
    assert cadtof("resolve", capture, "-o", out, "--format", "exr", "--jobs", 1).status == 0
    OpenEXR.File({}, {"direct.depth": step_truth().astype(np.float32)}, num_threads=0).write(str(truth))
    done = cadtof("evaluate", out, "--truth", truth, "--json")
    assert done.status == 0
    found = json.loads(done.out)
    assert set(found) == {"frames", "direct", "first_phasor"}
    error = 100 * (exr_layers(out / "f_0.exr")["direct.depth"].astype(float) - step_truth().astype(np.float32))
    assert found["direct"]["rmse_cm"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert found["direct"]["bias_cm"] == pytest.approx(np.mean(error))
    assert found["direct"]["median_cm"] == pytest.approx(np.median(np.abs(error)), abs=0.002)
    assert found["direct"]["p90_cm"] == pytest.approx(np.quantile(np.abs(error), 0.9), abs=0.02)
    assert found["direct"]["valid"] == 1.0
    assert found["first_phasor"]["rmse_cm"] > 10
    assert cadtof("preview", out, "-o", tmp_path / "p.png").status == 0
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG\r\n")


def test_info(tmp_path: Path) -> None:
    capture = tiff_capture(tmp_path / "c", frames=2)
    done = cadtof("info", capture, "--json", "--jobs", 1)
    assert (done.status, done.err) == (0, "")
    facts = json.loads(done.out)
    assert (facts["kind"], facts["frames"], facts["shape"]) == ("capture", 2, [2, 2, 24, 32])
    assert facts["unambiguous_range_m"] == pytest.approx(5.99584916)
    (capture / "f_1.tif").write_bytes(b"garbage!")
    done = cadtof("info", capture, "--jobs", 1)
    assert done.status == 1
    assert f"wrong: {capture / 'f_1.tif'}: neither TIFF nor EXR" in done.err
