"""Whatever a library raises on a damaged file becomes one FrameError that names the file."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cadtof_cli.errors import FrameError

PLAUSIBLE_BYTES = 2**26
PLAUSIBLE_RATIO = 4096
"""A header may promise this many bytes, or this many times the size of its file. More is a flipped bit, not a picture:
deflate reaches a ratio of 1,032, and a frame of a megapixel holds 16 to 32 MB."""


@contextmanager
def damage_as_frame_error(path: Path, kind: str) -> Iterator[None]:
    """Turn what reading raises into a FrameError; wrap the calls of a reading library, never a caller's work.

    The libraries promise nothing about damaged input: ValueError, TypeError, KeyError, ZeroDivisionError, struct.error,
    zlib.error, RuntimeError and more have been seen.
    """
    try:
        with warnings.catch_warnings():
            # what a library only remarks on says nothing about the pixels; what does is asked of them
            warnings.simplefilter("ignore")
            yield
    except FrameError:
        raise
    except OSError as error:
        raise FrameError(f"{path}: cannot be read: {error.strerror or error}") from error
    except MemoryError as error:
        raise FrameError(f"{path}: not enough memory for the {kind} image that its header describes") from error
    except UnicodeDecodeError as error:
        raise FrameError(f"{path}: damaged {kind}: a name in it is no UTF-8; expected a complete file") from error
    except Exception as error:
        words = str(error) or f"the library stopped with {type(error).__name__}"
        raise FrameError(f"{path}: damaged {kind}: {words}; expected a complete file, try copying it again") from error


def require_plausible_size(path: Path, promised: int, file_size: int) -> None:
    """Refuse a header that promises more bytes than its file can hold, before they are allocated."""
    if promised > max(PLAUSIBLE_BYTES, PLAUSIBLE_RATIO * file_size):
        raise FrameError(
            f"{path}: damaged header: promises {promised:,} bytes of pixels, found a file of {file_size:,} bytes"
        )
