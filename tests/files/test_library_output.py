"""What the OpenEXR library prints is caught; what others print meanwhile is not."""

import os
import sys
import threading
from pathlib import Path

import pytest

from cadtof_cli.files.exr.library_output import library_output


def _print_like_the_library() -> None:
    os.write(2, b"/data/a.exr: (EXR_ERR_BAD_CHUNK_LEADER) found corrupt leader\n")
    sys.stdout.write("Warning: Exception raised reading pixel data for part 0\n")


def _print_and_fail() -> None:
    with library_output():
        _print_like_the_library()
        raise RuntimeError("no parts")


def test_lines_on_both_streams_are_kept_from_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    with library_output() as said:
        _print_like_the_library()
    assert said == [
        "/data/a.exr: (EXR_ERR_BAD_CHUNK_LEADER) found corrupt leader",
        "Warning: Exception raised reading pixel data for part 0",
    ]
    assert capfd.readouterr() == ("", "")


def test_streams_are_back_after_an_exception(capfd: pytest.CaptureFixture[str]) -> None:
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

    before = descriptors()
    for _ in range(10):
        with library_output():
            _print_like_the_library()
    assert descriptors() == before


def test_progress_of_another_thread_is_passed_on(capfd: pytest.CaptureFixture[str]) -> None:
    reading, shown, sorted_out = threading.Event(), threading.Event(), threading.Event()

    def show_progress() -> None:
        reading.wait()
        os.write(2, b"\r 12 of 200 frames")
        sys.stdout.write("a line of data\n")
        shown.set()
        sorted_out.wait()

    thread = threading.Thread(target=show_progress)
    thread.start()
    with library_output() as said:
        reading.set()
        shown.wait()
    sorted_out.set()
    thread.join()
    assert said == []
    assert capfd.readouterr() == ("a line of data\n", "\r 12 of 200 frames")


def test_library_is_heard_while_another_thread_runs(capfd: pytest.CaptureFixture[str]) -> None:
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    with library_output() as said:
        _print_like_the_library()
    done.set()
    thread.join()
    assert len(said) == 2
    assert capfd.readouterr() == ("", "")
