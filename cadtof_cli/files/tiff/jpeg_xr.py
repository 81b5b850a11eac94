"""Checks of JPEG XR data before it is decoded, because its library ends the process at some damaged headers."""

from pathlib import Path

from cadtof_cli.errors import FrameError
from cadtof_cli.files.system import read_at
from cadtof_cli.files.tiff.pages import Page

COMPRESSIONS = frozenset({22610, 34934})
"""Codes of JPEG XR among the compressions of TIFF."""

BEGIN = b"WMPHOTO\0"
"""First bytes of the picture's header."""

_COLOURS_BYTE = len(BEGIN) + 3
"""Place of the byte whose upper four bits say how colours are stored (ITU-T T.832, 8.3.12)."""

_WITH_COARSE_COLOURS = frozenset({1, 2})
"""YUV 4:2:0 and YUV 4:2:2, whose colours have fewer pixels than their brightness. No plane of voltages is stored so."""

_SEARCHED_BYTES = 4096
"""Number of first bytes in which the header of the picture begins, after a table of facts about it."""


def require_plain_colours(path: Path, page: Page, descriptor: int, /) -> None:
    """Raise FrameError if a strip or tile of a page declares colours with fewer pixels than its brightness.

    The library would write beyond the memory of a grey picture.
    """
    for offset, count in zip(page.dataoffsets, page.databytecounts, strict=False):
        data = read_at(descriptor, min(count, _SEARCHED_BYTES), offset)
        header = data[max(data.find(BEGIN), 0) :]
        if header[_COLOURS_BYTE:] and header[_COLOURS_BYTE] >> 4 in _WITH_COARSE_COLOURS:
            raise FrameError(f"{path}: damaged TIFF: its JPEG XR data declares YUV colours, expected one value a pixel")
