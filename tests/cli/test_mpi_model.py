"""`resolve --mpi-model`: what is taken for diffuse MPI, how it is counted, and the same maps for any number of jobs."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import tifffile

from tests.support.captures import layers_of
from tests.support.diffuse_frames import F
from tests.support.run_cadtof import ROOT, Finished, cadtof, program

DATA = ROOT / "sample_data"
ONE_PATH, TWO_PATHS, ILL_CONDITIONED, POOLED, DIFFUSE = 8, 16, 32, 1024, 2048


def resolved(name: str, out: Path, *options: str) -> tuple[dict[str, F], Finished]:
    done = cadtof("resolve", DATA / name, "-o", out, "--jobs", "1", "--json", *options)
    assert done.status == 0, done.err
    return layers_of(next(path for path in sorted(out.iterdir()) if path.suffix in {".tif", ".exr"})), done


def median_error_cm(name: str, layers: dict[str, F]) -> float:
    truth = layers_of(DATA / name / "truth.exr")["direct.depth"]
    return float(np.nanmedian(np.abs(100 * (layers["direct.depth"] - truth))))


def test_a_corner_s_mpi_is_taken_for_diffuse_and_counted(tmp_path: Path) -> None:
    layers, done = resolved("corner", tmp_path / "auto")
    status = layers["status"].astype(int)
    line = json.loads(done.out)
    assert (status & DIFFUSE > 0).all()
    assert not (status & (ONE_PATH | TWO_PATHS | ILL_CONDITIONED)).any()
    assert (line["diffuse"], line["one_path"], line["two_paths"], line["invalid"]) == (status.size, 0, 0, 0)
    run = json.loads((tmp_path / "auto" / "run.json").read_text())
    assert run["arguments"]["mpi_model"] == "auto"
    assert (run["totals"]["diffuse"], run["totals"]["diffuse_frames"]) == (status.size, 1)
    assert run["status_bits"]["DIFFUSE_MPI"] == DIFFUSE
    assert "pixels: 100.0% diffuse MPI, 0.0% two paths, 0.0% one path, 0.0% no answer;" in done.err
    discrete, _ = resolved("corner", tmp_path / "discrete", "--mpi-model", "discrete")
    assert median_error_cm("corner", layers) < median_error_cm("corner", discrete)
    for name in ("direct.depth", "mpi.depth", "direct.amplitude", "mpi.amplitude", "direct.sigma", "mpi.sigma"):
        assert np.isfinite(layers[name]).all(), name
    assert (layers["mpi.depth"] > layers["direct.depth"]).all()


@pytest.mark.parametrize("name", ["card", "wall"])
def test_captures_without_diffuse_mpi_give_the_bits_of_discrete(name: str, tmp_path: Path) -> None:
    auto, done = resolved(name, tmp_path / "auto")
    discrete, _ = resolved(name, tmp_path / "discrete", "--mpi-model", "discrete")
    assert all(json.loads(line)["diffuse"] == 0 for line in done.out.splitlines())
    for layer, values in discrete.items():
        np.testing.assert_array_equal(auto[layer], values, err_msg=layer)


@pytest.mark.parametrize("options", [("--solver", "one-path"), ("--order", "2"), ("--return", "last")])
def test_options_about_paths_switch_diffuse_mpi_off(options: tuple[str, ...], tmp_path: Path) -> None:
    layers, _ = resolved("corner", tmp_path / "out", *options)
    assert not (layers["status"].astype(int) & DIFFUSE).any()


def test_the_same_bytes_for_any_number_of_processes(tmp_path: Path) -> None:
    folder = tmp_path / "capture"
    shutil.copytree(DATA / "corner", folder)
    shutil.copy(folder / "frame_0000.tif", folder / "frame_0001.tif")
    ways = []
    for jobs in ("1", "2", "3"):
        done = program("resolve", folder, "-o", tmp_path / jobs, "--jobs", jobs)
        assert done.status == 0, done.err
        ways.append([(tmp_path / jobs / f"frame_000{index}.tif").read_bytes() for index in (0, 1)])
    assert ways[0] == ways[1] == ways[2]


def test_a_wrong_model_is_refused(tmp_path: Path) -> None:
    done = cadtof("resolve", DATA / "corner", "-o", tmp_path / "out", "--mpi-model", "smooth")
    assert done.status == 2
    assert "'smooth' is not one of 'auto', 'discrete', 'diffuse'" in done.err


def test_unknown_optics_are_reported_once(tmp_path: Path) -> None:
    folder = tmp_path / "capture"
    folder.mkdir()
    shutil.copy(DATA / "corner" / "frame_0000.tif", folder)
    kept = (DATA / "corner" / "capture.toml").read_text().split("[optics]")[0]
    (folder / "capture.toml").write_text(kept)
    done = cadtof("resolve", folder, "-o", tmp_path / "out", "--jobs", "1")
    assert done.status == 0, done.err
    assert done.err.count("60° wide") == 1
    layers = layers_of(tmp_path / "out" / "frame_0000.tif")
    assert (layers["status"].astype(int) & DIFFUSE > 0).all()
    assert median_error_cm("corner", layers) < 1.5


def test_frames_without_harmonic_2_get_separate_paths_and_a_note_or_are_refused(tmp_path: Path) -> None:
    """A room came out a decimetre too far, with a sigma of millimetres, and --mpi-model diffuse did nothing."""
    done = cadtof("simulate", "--scene", "corner", "--periods-ns", "60,20,15", "-o", tmp_path / "corner")
    assert done.status == 0, done.err
    words = "half of the first period was not recorded, so all MPI is taken for separate paths, in rooms too"
    for model, status, told in (("auto", 0, words), ("discrete", 0, ""), ("diffuse", 2, "--mpi-model diffuse: found")):
        done = cadtof("resolve", tmp_path / "corner", "-o", tmp_path / model, "--mpi-model", model, "--roi", "0,0,9,9")
        assert done.status == status, done.err
        assert told in done.err
        assert (words in done.err) == (model == "auto")
    # with one path, the option has no effect, so nothing is refused; two paths are shown to compare them
    of_one = ("--order", "1", "--mpi-model", "diffuse")
    done = cadtof("resolve", tmp_path / "corner", "-o", tmp_path / "one", "--roi", "0,0,9,9", *of_one)
    assert done.status == 0
    assert "--mpi-model: has no effect" in done.err
    pixel = json.loads(cadtof("inspect", tmp_path / "corner", "--pixel", "20,20", "--json", *of_one).out)
    assert pixel["two_paths"]["direct"]["depth_m"] < pixel["one_path"]["depth_m"]


@pytest.mark.parametrize("options", [("--pool", "3"), ("--average", "2"), ("--depth", "z")])
def test_diffuse_mpi_goes_with_pooling_averaging_and_planar_depth(options: tuple[str, ...], tmp_path: Path) -> None:
    layers, _ = resolved("corner", tmp_path / "out", *options)
    status = layers["status"].astype(int)
    assert (status & DIFFUSE > 0).mean() > 0.99
    if options[0] == "--pool":
        assert (status & POOLED > 0).any()
    if options[0] != "--depth":
        assert median_error_cm("corner", layers) < 1.2


def test_saturated_columns_and_holes_cost_no_other_pixels(tmp_path: Path) -> None:
    folder = tmp_path / "capture"
    shutil.copytree(DATA / "corner", folder)
    stored = tifffile.imread(folder / "frame_0000.tif")
    lost = np.zeros((240, 320), bool)
    lost[:, 100:103] = lost[50:90, 200:260] = True
    stored[..., lost] = 16383
    tifffile.imwrite(folder / "frame_0000.tif", stored)
    done = cadtof("resolve", folder, "-o", tmp_path / "out", "--jobs", "1")
    assert done.status == 0, done.err
    layers = layers_of(tmp_path / "out" / "frame_0000.tif")
    np.testing.assert_array_equal(np.isnan(layers["direct.depth"]), lost)
    whole, _ = resolved("corner", tmp_path / "whole")
    assert median_error_cm("corner", layers) < 1.2 * median_error_cm("corner", whole)
