"""Ways to spoil bytes and text of any format."""

import random
import re
from collections.abc import Callable

Spoil = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    0,
    1,
    2,
    3,
    7,
    127,
    128,
    255,
    256,
    4095,
    32767,
    32768,
    65535,
    65536,
    2**24,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63,
)
"""Numbers at the limits of types and sizes."""

_PIECE = 4096
"""Longest stretch in bytes that one change overwrites or repeats."""


def number(rng: random.Random, *near: int) -> int:
    """Draw a number at or next to one of `NUMBERS`, or of the numbers `near`, which mean something in this place."""
    chosen = rng.choice((*NUMBERS, *near, *near))
    return max(0, chosen + rng.choice((0, 0, 0, -1, 1, 2)))


def bit(content: bytes, rng: random.Random) -> bytes:
    """Turn a bit."""
    place = rng.randrange(len(content))
    return content[:place] + bytes([content[place] ^ 1 << rng.randrange(8)]) + content[place + 1 :]


def head(content: bytes, rng: random.Random) -> bytes:
    """Change one of the first few hundred bytes, where most formats have their header."""
    place = rng.randrange(min(len(content), 400))
    return content[:place] + bytes([rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))]) + content[place + 1 :]


def word(content: bytes, rng: random.Random) -> bytes:
    """Write a number over 1, 2, 4 or 8 bytes, in either byte order."""
    size = rng.choice((1, 2, 4, 8))
    place = rng.randrange(len(content))
    value = number(rng, len(content)) % (1 << 8 * size)
    return content[:place] + value.to_bytes(size, rng.choice(("little", "big"))) + content[place + size :]


def end(content: bytes, rng: random.Random) -> bytes:
    """Cut off the end."""
    return content[: rng.randrange(len(content))]


def begin(content: bytes, rng: random.Random) -> bytes:
    """Cut off the beginning."""
    return content[rng.randrange(min(len(content), 64)) :]


def zeros(content: bytes, rng: random.Random) -> bytes:
    """Write zeros over a stretch, as a disk may do."""
    place = rng.randrange(len(content))
    size = min(len(content) - place, rng.choice((4, 16, 64, 512, _PIECE)))
    return content[:place] + bytes(size) + content[place + size :]


def without(content: bytes, rng: random.Random) -> bytes:
    """Take a stretch out."""
    place = rng.randrange(len(content))
    return content[:place] + content[place + rng.choice((1, 2, 4, 12, 64, 512)) :]


def twice(content: bytes, rng: random.Random) -> bytes:
    """Write a stretch twice, or more often."""
    place = rng.randrange(len(content))
    piece = content[place : place + rng.choice((1, 4, 12, 64, _PIECE))]
    return (
        content[:place]
        + piece * rng.choice((2, 3, max(2, _PIECE // max(len(piece), 1))))
        + content[place + len(piece) :]
    )


def moved(content: bytes, rng: random.Random) -> bytes:
    """Write a stretch where another was."""
    first, second = rng.randrange(len(content)), rng.randrange(len(content))
    piece = content[first : first + rng.choice((2, 4, 8, 12, 64))]
    return content[:second] + piece + content[second + len(piece) :]


BYTES: tuple[Spoil, ...] = (bit, bit, head, head, word, word, end, begin, zeros, without, twice, moved)

_TOKEN = re.compile(r"\"(?:\\.|[^\"\\\n])*\"|'[^'\n]*'|[\w.+-]+|[^\w\s]")

ODD = (
    *(
        "",
        "0",
        "-1",
        "1e-300",
        "1e300",
        "1e39",
        "-0.0",
        "nan",
        "inf",
        "-inf",
        "1.0000000000000002",
        "1e15",
        "1e-15",
        "1_000",
    ),
    *(
        "65536",
        "2147483648",
        "18446744073709551616",
        "5" * 5000,
        "1" + "0" * 400,
        "0x7fffffffffffffff",
        "[1e308, -1e308]",
    ),
    *(
        "true",
        "null",
        "None",
        "[]",
        "{}",
        '""',
        "''",
        "x",
        "2020-01-01",
        "1979-05-27T07:32:00Z",
        "25:61:61",
        "a" * 300,
        "é",
    ),
    *("[[[[[]]]]]", "[" * 3000, "{a=" * 400, '{"a":' * 3000, "(" * 60, ")", "[1, [2, [3]]]", '{"a": {"b": [null]}}'),
    *('"\\u0000"', '"\\ud800"', '"\\u001b[31m"', "\ufeff", "\x00", "\x1b[2J", "\u202e", "'''", '"""', "#", "=", "."),
    *("[[", "]]", "-", "/", "../..", "/dev/zero", "~", "*", "{frame}"),
)
"""Words that may be misread in TOML, JSON, XML or on a command line."""


def token(content: bytes, rng: random.Random) -> bytes:
    """Put an odd word in place of one that is there."""
    text = content.decode("utf-8", "surrogateescape")
    found = list(_TOKEN.finditer(text))
    if not found:
        return content + b"x"
    chosen, other = rng.choice(found), rng.choice(found)
    new = rng.choice((rng.choice(ODD), rng.choice(ODD), other.group()))
    return (text[: chosen.start()] + new + text[chosen.end() :]).encode("utf-8", "surrogateescape")


def line(content: bytes, rng: random.Random) -> bytes:
    """Leave a line out, write it twice, or put it elsewhere."""
    lines = content.split(b"\n")
    chosen = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.randrange(3)):
        lines.insert(rng.randrange(len(lines) + 1), chosen)
    return b"\n".join(lines)


def no_text(content: bytes, rng: random.Random) -> bytes:
    """Put in bytes that are no UTF-8."""
    place = rng.randrange(len(content) + 1)
    return (
        content[:place]
        + rng.choice((b"\xff", b"\xc3\x28", b"\xed\xa0\x80", b"\x00", b"\xef\xbb\xbf", b"\r"))
        + content[place:]
    )


TEXT: tuple[Spoil, ...] = (token, token, token, token, line, line, no_text, bit, end, without, twice)


def spoiled(content: bytes, ways: tuple[Spoil, ...], rng: random.Random) -> bytes:
    """Spoil a sample in one way, or several one after the other."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5, 9))):
        content = rng.choice(ways)(content or b"\0", rng)
    return content
