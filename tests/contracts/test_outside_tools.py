"""A program on PATH counts as an outside tool only if its version text names its maker."""

import os
from pathlib import Path

import pytest

from tests.outside.cases import MissingWriterError, run
from tests.support.outside_tools import outside_tool


def program(folder: Path, name: str, script: str) -> Path:
    folder.mkdir()
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


def test_another_program_of_the_same_name_is_no_tool(tmp_path: Path) -> None:
    program(tmp_path / "silent", "convert", "exit 0")
    program(tmp_path / "other", "convert", "echo 'convert: ImageMagick is not installed here'; exit 1")
    program(tmp_path / "binary", "convert", "printf '\\377\\376'")
    folders = [str(tmp_path / name) for name in ("silent", "other", "binary", "missing")]
    assert outside_tool("convert", os.pathsep.join(folders)) is None


def test_another_program_of_the_same_name_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = program(tmp_path / "other", "convert", "echo 'convert: ImageMagick is not installed here' >&2; exit 1")
    monkeypatch.setenv("PATH", str(stand_in.parent))
    with pytest.raises(MissingWriterError, match="ImageMagick is not installed"):
        run("convert", "in.tif", "out.tif")


def test_the_tool_is_found_behind_another_program_of_its_name(tmp_path: Path) -> None:
    program(tmp_path / "other", "convert", "echo 'a converter of units'")
    true = program(tmp_path / "true", "convert", "echo 'Version: ImageMagick 6.9.11-60 Q16 x86_64'")
    assert outside_tool("convert", os.pathsep.join([str(tmp_path / "other"), str(true.parent)])) == str(true)


def test_each_maker_is_recognised_by_its_version_text(tmp_path: Path) -> None:
    scripts = {
        "tiffcp": "echo 'LIBTIFF, Version 4.5.0' >&2; exit 1",
        "tiffsplit": "echo 'LIBTIFF, Version 4.5.0'; echo 'usage: tiffsplit input.tif [prefix]'",
        "java": "echo 'openjdk version \"17.0.9\" 2023-10-17' >&2",
        "identify": "echo 'Version: ImageMagick 7.1.1-21 Q16-HDRI'",
        "exrheader": 'echo "usage: $0 imagefile [imagefile ...]" >&2; exit 1',
        "exrmaketiled": 'echo "Usage: $0 [options] infile outfile"',
        "exrmultipart": "echo 'Usage: exrmultipart -combine -i input.exr[:partnum] -o outfile.exr [options]'; exit 1",
    }
    for name, script in scripts.items():
        path = program(tmp_path / name, name, script)
        assert outside_tool(name, str(path.parent)) == str(path)
