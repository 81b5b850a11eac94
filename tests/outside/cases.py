"""One case of the matrix: which software writes which file, and how a reader must answer."""

import importlib.util
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource
from tests.files.forms import known_frame
from tests.support.captures import PLANE_NAMES
from tests.support.outside_tools import MAKERS, outside_tool, run_among

Writer = Callable[[Path, Stored], Path | tuple[Path, ...]]
"""Writes a frame (H, C, Y, X) into an empty folder; returns its one file, or its planes' files in order."""


class MissingWriterError(Exception):
    """The software that writes the file is not installed here."""


@dataclass(frozen=True)
class Case:
    """One file, or the files of one frame, by one writer.

    Attributes:
        writer: the software, as the table names it.
        form: how the software is asked to write.
        write: writes the file.
        dtype: type of the values that the software gets.
        refused: words of the message, if the file does not say which plane is which or holds no voltages; None if
            every value must be read back bit for bit.
    """

    writer: str
    form: str
    write: Writer
    dtype: DTypeLike = "u2"
    refused: str | None = None

    def recorded(self) -> Stored:
        """Return the frame that is written: 2 harmonics, 2 channels, 37 × 53 pixels, no two planes alike."""
        return known_frame(self.dtype)

    def written(self, folder: Path) -> FrameSource:
        """Write the frame and return its files as a source.

        Raises:
            MissingWriterError: the software is not installed.
        """
        with warnings.catch_warnings():
            # warnings of other software do not concern these tests
            warnings.simplefilter("ignore")
            files = self.write(folder, self.recorded())
        return FrameSource("frame", files if isinstance(files, tuple) else (files,))


def planes_of(frame: Stored) -> list[Stored]:
    """Return the planes of a frame in order."""
    return [np.ascontiguousarray(plane) for plane in frame.reshape(-1, *frame.shape[2:])]


def named_planes(frame: Stored) -> dict[str, Stored]:
    """Return the planes of a frame by name."""
    return dict(zip(PLANE_NAMES, planes_of(frame), strict=True))


SHUFFLED = ("H2.SC1", "H1.SC2", "H2.SC2", "H1.SC1")
"""Names of the planes in another order than ours: no plane keeps its place."""


def shuffled_planes(frame: Stored) -> list[Stored]:
    """Return the planes of a frame in the order of `SHUFFLED`."""
    planes = named_planes(frame)
    return [planes[name] for name in SHUFFLED]


def run(*command: str | Path) -> None:
    """Run a program of another maker; if it fails, the case fails."""
    program = outside_tool(str(command[0]), os.environ.get("PATH", os.defpath))
    if program is None:
        raise MissingWriterError(f"{MAKERS[str(command[0])].name} is not installed")
    run_among(program, *command[1:]).check_returncode()


def need(module: str) -> None:
    """Raise MissingWriterError if a Python package is not installed."""
    if importlib.util.find_spec(module) is None:
        raise MissingWriterError(f"the Python package {module} is not installed")
