"""Files and metadata that once broke something: each is read, or refused by its name, at once and in little memory."""

import lzma
import resource
import shutil
import time
from pathlib import Path

import pytest

from tests.support.captures import TOML, record
from tests.support.run_cadtof import Finished, cadtof, program

CORPUS = Path(__file__).parents[1] / "corpus"

NAMES = sorted(path.name.removesuffix(".xz") for path in CORPUS.glob("*.xz"))

VOLTS = ("--volts-per-count", 6e-5, "--zero-counts", 8192)


def unpacked(name: str, folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_bytes(lzma.decompress((CORPUS / f"{name}.xz").read_bytes()))
    return path


def _require_proper_message(done: Finished) -> None:
    assert done.status in {0, 1, 2}
    assert "unexpected" not in done.err
    assert "Traceback" not in done.err
    # after a semicolon, a message quotes what a library printed
    assert "Warning: " not in done.err.replace("; Warning: ", "")


@pytest.mark.parametrize("name", [name for name in NAMES if not name.endswith(".toml")])
def test_files_that_once_broke_something(name: str, tmp_path: Path) -> None:
    path, truth = unpacked(name, tmp_path / "files"), tmp_path / "out" / "frame_0.tif"
    assert cadtof("resolve", record(tmp_path / "sound").folder, "-o", tmp_path / "out", "-j", 1).status == 0
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for arguments in (
        ("info", path, "-j", 1),
        ("resolve", path, "-o", tmp_path / "new", "-j", 1, *VOLTS),
        ("inspect", path, "--pixel", "1,1", *VOLTS),
        ("evaluate", path, "--truth", truth),
        ("evaluate", truth, "--truth", path),
        ("export", path, "-o", tmp_path / "new.npz"),
        ("preview", path, "-o", tmp_path / "new.png"),
    ):
        done = cadtof(*arguments)
        _require_proper_message(done)
        assert done.status == 0 or str(path) in done.err
    # of the processor, because the machine may be busy or slow
    assert time.process_time() - began < 30
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 150 * 1024


def test_a_library_that_prints_does_not_break_json(tmp_path: Path) -> None:
    path = unpacked("prints.exr", tmp_path)
    done = program("resolve", path, "-o", tmp_path / "new", "-j", 2, "--json", "-q")
    assert done.out.startswith('{"source": ')
    assert done.out.count("\n") == 1


FILES = {
    "amplitude.toml": "pulse.fwhm_ns: found 1e+39, expected 39.4 or less: a longer pulse leaves nothing of a modulation of 20 ns",
    "deep.toml": "not valid TOML: tables or lists are nested hundreds of levels deep",
    "int.toml": "not valid TOML: a number with thousands of digits, or an impossible date",
}

TABLES = {
    f"[modulation]\namplitude_v = 1{'0' * 400}\n": "modulation.amplitude_v: found 100000",
    "[modulation]\namplitude_v = 1e-300\n": "modulation.amplitude_v: found 1e-300, expected a number from 1e-06 to 1e+06",
    "[modulation]\nperiods_ns = [1e-300, 5e-301]\n": "modulation.periods_ns: found 1e-300, expected a number from 0.001",
    "[modulation]\nperiods_ns = [1e308, 1e-308]\n": "modulation.periods_ns: found 1e+308, expected a number from",
    "[modulation]\nperiods_ns = [40.0, 0.004]\n[pulse]\nfwhm_ns = 0\n": "modulation.periods_ns: found [40.0, 0.004]",
    "[pulse]\nfwhm_ns = 400\n": "pulse.fwhm_ns: found 400.0, expected 39.4 or less",
    '[pulse]\nfwhm_ns = 400\n[modulation]\nwaveform = "triangle"\n': "pulse.fwhm_ns: found 400.0, expected 39.4 or less",
    "[layout.raw]\ndtype = ',,,'\nshape = [2, 2]\n": "layout.raw_dtype: found ',,,', expected a type such as uint16",
    "[layout.raw]\ndtype = '(99999999,99999999)u2'\nshape = [2, 2]\n": "layout.raw_dtype: found '(99999999,99999999)u2'",
    f"[layout]\nharmonic = {'{a = ' * 300}1{'}' * 300}\n": "layout.harmonic: found {'a': {'a': ",
    f"[{'a' * 5000}]\n": "unknown table [aaaa",
}


@pytest.mark.parametrize(
    "command", ["resolve cap -o new -j 1", "info cap", "inspect cap --pixel 1,1", "calibrate dark cap -o new"]
)
def test_metadata_that_once_broke_something(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = record(tmp_path / "cap")
    monkeypatch.chdir(tmp_path)
    for name, message in FILES.items():
        shutil.move(unpacked(name, tmp_path), capture.folder / "capture.toml")
        done = cadtof(*command.split())
        assert (done.status, done.err) == (2, f"Error: cap/capture.toml: {message}\n")
    for table, message in TABLES.items():
        (capture.folder / "capture.toml").write_text(table)
        done = cadtof(*command.split())
        assert done.status == 2
        assert done.err.startswith(f"Error: cap/capture.toml: {message}")
        assert len(done.err) < 6000
    assert not (tmp_path / "new").exists()


def test_values_that_no_camera_has_are_refused_as_options(tmp_path: Path) -> None:
    capture = record(tmp_path / "cap", toml=TOML["tif"])
    for options in (
        ("--fwhm", "400"),
        ("--amplitude", "1e-300"),
        ("--periods", "1e-300,5e-301"),
        ("--amplitude", "9" * 400),
    ):
        done = cadtof("resolve", capture.folder, "-o", tmp_path / "new", "-j", 1, *options)
        assert done.status == 2
        assert "Error: " in done.err
        _require_proper_message(done)


@pytest.mark.parametrize(
    "command", ["resolve cap", "calibrate dark cap", "calibrate petzval cap", "export cap", "preview cap"]
)
def test_a_required_option_that_is_missing_is_named(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(tmp_path / "cap")
    monkeypatch.chdir(tmp_path)
    done = cadtof(*command.split())
    assert done.status == 2
    assert "Error: Missing option '-o' / '--out'." in done.err
