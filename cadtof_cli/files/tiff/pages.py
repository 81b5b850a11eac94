"""Checks of a TIFF's pages before a pixel is read, because tifffile fills missing data with zeros."""

import math
import struct
from pathlib import Path
from typing import NamedTuple

import tifffile

from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import SAMPLE_TYPES
from cadtof_cli.files.reading import in_brief
from cadtof_cli.files.system import read_at

MAX_TAGS = 4096
"""Most tags of a page, the limit of tifffile; a page with more tags is damaged."""

LOOKED_INTO = 64
"""Number of first pages that are checked one by one; a file with more pages is a stack, whose pages are alike."""

Page = tifffile.TiffPage | tifffile.TiffFrame


_VALUE_BYTES = {3: 2, 4: 4, 5: 8, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
"""Bytes of one value by the type code of its tag; types that are not listed take one byte."""


class _Form(NamedTuple):
    """How the numbers of a TIFF file are packed.

    Attributes:
        first: the byte at which the position of the first page is stored.
        tags: the number of tags of a page.
        tag: one tag: code, type, number of values, and the position of the values.
        link: the position of a page.
    """

    first: int
    tags: struct.Struct
    tag: struct.Struct
    link: struct.Struct


_FORMS = {
    (order, big): _Form(
        8 if big else 4,
        struct.Struct(order + ("Q" if big else "H")),
        struct.Struct(order + ("HHQQ" if big else "HHII")),
        struct.Struct(order + ("Q" if big else "I")),
    )
    for order in "<>"
    for big in (False, True)
}
"""Forms of a TIFF file, by its byte order and by whether it is a BigTIFF."""


def require_sound_chain(path: Path, descriptor: int, size: int) -> None:
    """Follow the linked list of an open file's pages to the last; raise FrameError unless all of it lies within the file.

    tifffile reads a list that breaks off as a shorter list. If a list returns to an earlier page, tifffile can follow
    it until the memory is full.
    """
    header = read_at(descriptor, 4, 0)
    form = _FORMS["<" if header[:2] == b"II" else ">", 43 in header[2:]]
    seen: set[int] = set()
    (offset,) = form.link.unpack(read_at(descriptor, form.link.size, form.first))
    if not offset:
        raise FrameError(f"{path}: damaged TIFF: it ends before its first page; expected a complete file")
    while offset:
        if offset in seen:
            raise FrameError(f"{path}: damaged TIFF: page {len(seen)} points back to an earlier page")
        begin = offset + form.tags.size
        (tags,) = form.tags.unpack(read_at(descriptor, form.tags.size, offset)) if begin <= size else (0,)
        end = begin + tags * form.tag.size
        if not 0 < tags <= MAX_TAGS or end + form.link.size > size:
            raise FrameError(
                f"{path}: damaged or truncated TIFF: page {len(seen)} should begin at byte {offset:,},"
                f" found no page there in a file of {size:,} bytes"
            )
        if len(seen) < LOOKED_INTO:
            _require_values_within(path, len(seen), form, read_at(descriptor, end - begin, begin), size)
        seen.add(offset)
        (offset,) = form.link.unpack(read_at(descriptor, form.link.size, end))


def _require_values_within(path: Path, page: int, form: _Form, tags: bytes, size: int) -> None:
    """Check that the values of a page's tags lie within the file.

    Some software knows the axes only at the end of a recording and writes them at the end of the file. If that end is
    lost, the planes would be read in another order.
    """
    for code, kind, count, offset in form.tag.iter_unpack(tags):
        length = _VALUE_BYTES.get(kind, 1) * count
        if length > form.link.size and offset + length > size:
            raise FrameError(
                f"{path}: damaged or truncated TIFF: tag {code} of page {page} reaches to byte {offset + length:,},"
                f" found a file of {size:,} bytes"
            )


def require_sound_page(path: Path, page: Page, keyframe: tifffile.TiffPage, file_size: int) -> None:
    """Raise FrameError unless all strips or tiles of a page are present and lie within the file."""
    needed = math.prod(keyframe.chunked)
    segments = list(zip(page.dataoffsets, page.databytecounts, strict=False))
    sound = sum(1 for offset, count in segments[:needed] if offset > 0 and count > 0)
    if sound < needed:
        raise FrameError(f"{path}: damaged TIFF: page {page.index} has {sound} strips or tiles, expected {needed}")
    end = max(offset + count for offset, count in segments)
    if end > file_size:
        raise FrameError(
            f"{path}: truncated TIFF: page {page.index} reaches to byte {end:,}, found a file of {file_size:,} bytes"
        )


def require_sound_keyframe(path: Path, page: tifffile.TiffPage, *, stored_bytes: int) -> None:
    """Raise FrameError for samples or a compression that we do not read, or too many or too few bytes of pixels.

    The first `page` of a series describes all its pages. `stored_bytes` is what its strips must take if they are not
    compressed: the size of one page, or of the whole series if this page stands for all pages.
    """
    if page.dtype is None or page.dtype.name not in SAMPLE_TYPES or page.bitspersample != page.dtype.itemsize * 8:
        found = f"{page.bitspersample} bits a sample, sample format {int(page.sampleformat)}"
        raise FrameError(f"{path}: found {found}, expected one of {', '.join(SAMPLE_TYPES)}")
    if page.compression != 1:
        _require_known_compression(path, page)
        return
    expected = stored_bytes
    if page.tile is not None:
        samples = page.samplesperpixel if page.planarconfig == 1 else 1
        expected = math.prod(page.chunked) * math.prod(page.tile) * samples * page.dtype.itemsize
    found_bytes = sum(page.databytecounts)
    if found_bytes not in (expected, page.nbytes if page.tile is None else expected):
        raise FrameError(
            f"{path}: damaged TIFF: page {page.index} of {page.imagewidth} × {page.imagelength} {page.dtype.name}"
            f" claims to take {found_bytes:,} bytes, expected {expected:,}"
        )


def _require_known_compression(path: Path, page: tifffile.TiffPage) -> None:
    try:
        tifffile.TIFF.DECOMPRESSORS[page.compression]
    except KeyError as error:
        raise FrameError(
            f"{path}: its compression cannot be read here ({in_brief(error.args)}); expected none, deflate, LZW or Zstandard:"
            " rewrite it, such as by tiffcp -c zip"
        ) from error


def lies_in_one_run(page: Page, keyframe: tifffile.TiffPage) -> bool:
    """Return whether the pixels of a page lie in the file without gaps, in the order and form of arrays in memory."""
    if not keyframe.is_final:
        return False
    ends = [offset + count for offset, count in zip(page.dataoffsets, page.databytecounts, strict=False)]
    return ends[:-1] == list(page.dataoffsets[1:])
