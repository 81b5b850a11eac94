"""Maps are the same in any environment: locales, settings of Python, missing folders, files named like modules."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.cli import COMMANDS
from cadtof_cli.execution.workers import START_METHODS
from tests.support.captures import record
from tests.support.needed import needed_program
from tests.support.run_cadtof import ENVIRONMENT, PROGRAM, Finished

TRAPS = ("click", "json", "numpy", "pathlib", "random", "runpy", "tempfile", "tifffile", "types")
"""Modules. A folder may hold files with these names; most of the modules are imported before a program's first line."""

ENVIRONMENTS = {
    "a decimal comma, a narrow terminal that can do nothing, no threads": {
        "LC_ALL": "de_DE.UTF-8", "TERM": "dumb", "COLUMNS": "1", "NO_COLOR": "1", "OMP_NUM_THREADS": "many",
    },
    "an I that is no i, an encoding that lacks letters": {"LC_ALL": "tr_TR.UTF-8", "PYTHONIOENCODING": "ascii:strict"},
    "no UTF-8, no time zone": {
        "LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "TZ": "Nowhere/Bad:17",
    },
    "no home, no temporary folder, a locale that is not there": {
        "HOME": "/nowhere", "TMPDIR": "/nowhere", "XDG_CACHE_HOME": "/nowhere", "LC_ALL": "xx_YY.UTF-8",
    },
    "Python without asserts and docstrings": {"PYTHONOPTIMIZE": "2", "PYTHONHASHSEED": "random"},
    "Python's development mode": {"PYTHONDEVMODE": "1", "PYTHONMALLOC": "debug"},
}  # fmt: skip


def _run(
    *arguments: object, cwd: Path, program: tuple[str, ...] = PROGRAM, environment: Mapping[str, str] | None = None
) -> Finished:
    """Run `cadtof` in a folder, in an environment with no variables but PATH, PYTHONPATH and the given ones."""
    plain = {"PATH": os.environ["PATH"], "PYTHONPATH": ENVIRONMENT["PYTHONPATH"], **(environment or {})}
    command = [*program, *map(str, arguments)]
    done = subprocess.run(command, env=plain, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)
    return Finished(done.returncode, done.stdout, done.stderr)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("Aufnahme größer ı")
    return record(folder / "cap", frames=2).folder


@pytest.fixture(scope="module")
def maps(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    here = tmp_path_factory.mktemp("usual")
    assert _run("resolve", capture, "-o", "out", "-j", 1, "-q", cwd=here) == Finished(0, "", "")
    return _maps(here / "out")


def _maps(out: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(out.glob("*.tif"))]


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_an_environment_changes_nothing(name: str, capture: Path, maps: list[bytes], tmp_path: Path) -> None:
    done = _run("resolve", capture, "-o", tmp_path / "ö", "-j", 2, cwd=tmp_path, environment=ENVIRONMENTS[name])
    assert (done.status, done.out) == (0, "")
    # a note about kernels says what is compiled, which differs from machine to machine
    lines = [line for line in done.err.splitlines() if "kernel" not in line]
    assert [line.partition(" in ")[0] for line in lines] == ["resolved 2 of 2 frames"]
    assert _maps(tmp_path / "ö") == maps


SETTINGS = """
backend: QtAgg
text.usetex: True
font.family: nonsense
font.size: 30
axes.grid: True
figure.facecolor: red
image.origin: lower
savefig.bbox: tight
savefig.dpi: 30
"""


def test_pictures_do_not_follow_the_settings_of_other_plots(capture: Path, tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text(SETTINGS)
    (tmp_path / "elsewhere").mkdir()
    frame = capture / "frame_0.tif"
    for command in (("preview", frame, "-o"), ("inspect", frame, "--pixel", "3,3", "-o")):
        for folder, backend in ((tmp_path, {"MPLBACKEND": "nonsense"}), (tmp_path / "elsewhere", {})):
            done = _run(*command, "picture.png", cwd=folder, environment=backend)
            assert (done.status, done.err) == (0, "")
        assert (tmp_path / "picture.png").read_bytes() == (tmp_path / "elsewhere" / "picture.png").read_bytes()
        (tmp_path / "picture.png").unlink()
        (tmp_path / "elsewhere" / "picture.png").unlink()


def test_pictures_say_what_they_need_if_no_folder_can_be_written_into(capture: Path, tmp_path: Path) -> None:
    """As in a container whose root is read-only: matplotlib then lacks a folder for its list of fonts."""
    no_folder = "import tempfile\ndef none(*_): raise FileNotFoundError(2, 'No usable temporary directory found')\n"
    (tmp_path / "sitecustomize.py").write_text(no_folder + "tempfile._get_default_tempdir = none\n")
    folders = {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null", "XDG_CONFIG_HOME": "/dev/null"}
    paths = {"PYTHONPATH": os.pathsep.join([str(tmp_path), ENVIRONMENT["PYTHONPATH"]])}
    picture = tmp_path / "picture.png"
    done = _run("preview", capture / "frame_0.tif", "-o", picture, cwd=tmp_path, environment=folders | paths)
    assert done.status == 2
    assert "Error: Matplotlib requires access to a writable cache directory" in done.err
    assert "set the MPLCONFIGDIR environment variable to a writable directory" in done.err
    assert not picture.exists()


@pytest.mark.parametrize("command", ["resolve", "calibrate"])
def test_help_without_docstrings_says_what_a_command_does(command: str, tmp_path: Path) -> None:
    done = _run(command, "--help", cwd=tmp_path, environment={"PYTHONOPTIMIZE": "2", "COLUMNS": "200"})
    assert (done.status, done.err) == (0, "")
    assert COMMANDS[command] in done.out


def test_bytecode_that_a_full_disk_cut_off_is_reported(capture: Path, tmp_path: Path) -> None:
    """Python before 3.14 keeps such bytecode, and fails from then on."""
    environment = {"PYTHONPYCACHEPREFIX": str(tmp_path)}
    assert _run("info", capture, cwd=tmp_path, environment=environment).status == 0
    (cached,) = tmp_path.rglob("cadtof_cli/commands/info.*.pyc")
    cached.write_bytes(cached.read_bytes()[:100])
    done = _run("info", capture, cwd=tmp_path, environment=environment)
    assert (done.status, done.out) == (1, "")
    assert done.err.endswith("where cadtof and its packages are installed\n")
    assert "Python has stored bytecode that is cut off; was a disk full? Remove the folders __pycache__" in done.err
    cached.unlink()
    assert _run("info", capture, cwd=tmp_path, environment=environment).status == 0


@pytest.mark.parametrize("start", START_METHODS)
def test_files_named_like_modules_are_not_imported(
    start: str, capture: Path, maps: list[bytes], tmp_path: Path
) -> None:
    """Worker processes import nothing from the current folder of the user."""
    trapped, script = tmp_path / "trapped", tmp_path / "cadtof"
    trapped.mkdir()
    for name in TRAPS:
        (trapped / f"{name}.py").write_text(f"raise SystemExit('imported {name}')")
    # like the script that pip installs; `python -m` itself would import from the current folder
    script.write_text('from cadtof_cli.cli import main\nif __name__ == "__main__":\n    main()\n')
    arguments = ("resolve", capture, "-o", tmp_path / "out", "-j", 2, "-q", "--start-method", start)
    done = _run(*arguments, cwd=trapped, program=(sys.executable, str(script)))
    assert done == Finished(0, "", "")
    assert _maps(tmp_path / "out") == maps


def _locale(folder: Path, language: str, encoding: str) -> Mapping[str, str]:
    """Make a locale, and return the environment in which it counts."""
    name = f"{language}.{encoding}"
    made = [needed_program("localedef"), "-c", "-i", language, "-f", encoding, str(folder / name)]
    if subprocess.run(made, capture_output=True, timeout=60, check=False).returncode:
        pytest.skip(f"the files of which the locale {name} is made are not installed")
    return {"LOCPATH": str(folder), "LC_ALL": name, "PYTHONIOENCODING": "utf-8"}


def test_exr_files_where_the_locale_reads_names_otherwise(tmp_path: Path) -> None:
    """Names are UTF-8 on the disk, but not in the locale: frames were called damaged, and maps could not be written."""
    environment, folder = _locale(tmp_path, "tr_TR", "ISO-8859-9"), record(tmp_path / "ölçüm ı", form="exr").folder
    done = _run("resolve", folder, "-o", "çıktı", "-j", 1, "-q", cwd=tmp_path, environment=environment)
    assert done == Finished(0, "", "")
    assert (tmp_path / "çıktı" / "frame_0.exr").exists()


def test_a_name_that_the_locale_cannot_read_is_reported(tmp_path: Path) -> None:
    environment, folder = _locale(tmp_path, "ja_JP", "EUC-JP"), record(tmp_path / "ölçüm ş").folder
    done = _run("info", folder, cwd=tmp_path, environment=environment)
    assert (done.status, done.out) == (2, "")
    assert done.err.endswith(": found a name that is not in euc_jp, the encoding of the locale; set PYTHONUTF8=1\n")
    assert _run("info", folder, cwd=tmp_path, environment={**environment, "PYTHONUTF8": "1"}).status == 0


def test_a_missing_package_stops_only_what_needs_it(tmp_path: Path) -> None:
    exr, tif = record(tmp_path / "exr", form="exr").folder, tmp_path / "tif"
    tif.mkdir()
    volts = np.random.default_rng(1).uniform(0.05, 0.1, (2, 2, 9, 9)).astype(np.float32)
    tifffile.imwrite(tif / "frame_0000.tif", volts, compression="zlib", photometric="minisblack")
    for missing in ("imagecodecs", "OpenEXR"):
        (tmp_path / f"{missing}.py").write_text(f"raise ModuleNotFoundError('no {missing}', name={missing!r})")
    environment = {"PYTHONPATH": os.pathsep.join((str(tmp_path), ENVIRONMENT["PYTHONPATH"]))}
    done = _run("resolve", tif, "-o", tmp_path / "out", cwd=tmp_path, environment=environment)
    assert "resolved 1 of 1 frames" in done.err
    done = _run("resolve", exr, "-o", tmp_path / "more", cwd=tmp_path, environment=environment)
    expected = "Error: unexpected ModuleNotFoundError: no OpenEXR\n`pip check` lists what cadtof lacks.\n"
    assert done == Finished(1, "", expected)
