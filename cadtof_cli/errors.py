"""Errors that a user can mend. Every message says what was found, what was expected, and where."""

import sys

SCIPY_BYTES = 2**27
"""Size of the memory that the first module of scipy takes when it is imported."""


class CadtofError(Exception):
    """Base of all errors that reach a user as one message; `exit_status` is what the process ends with."""

    exit_status = 2


class SettingsError(CadtofError):
    """An option, or a combination of options, that cannot be carried out."""


def require(holds: bool, name: str, found: object, expected: str) -> None:
    """Raise a SettingsError about the setting `name`, unless the condition `holds`."""
    if not holds:
        raise SettingsError(f"{name}: found {found}, expected {expected}")


def require_memory_for_scipy() -> None:
    """Raise MemoryError if memory is too short to import a module of scipy.

    The linear algebra of scipy (OpenBLAS) would ask for its memory again and again without end. Only SIGKILL ends that.
    """
    if "scipy" not in sys.modules:
        import numpy as np

        np.empty(SCIPY_BYTES, np.uint8)


class MetadataError(CadtofError):
    """A `capture.toml` or `calibration` file, or a key in it, that is missing, malformed or impossible."""


class CaptureError(CadtofError):
    """An input that holds no frames, or whose frames do not belong together."""


class UnlistedError(CaptureError):
    """A folder that the system does not list, so nobody knows whether it holds frames."""


class FrameError(CadtofError):
    """One frame that cannot be read or resolved; the run goes on with the other frames."""

    exit_status = 1


class UnreadableError(FrameError):
    """A frame that the system did not let us read, or that memory was too short for: nothing is known about its content."""


def no_memory_for(frame: object) -> UnreadableError:
    """Return the error for a frame that memory was too short for."""
    return UnreadableError(f"{frame}: not enough memory for a frame of this size: try fewer --jobs, or more memory")


class NoiseError(FrameError):
    """A frame whose noise is needed, but is neither given nor seen in the frame. The message names no frame."""


class OutputError(CadtofError):
    """A place that cannot be written, or that holds files a run would replace."""


class PlaceError(OutputError):
    """A place that takes no file of any name: it is full, read-only, or gone."""


class RunStoppedError(PlaceError):
    """A run that ended before its last frame, because its place takes no more maps or no more lines of the record.

    The maps finished until then are there.
    """

    exit_status = 1


class WorkersError(CadtofError):
    """Processes that cannot be started."""


class ClusterError(CadtofError):
    """A cluster that cannot do what was asked, or is lost. The results that it has delivered are kept."""

    exit_status = 1
