"""Text that the OpenEXR library prints is caught; text that others print at the same time is not."""

import gc
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from cadtof_cli.files.library_output import library_output
from tests.support.run_cadtof import ENVIRONMENT


def _print_like_the_library() -> None:
    os.write(2, b"/data/a.exr: (EXR_ERR_BAD_CHUNK_LEADER) found corrupt leader\n")
    sys.stdout.write("Warning: Exception raised reading pixel data for part 0\n")


def _print_and_fail() -> None:
    with library_output():
        _print_like_the_library()
        raise RuntimeError("no parts")


def test_lines_on_both_streams_are_kept_from_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    with library_output() as lines:
        _print_like_the_library()
    assert lines == [
        "/data/a.exr: (EXR_ERR_BAD_CHUNK_LEADER) found corrupt leader",
        "Warning: Exception raised reading pixel data for part 0",
    ]
    assert capfd.readouterr() == ("", "")


def test_streams_are_restored_after_an_exception(capfd: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout
    with pytest.raises(RuntimeError, match="no parts"):
        _print_and_fail()
    assert sys.stdout is before
    os.write(2, b"heard\n")
    os.write(1, b"seen\n")
    assert capfd.readouterr() == ("seen\n", "heard\n")


def test_no_descriptor_is_left_open() -> None:
    def descriptors() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    # close files that objects of failed tests still hold
    gc.collect()
    before = descriptors()
    for _ in range(10):
        with library_output():
            _print_like_the_library()
    assert descriptors() == before


def test_output_of_the_library_is_caught_while_another_thread_runs(capfd: pytest.CaptureFixture[str]) -> None:
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    with library_output() as lines:
        _print_like_the_library()
    done.set()
    thread.join()
    assert len(lines) == 2
    assert capfd.readouterr() == ("", "")


def test_what_the_library_prints_on_standard_output_is_kept_from_a_pipeline(capfd: pytest.CaptureFixture[str]) -> None:
    with library_output() as lines:
        os.write(1, b"ojph error 0x00050044 at ojph_codestream_local.cpp:700: a tile is missing\n")
    assert lines == ["ojph error 0x00050044 at ojph_codestream_local.cpp:700: a tile is missing"]
    os.write(1, b'{"status": "failed"}\n')
    assert capfd.readouterr() == ('{"status": "failed"}\n', "")


@pytest.mark.skipif(sys.platform == "win32", reason="C's streams are found by another name there")
def test_output_in_the_buffer_of_c_is_caught_in_time() -> None:
    script = """
import ctypes
from cadtof_cli.files.library_output import library_output
ctypes.CDLL(None).puts(b"before")
with library_output() as lines:
    ctypes.CDLL(None).puts(b"ojph info 0x00030067: File terminated early")
assert lines == ["ojph info 0x00030067: File terminated early"], lines
"""
    done = subprocess.run([sys.executable, "-c", script], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "before\n", "")


def test_lines_that_another_thread_prints_are_passed_on(capfd: pytest.CaptureFixture[str]) -> None:
    inside, written = threading.Event(), threading.Event()

    def another() -> None:
        inside.wait(5)
        os.write(2, b"\r 12 of 200 frames")
        sys.stdout.write("a line of data\n")
        os.write(1, b'{"status": "ok"}\n')
        written.set()

    thread = threading.Thread(target=another)
    thread.start()
    with library_output() as lines:
        inside.set()
        assert written.wait(5)
        os.write(1, b"ojph warning: something\n")
    thread.join()
    assert lines == ["ojph warning: something"]
    assert capfd.readouterr() == ('a line of data\n{"status": "ok"}\n', "\r 12 of 200 frames")
