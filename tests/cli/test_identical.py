"""The same recording gives the same bytes, for any number of processes, start method, block size and run."""

from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel, Voltage
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.settings import ResolverSettings
from tests.support.blocks import blocks_of
from tests.support.captures import VOLTS_PER_COUNT, ZERO_COUNTS, Form, counts_of, record
from tests.support.forward import step_frame
from tests.support.kernels import by_kernel
from tests.support.run_cadtof import program
from tests.support.runs import maps_of


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_the_same_maps_for_any_number_of_processes_and_start_method(form: Form, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=7, form=form)
    ways = {
        "one": ("--jobs", "1"),
        "again": ("--jobs", "1"),
        "two": ("--jobs", "2"),
        "three": ("--jobs", "3", "--start-method", "fork"),
        "spawned": ("--jobs", "2", "--start-method", "spawn"),
    }
    for name, way in ways.items():
        assert program("resolve", capture.folder, "-o", tmp_path / name, *way, "-q").status == 0
    first = maps_of(tmp_path / "one")
    assert sorted(first) == [f"frame_{index}.{form}" for index in range(7)]
    assert len(set(first.values())) == 7
    for name in ways:
        assert maps_of(tmp_path / name) == first


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("order", ["auto", "1", "2"])
def test_the_same_maps_for_any_size_of_blocks(order: str, known: bool) -> None:
    counts: Stored = counts_of(step_frame(np.random.default_rng(3), height=13, width=7)).reshape(2, 2, 13, 7)
    counts[0, 1, 2, 3] = 0
    metadata = CaptureMetadata(
        voltage=Voltage(zero_counts=ZERO_COUNTS, volts_per_count=VOLTS_PER_COUNT, saturated_counts=(0, 16383)),
        pixel=Pixel(integration_length=1e5 if known else None),
    )
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(order=order)))
    results = []
    for pixels in (1, 5, 64, 91, 10_000):
        with blocks_of(pixels):
            maps = by_kernel(NUMPY, resolve_frame, counts, plan=plan).maps
        results.append((maps.values.tobytes(), maps.status.tobytes()))
    assert np.isfinite(np.frombuffer(results[0][0], np.float32)).any()
    assert all(result == results[0] for result in results)


def test_resolve_does_not_change_the_capture(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2)
    before = {path.name: path.read_bytes() for path in capture.folder.iterdir()}
    assert program("resolve", capture.folder, "-o", tmp_path / "out", "-j", 2, "-q").status == 0
    assert {path.name: path.read_bytes() for path in capture.folder.iterdir()} == before
