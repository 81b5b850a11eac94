"""Captures as files: what other readers find in them; their bytes do not depend on the number of processes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile

from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.capture.toml import load_metadata
from cadtof_cli.errors import OutputError, SettingsError
from cadtof_cli.execution.workers import ALONE, Workers
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Band, Exposure
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.simulation.scene.scenes import Card, Corner, Wall
from cadtof_cli.workflows.progress import Progress, results
from cadtof_cli.workflows.simulate import record
from cadtof_cli.workflows.simulate.record import RecordReport, RecordSettings, expose, record_scene, write_capture
from tests.support.told import Told

CAMERA = Camera(width=33, height=21)


def exposure(*, scene: Scene | None = None, camera: Camera = CAMERA, seed: int = 7) -> Exposure:
    metadata = CaptureMetadata(pixel=Pixel(integration_length=1e4), optics=camera.optics, voltage=camera.voltage)
    return Exposure(scene=scene or Card(), camera=camera, metadata=metadata, seed=seed)


def recorded(shown: Exposure, out: Path, *, jobs: int = 1, **settings: Any) -> RecordReport:
    return record_scene(shown, out, settings=RecordSettings(**{"frames": 2, **settings}), workers=Workers(jobs=jobs))


def channels(path: Path) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float32]]]:
    return {name: c.pixels for name, c in OpenEXR.File(str(path), separate_channels=True).channels().items()}


def test_tiff_counts_are_the_voltages_with_their_noise(tmp_path: Path) -> None:
    recorded(exposure(), tmp_path / "c")
    stored = tifffile.imread(tmp_path / "c" / "frame_0001.tif")
    assert stored.shape == (2, 2, 21, 33)
    assert stored.dtype == np.uint16
    volts = (stored.astype(np.float64) - 8192.0) * 6.0e-5
    statistics = expose(exposure()).voltages
    off = (volts - statistics.means_v) / np.sqrt(statistics.covariances_v2[:, ::2])
    assert off.std() == pytest.approx(1.0, abs=0.05)
    assert np.abs(off).max() < 5.5


def test_exr_channels_hold_volts_by_name(tmp_path: Path) -> None:
    recorded(exposure(), tmp_path / "c", frame_format="exr", compress=True)
    planes = channels(tmp_path / "c" / "frame_0000.exr")
    assert sorted(planes) == ["H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2"]
    means = expose(exposure()).voltages.means_v
    np.testing.assert_allclose(planes["H2.SC1"], means[1, 0], atol=5.5 * 0.2746 / (2 * np.sqrt(1e4)))


def test_capture_toml_says_what_was_simulated(tmp_path: Path) -> None:
    recorded(exposure(), tmp_path / "c")
    text = (tmp_path / "c" / "capture.toml").read_text()
    assert "# simulated by cadtof" in text
    assert "two ideal paths" in text
    assert "seed: 7" in text
    source = load_metadata(tmp_path / "c" / "capture.toml")
    assert source.metadata == exposure().metadata


def test_truth_is_kept_to_a_fifth_of_a_millimetre(tmp_path: Path) -> None:
    recorded(exposure(scene=Corner()), tmp_path / "c")
    truth = channels(tmp_path / "c" / "truth.exr")
    exact = Corner().light(CAMERA, slice(0, 21)).truth(0.2746)
    assert sorted(truth) == sorted(exact)
    for name in ("direct.depth", "mpi.depth"):
        np.testing.assert_allclose(truth[name], exact[name], atol=2e-4)
    np.testing.assert_allclose(truth["direct.amplitude"], exact["direct.amplitude"], rtol=1e-4)


@pytest.mark.parametrize("frame_format", ["tif", "exr"])
def test_same_seed_same_bytes_for_any_number_of_processes(tmp_path: Path, frame_format: str) -> None:
    for name, jobs in (("one", 1), ("three", 3), ("again", 1)):
        recorded(exposure(scene=Corner()), tmp_path / name, frame_format=frame_format, jobs=jobs)
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert names == sorted(["capture.toml", "truth.exr", *(f"frame_000{i}.{frame_format}" for i in (0, 1))])
    for name in names:
        expected = (tmp_path / "one" / name).read_bytes()
        assert (tmp_path / "three" / name).read_bytes() == expected
        assert (tmp_path / "again" / name).read_bytes() == expected


def test_a_room_has_the_same_bytes_for_any_number_of_processes(tmp_path: Path) -> None:
    for name, jobs in (("one", 1), ("two", 2)):
        recorded(exposure(scene=RandomRoom(seed=8, light_paths=8)), tmp_path / name, jobs=jobs)
    for name in ("truth.exr", "frame_0000.tif"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_another_seed_is_another_capture_of_the_same_truth(tmp_path: Path) -> None:
    recorded(exposure(seed=1), tmp_path / "a")
    recorded(exposure(seed=2), tmp_path / "b")
    assert (tmp_path / "a" / "truth.exr").read_bytes() == (tmp_path / "b" / "truth.exr").read_bytes()
    first, second = (tifffile.imread(tmp_path / name / "frame_0000.tif") for name in "ab")
    assert (first != second).mean() > 0.8


def test_frames_differ_by_independent_noise_and_share_dark_offsets(tmp_path: Path) -> None:
    camera = Camera(width=33, height=21, dark_offset_v=0.01)
    recorded(exposure(camera=camera), tmp_path / "c")
    frames = [tifffile.imread(tmp_path / "c" / f"frame_000{i}.tif").astype(np.float64) * 6.0e-5 for i in (0, 1)]
    sigma = 0.2746 / (2 * np.sqrt(1e4))
    assert (frames[1] - frames[0]).std() == pytest.approx(sigma * np.sqrt(2), rel=0.15)
    clean = expose(exposure()).voltages.means_v
    assert (frames[0] - 8192 * 6.0e-5 - clean).std() == pytest.approx(0.01, rel=0.1)


def test_voltages_beyond_the_converter_saturate(tmp_path: Path) -> None:
    camera = Camera(width=33, height=21, bits=10, zero_counts=512, volts_per_count=1e-4)
    recorded(exposure(camera=camera, scene=Card(asr=0.0)), tmp_path / "c")
    stored = tifffile.imread(tmp_path / "c" / "frame_0000.tif")
    assert stored.max() == 1023
    assert (stored == 1023).mean() > 0.1


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_step_is_reported(jobs: int, tmp_path: Path) -> None:
    progress, settings = Told(), RecordSettings(frames=3)
    record_scene(exposure(), tmp_path / "c", settings=settings, workers=Workers(jobs=jobs), progress=progress)
    assert (progress.expected, progress.steps) == (3 + 3, 3 + 3)


def test_a_process_gets_bands_that_lie_together(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[int, ...]] = []

    def noted(function: Callable[[Sequence[slice]], list[Band]], shares: Sequence[Sequence[slice]], **_: Any) -> Any:
        given.extend(tuple(rows.start for rows in share) for share in shares)
        return map(function, shares)

    monkeypatch.setattr(record, "results", noted)
    for jobs, rows, shares in ((1, 33, (1, 1, 1, 1, 1)), (2, 33, (3, 2)), (4, 33, (2, 2, 1)), (2, 321, (16, 16, 9))):
        given.clear()
        expose(exposure(camera=Camera(width=2, height=rows)), workers=Workers(jobs=jobs))
        assert tuple(map(len, given)) == shares
        assert [start for share in given for start in share] == list(range(0, rows, 8))


def test_frames_are_recorded_by_as_many_processes_as_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []

    def shared(function: Callable[[Any], Any], tasks: Sequence[Any], *, workers: Workers, progress: Progress) -> Any:
        asked.append((len(tasks), workers.jobs))
        return results(function, tasks, workers=ALONE, progress=progress)

    monkeypatch.setattr(record, "results", shared)
    recorded(exposure(), tmp_path / "c", jobs=3, frames=5)
    assert asked == [(3, 3), (5, 3)]
    assert len(list((tmp_path / "c").glob("frame_*.tif"))) == 5


def test_an_out_that_exists_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="c: found a folder with files, expected nothing there"):
        recorded(exposure(), tmp_path / "c")
    assert [path.name for path in (tmp_path / "c").iterdir()] == ["mine.txt"]
    with pytest.raises(OutputError, match="found a file"):
        recorded(exposure(), tmp_path / "c" / "mine.txt")


def test_a_recording_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="unambiguous range"):
        recorded(exposure(scene=Wall(distance_m=5.95)), tmp_path / "c")
    assert list(tmp_path.iterdir()) == []


def test_no_frames_is_refused() -> None:
    with pytest.raises(SettingsError, match="frames: found 0, expected 1 or more"):
        RecordSettings(frames=0)


@pytest.mark.parametrize("frame_format", ["tif", "exr"])
def test_a_capture_is_compressed_only_if_that_is_asked_for(frame_format: str, tmp_path: Path) -> None:
    """Noise hardly shrinks, and takes long to compress. A frame of zeros shows by its size if it was compressed."""
    camera = Camera(width=330, height=210)
    plain, shown = RecordSettings(frame_format=frame_format), exposure(camera=camera)
    frames, truth = [np.zeros((2, 2, 210, 330))], {"direct.depth": np.ones((210, 330))}
    for name, asked in (
        ("plain", plain),
        ("asked", replace(plain, compress=True)),
        ("refused", replace(plain, compress=False)),
    ):
        (tmp_path / name).mkdir()
        write_capture(tmp_path / name, frames, exposure=shown, settings=asked, truth=truth)
    sizes = {path.parent.name: path.stat().st_size for path in tmp_path.glob("*/frame_*")}
    assert sizes["plain"] == sizes["refused"] > 10 * sizes["asked"]


def test_an_unknown_frame_format_is_refused() -> None:
    with pytest.raises(SettingsError, match="format: found png, expected tif or exr"):
        RecordSettings(frame_format="png")
