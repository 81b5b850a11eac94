"""Files of named arrays: MATLAB's, HDF5 and NPZ. They are refused, because their arrays have any name and any order of axes.

The message says how to save such an array in a file that we read.
"""

import io
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from cadtof_cli.errors import FrameError, require_memory_for_scipy
from cadtof_cli.files.axis_orders import transpositions
from cadtof_cli.files.npy import read_header
from cadtof_cli.files.reading import damage_as_frame_error

SUFFIXES = (".mat", ".h5", ".hdf5", ".npz")
"""Suffixes of files of named arrays."""

_HARMONICS = (2, 3, 4)
_LEAST_AXES = 3

_LONGEST_HEADER = 2048
"""Number of bytes of an array in an NPZ file that are read: more than its header has."""

_AS_IT_IS = "with axes [T] H C Y X"


def named_arrays_refusal(path: Path, head: bytes, /) -> FrameError | None:
    """Return the error that says how an array of a file of named arrays, which begins with `head`, can be saved as a frame.

    None: the file is of another kind.
    """
    kind = next((kind for first, kind in _KINDS.items() if head.startswith(first)), None)
    if kind is None:
        return None
    what, how = kind
    saved = repr(str(path.with_suffix(".npy")))
    told = how(path, f"numpy.save({saved}, ")
    if not told:
        return None
    return FrameError(f"{path}: found {what}, expected its array in a format that is read here: {told}")


def _of_matlab(path: Path, save: str) -> str:
    require_memory_for_scipy()
    import scipy.io

    with damage_as_frame_error(path, "MATLAB"):
        shapes = [(name, shape) for name, shape, _ in scipy.io.whosmat(path)]
    return _saving(f"{save}scipy.io.loadmat({str(path)!r})", shapes)


def _of_matlab_in_hdf5(path: Path, save: str) -> str:
    return (
        f"{save}h5py.File({str(path)!r})['NAME'][()].swapaxes(-1, -2)) saves what MATLAB calls NAME(row, column, channel, "
        "harmonic)"
    )


def _of_hdf5(path: Path, save: str) -> str:
    return f"{save}h5py.File({str(path)!r})['NAME'][()]), {_AS_IT_IS}, saves the dataset NAME"


def _of_npz(path: Path, save: str) -> str:
    """Return an empty text if the file is another zip file."""
    with damage_as_frame_error(path, "NPZ"), zipfile.ZipFile(path) as archive:
        arrays = [member for member in archive.namelist() if member.endswith(".npy")]
        return _saving(f"{save}numpy.load({str(path)!r})", _shapes(archive, arrays)) if arrays else ""


def _shapes(archive: zipfile.ZipFile, arrays: Iterable[str]) -> Iterator[tuple[str, tuple[int, ...]]]:
    for member in arrays:
        with archive.open(member) as file:
            # a header may say that it has gigabytes
            yield member.removesuffix(".npy"), read_header(io.BytesIO(file.read(_LONGEST_HEADER)))[0]


def _saving(load: str, shapes: Iterable[tuple[str, tuple[int, ...]]]) -> str:
    """Return how to save the first array that has enough axes for a frame; `load` is the call that loads all arrays."""
    for name, shape in shapes:
        if len(shape) >= _LEAST_AXES:
            call = f"{load}[{name!r}]"
            ways = (transpositions((call, ")"), shape, harmonics) for harmonics in _HARMONICS)
            return next(filter(None, ways), f"{call}), {_AS_IT_IS}")
    return "no array in it has three axes or more, but a frame has harmonics, channels, rows and columns"


_KINDS: Mapping[bytes, tuple[str, Callable[[Path, str], str]]] = {
    b"MATLAB 7.3 MAT-f": ("a MATLAB file", _of_matlab_in_hdf5),
    b"MATLAB ": ("a MATLAB file", _of_matlab),
    b"\x89HDF\r\n\x1a\n": ("an HDF5 file", _of_hdf5),
    b"PK\x03\x04": ("an NPZ file", _of_npz),
}
"""What a file with these first bytes is, and what says how to save one of its arrays. h5py reads HDF5, also that of MATLAB
7.3; scipy does not."""
