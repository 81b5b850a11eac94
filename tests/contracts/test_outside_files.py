"""Files that other software writes here are read correctly or refused with the right reason (docs/formats.md)."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource, open_frames
from cadtof_cli.files.frames import FrameLayout
from tests.conftest import Tool
from tests.files.forms import known_frame, plane_files
from tests.outside.cases import Case, MissingWriterError
from tests.outside.matrix import CASES, tried
from tests.support.needed import miss

LAYOUT = FrameLayout((1, 2))

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.writer}: {case.form}")
def test_a_file_is_read_correctly_or_refused_with_the_reason(case: Case, tmp_path: Path) -> None:
    try:
        message = tried(case, tmp_path)
    except MissingWriterError as missing:
        miss(str(missing))
    if case.refused is None:
        assert message is None
    else:
        assert message is not None
        assert str(tmp_path) in message
        assert case.refused in message
        assert "damaged" not in message


def test_the_table_in_the_docs_names_every_case() -> None:
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    missing = [case for case in CASES if f"| {case.writer} | {case.form} |" not in page]
    assert missing == [], "run scripts/outside_files"
    assert len(CASES) >= 60


def test_libtiff_joins_frames_to_a_stack(tmp_path: Path, tool: Tool) -> None:
    recorded = [known_frame("u2", seed=seed) for seed in range(3)]
    files = [plane_files(".tif")(tmp_path / f"frame_{i}", frame).paths for i, frame in enumerate(recorded)]
    tool("tiffcp", *[file for group in files for file in group], tmp_path / "stack.tif")
    with open_frames(FrameSource("stack", (tmp_path / "stack.tif",)), FrameLayout((1, 2), 3)) as stack:
        assert stack.count == 3
        assert all(np.array_equal(stack.read(i), frame) for i, frame in enumerate(recorded))


def _write_exr(path: Path, channels: dict[str, Stored]) -> Path:
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels, num_threads=0).write(str(path))
    return path


@pytest.mark.parametrize("names", [("h1", "h2"), ("H1", "H2"), ("first", "second")])
def test_exrmultipart_combines_one_file_per_harmonic(names: tuple[str, str], tmp_path: Path, tool: Tool) -> None:
    recorded = known_frame("f4")
    files = [
        _write_exr(tmp_path / f"{name}.exr", {"SC1": pair[0].copy(), "SC2": pair[1].copy()})
        for name, pair in zip(names, recorded, strict=True)
    ]
    tool("exrmultipart", "-combine", "-i", *files, "-o", tmp_path / "frame.exr", "-override", "1")
    with open_frames(FrameSource("frame", (tmp_path / "frame.exr",)), LAYOUT) as frames:
        assert np.array_equal(frames.read(0), recorded)
