"""Compare the output that a page shows with what a program prints: words exactly, numbers within a tolerance."""

import math
import re
from collections.abc import Iterator

RELATIVE = 0.02
"""How much a number may differ, as a share of it. One in its last digit is allowed if that is more."""

ELLIPSIS = "…"
"""Stands for any text within a line; alone on a line, for any lines."""

NUMBER = re.compile(r"(?<![\w.])[-+−]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?")

_TIMING = re.compile(r"\d[\d.]*(?= (?:s\b|ms\b|seconds|frames/s|µs))|\b[0-9a-f]{16}\b")
"""Durations, which differ from machine to machine, and digests, which depend on the time."""


def differences(expected: str, found: str, /) -> Iterator[str]:
    """Yield the differences between an expected text and the printed text.

    Several blanks equal one blank, and all timings are equal.
    """
    remaining = [line.rstrip() for line in found.strip("\n").splitlines()]
    skipping = False
    for line in (one.rstrip() for one in expected.strip("\n").splitlines()):
        if line.strip() in {ELLIPSIS, "..."}:
            skipping = True
            continue
        while skipping and remaining and not like(line, remaining[0]):
            remaining.pop(0)
        skipping = False
        if not remaining:
            yield f"expected {line.strip()!r}, and nothing more is printed"
            return
        there = remaining.pop(0)
        if not like(line, there):
            yield f"expected {line.strip()!r}, found {there.strip()!r}"
    if remaining and not skipping and any(line.strip() for line in remaining):
        yield f"expected no more, found {remaining[0].strip()!r}"


def like(expected: str, found: str, /) -> bool:
    """Return whether a line equals the expected line, apart from timings, and from numbers within the tolerance."""
    expected, found = (_TIMING.sub("0", text) for text in (expected, found))
    pieces = [NUMBER.split(part) for part in expected.split(ELLIPSIS)]
    pattern = r".*?".join(_NUMBERS.join(map(_words, part)) for part in pieces)
    match = re.fullmatch(pattern + r"\s*", found)
    if match is None:
        return False
    numbers = [number for part in expected.split(ELLIPSIS) for number in NUMBER.findall(part)]
    return all(close(a, b) for a, b in zip(numbers, match.groups(), strict=True))


_NUMBERS = rf"({NUMBER.pattern})"


def _words(text: str) -> str:
    """Return a pattern for a text. A blank matches any blanks or none, because numbers beside it may be longer or shorter."""
    return r"\s*".join(map(re.escape, re.split(r"\s+", text)))


def close(expected: str, found: str, /, *, relative: float = RELATIVE) -> bool:
    """Return whether two printed numbers agree within the tolerance, or within one in the last digit of the expected
    number."""
    a, b = (float(text.replace("−", "-")) for text in (expected, found))
    mantissa, _, exponent = expected.lower().partition("e")
    digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return math.isclose(a, b, rel_tol=relative, abs_tol=1.001 * digit if "." in mantissa or exponent else 0.0)
