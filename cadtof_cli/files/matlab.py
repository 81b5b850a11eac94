"""Files of MATLAB. They are refused, because their arrays have any name and any order of axes.

The message says how to save such an array in a file that we read.
"""

from pathlib import Path

from cadtof_cli.errors import FrameError, require_memory_for_scipy
from cadtof_cli.files.axis_orders import transpositions
from cadtof_cli.files.reading import damage_as_frame_error

_VERSION_7_3 = b"MATLAB 7.3 MAT-f"
"""First bytes of the files that are HDF5, which h5py reads and scipy does not."""

_HARMONICS = (2, 3, 4)
_LEAST_AXES = 3


def matlab_refusal(path: Path, head: bytes, /) -> FrameError:
    """Return the error that says how an array of a MATLAB file, which begins with `head`, can be saved as a frame."""
    saved = repr(str(path.with_suffix(".npy")))
    if head.startswith(_VERSION_7_3):
        how = (
            f"numpy.save({saved}, h5py.File({str(path)!r})['NAME'][()].swapaxes(-1, -2)) saves what MATLAB calls"
            " NAME(row, column, channel, harmonic)"
        )
    else:
        how = _saving(path, saved)
    return FrameError(f"{path}: found a MATLAB file, expected its array in a format that is read here: {how}")


def _saving(path: Path, saved: str) -> str:
    """Return how to save the first array of a file that has enough axes for a frame."""
    require_memory_for_scipy()
    import scipy.io

    with damage_as_frame_error(path, "MATLAB"):
        arrays = [(name, shape) for name, shape, _ in scipy.io.whosmat(path) if len(shape) >= _LEAST_AXES]
    for name, shape in arrays:
        call = f"numpy.save({saved}, scipy.io.loadmat({str(path)!r})[{name!r}]"
        ways = (transpositions((call, ")"), shape, harmonics) for harmonics in _HARMONICS)
        return next(filter(None, ways), f"{call}), with axes [T] H C Y X")
    return "no array in it has three axes or more, but a frame has harmonics, channels, rows and columns"
