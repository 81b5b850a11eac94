"""All cases, and how to try one."""

from pathlib import Path

import numpy as np

from cadtof_cli.capture.frames import open_frames
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout
from tests.outside import by_imagej, by_imagemagick, by_libtiff, by_openexr, by_packages, by_tifffile
from tests.outside.cases import Case

_WRITERS = (by_tifffile, by_libtiff, by_imagemagick, by_imagej, by_packages, by_openexr)

CASES: tuple[Case, ...] = tuple(case for writer in _WRITERS for case in writer.CASES)


def tried(case: Case, folder: Path) -> str | None:
    """Write and read a case; return the message if the file is refused, None if it is read correctly.

    Raises:
        MissingWriterError: the software is not installed here.
        AssertionError: the file is read wrongly.
    """
    source = case.written(folder)
    recorded = case.recorded()
    try:
        with open_frames(source, FrameLayout((1, 2))) as frames:
            stored = frames.read(0)
    except FrameError as error:
        return str(error)
    assert (stored.shape, stored.dtype) == (recorded.shape, recorded.dtype)
    assert np.array_equal(stored, recorded), "the planes come out in another order, or with other values"
    return None
