"""Work grows as the number of captures and frames does: no list is searched for each of them, and no file is read again."""

import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path, PurePath
from types import SimpleNamespace
from typing import Any

import pytest

from cadtof_cli.capture import discovery
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.toml import load_metadata
from cadtof_cli.execution.workers import Workers
from cadtof_cli.workflows.inspect import capture_facts, first_phasors, info
from cadtof_cli.workflows.inspect.export import ExportSettings, export_maps
from cadtof_cli.workflows.progress import NO_PROGRESS
from cadtof_cli.workflows.resolve import arrivals
from cadtof_cli.workflows.resolve.reports import FrameReport
from cadtof_cli.workflows.resolve.run_document import RunDocument
from cadtof_cli.workflows.resolve.run_json import RunRecord
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from cadtof_cli.workflows.run_folder import Run
from tests.support.captures import record
from tests.support.run_cadtof import cadtof

MANY = 60


@contextmanager
def _counted(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str) -> Iterator[Callable[[], int]]:
    """Count the calls of a function, or the uses of a property, in the block."""
    original, calls = vars(owner)[name], list[None]()
    function: Any = original.fget if isinstance(original, property) else original

    def counting(*arguments: Any, **named: Any) -> Any:
        calls.append(None)
        return function(*arguments, **named)

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, property(counting) if isinstance(original, property) else counting)
        yield calls.__len__


def _tree(folder: Path, captures: int) -> list[Path]:
    """Make folders with one file each that nobody opens, below one `capture.toml`; return the files."""
    folder.mkdir()
    (folder / "capture.toml").write_text("[target]\ndistance_m = 2.0\n")
    files = [folder / f"c{number}" / "frame.tif" for number in range(captures)]
    for file in files:
        file.parent.mkdir()
        file.touch()
    return files


def test_paths_that_arrive_at_once_are_compared_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = _tree(tmp_path / "rec", MANY)
    with _counted(monkeypatch, arrivals, "absolute") as calls:
        found = arrivals.Arrivals(ResolveSettings(out=tmp_path / "out"), ())
        there, _ = found.first_captures(files)
        assert (len(there), found.failed) == (MANY, [])
        assert calls() < 5 * MANY


def test_the_settings_of_a_tree_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _tree(tmp_path / "rec", MANY)
    with _counted(monkeypatch, discovery, "load_metadata") as calls:
        found = find_captures([tmp_path / "rec"], recursive=True)
        assert calls() == 1
    assert {one.source.metadata.target.distance_m for one in found} == {2.0}


class _Root:
    """The folder of a capture, which counts how often it is asked for its text."""

    asked = 0

    def __init__(self, name: str) -> None:
        self._name = name

    def __str__(self) -> str:
        _Root.asked += 1
        return self._name

    def __fspath__(self) -> str:
        return self._name


def test_captures_of_a_run_are_recorded_without_a_search() -> None:
    source = load_metadata(None)
    captures = [
        SimpleNamespace(root=_Root(f"c{number % MANY}"), source=source, frames=[0], lossy_compression=None)
        for number in range(2 * MANY)
    ]
    document = RunDocument(captures=[])
    document.add_captures([SimpleNamespace(capture=one) for one in captures])  # type: ignore[misc]
    assert [(one["root"], one["files"]) for one in document["captures"]] == [
        (f"c{number}", 2) for number in range(MANY)
    ]
    assert _Root.asked < 5 * len(captures)


def test_files_to_be_exported_are_not_compared_with_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = record(tmp_path / "capture")
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "-q").status == 0
    (tmp_path / "maps").mkdir()
    for number in range(MANY):
        shutil.copy(tmp_path / "out" / "frame_0.tif", tmp_path / "maps" / f"m{number}.tif")
    with _counted(monkeypatch, PurePath, "__eq__") as calls:
        made = export_maps([tmp_path / "maps"], tmp_path / "e.png", settings=ExportSettings(), progress=NO_PROGRESS)
        assert calls() < 5 * MANY
    assert len(set(made)) == MANY


def test_the_maps_of_frames_are_found_without_a_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without `run.json`, the folders that the lines name are looked for among the maps."""
    run = Run(tmp_path, tuple(tmp_path / f"{number}.tif" for number in range(MANY)), tmp_path, None)
    reports = [FrameReport(f"{number}", f"old/out/{number}.tif", "ok", None, 0.0) for number in range(MANY)]
    with _counted(monkeypatch, PurePath, "__eq__") as calls:
        assert [run.map_of(report) for report in reports] == list(run.files)
        assert calls() < 10 * MANY


def test_the_optics_of_a_map_are_found_without_a_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The captures have folders of the same name, and lenses of their own."""
    captures = [
        {
            "root": f"/rec/{number}/cam",
            "metadata": {"optics": {"focal_length_px": 100.0 + number, "principal_point_px": None}},
        }
        for number in range(MANY)
    ]
    known = {
        "arguments": {"inputs": ["/rec"], "absolute_inputs": ["/rec"], "overrides": {}, "out": "out"},
        "captures": captures,
        "shared_folder": "/rec",
    }
    files = tuple(tmp_path / str(number) / "cam" / "frame.tif" for number in range(MANY))
    run = Run(tmp_path, files, tmp_path, RunRecord(known))
    with _counted(monkeypatch, PurePath, "parts") as calls:
        found = [run.optics(file).focal_length_px for file in files]
        assert calls() < 10 * MANY
    assert found == [100.0 + number for number in range(MANY)]


class _Read(dict[str, Any]):
    """A capture in the record of a run, which counts how often it is read."""

    times = 0

    def __getitem__(self, key: str) -> Any:
        _Read.times += 1
        return super().__getitem__(key)

    def get(self, key: str, default: Any = None) -> Any:
        _Read.times += 1
        return super().get(key, default)


@pytest.mark.parametrize("moved", [False, True])
def test_settings_are_compared_with_those_of_the_capture_alone(tmp_path: Path, *, moved: bool) -> None:
    files = _tree(tmp_path / "rec", MANY)
    found = find_captures([tmp_path / "rec"], recursive=True)
    metadata = json.loads(json.dumps(asdict(found[0].source.metadata)))
    roots = [os.path.realpath(file.parent) + ".old" * moved for file in files]
    known = [_Read(resolved_root=root, metadata=metadata) for root in roots]
    arguments = {"inputs": [], "overrides": {}, "depth": "range"}
    run = Run(tmp_path, (), tmp_path, RunRecord(arguments=arguments, captures=known))
    recorded = {f"{number}": (one, tuple(one.frames), None) for number, one in enumerate(found)}
    object.__setattr__(run, "recorded_frames", lambda _: recorded)
    said = list[str]()
    assert len(first_phasors.first_phasors(run, said.append).recorded) == MANY
    assert said == []
    assert _Read.times < 10 * MANY


def test_info_reads_all_captures_with_the_same_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [record(tmp_path / "rec" / name, frames=2, seed=seed).folder for seed, name in enumerate("abc")]
    (folders[1] / "frame_0.tif").write_bytes(b"damaged")

    def looked(*inputs: Path, recursive: bool = False) -> list[info.Facts]:
        workers = Workers(jobs=2)
        return info.look_into(
            inputs, overrides={}, workers=workers, progress=NO_PROGRESS, settings_file=None, recursive=recursive
        )

    alone = [looked(folder)[0] for folder in folders]
    with _counted(monkeypatch, capture_facts, "run_ordered") as calls:
        assert looked(tmp_path / "rec", recursive=True) == alone
        assert calls() == 1
    assert [len(one.problems) for one in alone] == [0, 1, 0]


def test_a_note_on_a_capture_is_given_once_if_its_files_are_named_in_turn_with_others(tmp_path: Path) -> None:
    first, second = (record(tmp_path / name, frames=3, toml="").files for name in "ab")
    in_turn = [file for pair in zip(first, second, strict=True) for file in pair]
    done = cadtof(
        "resolve", *in_turn, "-o", tmp_path / "out", "-j", 1, "--volts-per-count", "6e-5", "--zero-counts", 8192
    )
    told = [line for line in done.err.splitlines() if "so taken from the paper" in line]
    assert len(told) == len(set(told)) == 2
