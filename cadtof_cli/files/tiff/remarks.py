"""Turns what tifffile raises and logs on a damaged file, and what the libraries of its codecs print, into FrameErrors."""

import contextlib
import logging
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import tifffile

from cadtof_cli.errors import FrameError
from cadtof_cli.files.reading import damage_as_frame_error, in_brief
from cadtof_cli.files.tiff import jpeg_xr

_PRINTING = jpeg_xr.COMPRESSIONS | {34933}
"""Compressions whose libraries print their remarks on a damaged page: JPEG XR and PNG."""

_PRIVATE_TAG_MESSAGE = r"TiffTag (?:3[3-9]\d{3}|[4-9]\d{4})\b"
"""Pattern of messages about private tags, which manufacturers define."""


class _Remarks:
    """Keeps the errors that tifffile logs while one of our threads reads, and keeps all its messages off the terminal.

    After an error, tifffile continues with a guess, such as fewer strips or a simpler order of pages. For us such a
    file is damaged. We replace methods of tifffile's logger and do not add a filter, because programs often silence
    that logger, or all loggers, and then no filter is called.
    """

    def __init__(self, log: logging.Logger) -> None:
        self.kept = threading.local()
        self._is_enabled_for, self._handle = log.isEnabledFor, log.handle
        vars(log).update(isEnabledFor=self._is_wanted, handle=self._keep)

    def _is_wanted(self, level: int) -> bool:
        return getattr(self.kept, "errors", None) is not None or self._is_enabled_for(level)

    def _keep(self, record: logging.LogRecord) -> None:
        errors: list[str] | None = getattr(self.kept, "errors", None)
        if errors is None:
            self._handle(record)
        elif record.levelno >= logging.ERROR and not re.search(_PRIVATE_TAG_MESSAGE, record.getMessage()):
            errors.append(record.getMessage())


_remarks = _Remarks(logging.getLogger("tifffile"))


@contextlib.contextmanager
def reading_tiff(path: Path) -> Iterator[None]:
    """Turn everything that tifffile raises in the block, and every error that it logs, into a FrameError."""
    errors: list[str] = []
    _remarks.kept.errors = errors
    try:
        with damage_as_frame_error(path, "TIFF"):
            yield
            if errors:
                raise FrameError(f"{path}: damaged TIFF: {in_brief(errors)}")
    finally:
        _remarks.kept.errors = None


@contextlib.contextmanager
def decoding(path: Path, page: tifffile.TiffPage) -> Iterator[None]:
    """Turn everything that is raised, logged as an error or printed while pages like this one are decoded into a FrameError."""
    with reading_tiff(path):
        if page.compression not in _PRINTING:
            yield
            return
        # imported here because few compressions need it
        from cadtof_cli.files.library_output import library_output

        with library_output() as printed:
            yield
        if printed:
            raise FrameError(f"{path}: damaged TIFF: {in_brief(printed)}")
