"""Ways to spoil a file within its format: tags of TIFF, attributes of EXR, chunks of PNG, the header of NPY."""

import random
import struct
import zlib
from dataclasses import dataclass

from tests.support.fuzz.spoil import BYTES, ODD, TEXT, Spoil, number, spoiled

_TIFF_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}

_DESCRIPTION = 270


@dataclass(frozen=True)
class _Tag:
    """A tag of a page: its place in the file, and its fields."""

    place: int
    code: int
    kind: int
    count: int
    value: int


class _Tiff:
    """The pages of a TIFF file, as far as they can be followed."""

    def __init__(self, content: bytes) -> None:
        self.order = "<" if content[:2] == b"II" else ">"
        self.big = len(content) > 3 and 43 in content[2:4]
        self.entry = struct.Struct(self.order + ("HHQQ" if self.big else "HHII"))
        self.link = struct.Struct(self.order + ("Q" if self.big else "I"))
        self.counter = struct.Struct(self.order + ("Q" if self.big else "H"))
        self.tags: list[_Tag] = []
        self.pages: list[int] = []
        self.links = [8 if self.big else 4]
        self._follow(content)

    def _follow(self, content: bytes) -> None:
        try:
            (offset,) = self.link.unpack_from(content, self.links[0])
            while offset and len(self.pages) < 16 and offset not in self.pages:
                (tags,) = self.counter.unpack_from(content, offset)
                first = offset + self.counter.size
                places = range(first, first + min(tags, 64) * self.entry.size, self.entry.size)
                self.tags += [_Tag(place, *self.entry.unpack_from(content, place)) for place in places]
                self.pages.append(offset)
                self.links.append(first + tags * self.entry.size)
                (offset,) = self.link.unpack_from(content, self.links[-1])
        except (struct.error, OverflowError):
            return


def _put(content: bytes, place: int, piece: bytes) -> bytes:
    return content[:place] + piece + content[place + len(piece) :]


def tiff_tag(content: bytes, rng: random.Random) -> bytes:
    """Change what a tag says: its code, type, count or value."""
    tiff = _Tiff(content)
    if not tiff.tags:
        return content
    tag, other = rng.choice(tiff.tags), rng.choice(tiff.tags)
    code, kind, count, value = tag.code, tag.kind, tag.count, tag.value
    match rng.randrange(8):
        case 0:
            code = rng.choice((other.code, number(rng), *range(254, 285), 317, 322, 323, 324, 325, 338, 339))
        case 1:
            kind = rng.choice((*_TIFF_SIZES, 0, 14, 255))
        case 2:
            count = number(rng, count, len(content), other.count)
        case 3:
            value = other.value
        case 4:
            value = number(rng, len(content), *tiff.pages)
        case _:
            # small numbers are at the beginning of the field in both byte orders
            small = number(rng, value, tag.count) % 65536
            field = struct.pack(tiff.order + "H", small) + bytes(tiff.link.size - 2)
            (value,) = tiff.link.unpack(field)
    limit = 256**tiff.link.size
    return _put(content, tag.place, tiff.entry.pack(code % 65536, kind % 65536, count % limit, value % limit))


def tiff_values(content: bytes, rng: random.Random) -> bytes:
    """Change a value that a tag points to, such as the place of a strip or a word of a description."""
    tiff = _Tiff(content)
    long = [tag for tag in tiff.tags if _TIFF_SIZES.get(tag.kind, 1) * tag.count > tiff.link.size]
    if not long:
        return content
    tag = rng.choice(long)
    size = _TIFF_SIZES.get(tag.kind, 1)
    if tag.kind == 2 or tag.code == _DESCRIPTION:
        text = content[tag.value : tag.value + tag.count]
        new = spoiled(text, TEXT, rng)[: tag.count]
        return _put(content, tag.value, new + b" " * (len(text) - len(new)))
    place = tag.value + size * rng.randrange(tag.count)
    new_value = number(rng, len(content), *tiff.pages) % 256**size
    return _put(content, place, new_value.to_bytes(size, "little" if tiff.order == "<" else "big"))


def tiff_pages(content: bytes, rng: random.Random) -> bytes:
    """Change the list of pages: the link to a page, or the number of tags of a page."""
    tiff = _Tiff(content)
    if not tiff.pages:
        return content
    if rng.random() < 0.3:
        tags = number(rng, 10) % 256**tiff.counter.size
        return _put(content, rng.choice(tiff.pages), tiff.counter.pack(tags))
    to = rng.choice((0, number(rng, len(content)), *tiff.pages)) % 256**tiff.link.size
    return _put(content, rng.choice(tiff.links), tiff.link.pack(to))


def _exr_attributes(content: bytes) -> list[tuple[int, int]]:
    """Return the places and sizes of the values of the first header's attributes."""
    found: list[tuple[int, int]] = []
    place = 8
    while 0 < place < len(content) and content[place]:
        for _ in range(2):
            place = content.find(b"\0", place) + 1
        size = int.from_bytes(content[place : place + 4], "little")
        found.append((place + 4, size))
        place += 4 + size
        if size > len(content) or len(found) > 64:
            break
    return found


def exr_attribute(content: bytes, rng: random.Random) -> bytes:
    """Change the value of an attribute, or its stated size."""
    attributes = _exr_attributes(content)
    if not attributes:
        return content
    place, size = rng.choice(attributes)
    if rng.random() < 0.15:
        return _put(content, place - 4, struct.pack("<I", number(rng, size) % 2**32))
    if size >= 4 and rng.random() < 0.6:
        at = place + 4 * rng.randrange(size // 4)
        value = rng.choice((number(rng, 6, 8) % 2**32, 2**32 - 1 - number(rng) % 2**16))
        return _put(content, at, struct.pack("<I", value))
    return _put(content, place + rng.randrange(max(size, 1)), bytes([number(rng) % 256]))


def exr_chunk(content: bytes, rng: random.Random) -> bytes:
    """Change an entry in the table of chunks, or the header of a chunk."""
    attributes = _exr_attributes(content)
    place = sum(attributes[-1]) + 1 if attributes else 8
    at = min(place + 8 * rng.randrange(8), max(len(content) - 8, 0))
    if rng.random() < 0.5:
        return _put(content, at, struct.pack("<Q", number(rng, len(content), place)))
    to = int.from_bytes(content[at : at + 8], "little")
    if to > len(content):
        return content
    return _put(content, to + 4 * rng.randrange(6), struct.pack("<I", number(rng, 24, 48) % 2**32))


def png_chunk(content: bytes, rng: random.Random) -> bytes:
    """Change the data of a chunk and correct its check sum, or change its kind or length."""
    places, place = list[tuple[int, int]](), 8
    while place + 12 <= len(content):
        size = int.from_bytes(content[place : place + 4], "big")
        places.append((place, min(size, len(content))))
        place += 12 + size
    if not places:
        return content
    place, size = rng.choice((places[0], rng.choice(places)))
    if rng.random() < 0.2:
        return _put(content, place + rng.choice((0, 4)), struct.pack(">I", number(rng, size) % 2**32))
    body = bytearray(content[place + 4 : place + 8 + size])
    if len(body) > 4:
        at = rng.randrange(4, len(body))
        body[at] = number(rng, 6, 8, 16) % 256
    return content[: place + 4] + bytes(body) + struct.pack(">I", zlib.crc32(body)) + content[place + 12 + size :]


def npy_header(content: bytes, rng: random.Random) -> bytes:
    """Change a word of the header; then keep its length, or correct the stated length."""
    size = int.from_bytes(content[8:10], "little")
    header, rest = content[10 : 10 + size], content[10 + size :]
    new = spoiled(header, TEXT, rng)
    if rng.random() < 0.3:
        shape = rng.choice(
            (b"(0,)", b"(2, 0, 8)", b"()", b"(-1, 6, 8)", b"(4, 99999999999, 99999999999)", rng.choice(ODD).encode())
        )
        new = b"{'descr': '<u2', 'fortran_order': False, 'shape': " + shape + b", }\n"
    if rng.random() < 0.5:
        return content[:8] + struct.pack("<H", len(new) % 65536) + new + rest
    return content[:10] + (new + b" " * size)[:size] + rest


TIFF: tuple[Spoil, ...] = (tiff_tag, tiff_tag, tiff_tag, tiff_values, tiff_values, tiff_pages, *BYTES)
EXR: tuple[Spoil, ...] = (exr_attribute,) * 4 + (exr_chunk,) * 3 + BYTES
PNG: tuple[Spoil, ...] = (png_chunk,) * 6 + BYTES
NPY: tuple[Spoil, ...] = (npy_header,) * 8 + BYTES
