"""What a page says is printed, held against what is printed: words as they are, numbers within a tolerance."""

import math
import re
from collections.abc import Iterator

RELATIVE = 0.02
"""How far a number may be off, as a share of it; or one in its last digit, whichever is more."""

ELLIPSIS = "…"
"""Stands for anything within a line; alone on a line, for any lines."""

NUMBER = re.compile(r"(?<![\w.])[-+−]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?")

_TIMING = re.compile(r"\d[\d.]*(?= (?:s\b|ms\b|seconds|frames/s|µs))|\b[0-9a-f]{16}\b")
"""How long something took, which differs from machine to machine, and digests, which hold the time."""


def differences(expected: str, found: str, /, *, relative: float = RELATIVE) -> Iterator[str]:
    """Yield how a text that was printed differs from what was expected; blanks count as one, timings as any."""
    remaining = [line.rstrip() for line in found.strip("\n").splitlines()]
    skipping = False
    for line in (one.rstrip() for one in expected.strip("\n").splitlines()):
        if line.strip() in {ELLIPSIS, "..."}:
            skipping = True
            continue
        while skipping and remaining and not like(line, remaining[0], relative=relative):
            remaining.pop(0)
        skipping = False
        if not remaining:
            yield f"expected {line.strip()!r}, and nothing more is printed"
            return
        there = remaining.pop(0)
        if not like(line, there, relative=relative):
            yield f"expected {line.strip()!r}, found {there.strip()!r}"
    if remaining and not skipping and any(line.strip() for line in remaining):
        yield f"expected no more, found {remaining[0].strip()!r}"


def like(expected: str, found: str, /, *, relative: float = RELATIVE) -> bool:
    """Return whether a line is the expected one, but for timings and for numbers within the tolerance."""
    expected, found = (_TIMING.sub("0", text) for text in (expected, found))
    pieces = [NUMBER.split(part) for part in expected.split(ELLIPSIS)]
    pattern = r".*?".join(_NUMBERS.join(map(_words, part)) for part in pieces)
    match = re.fullmatch(pattern + r"\s*", found)
    if match is None:
        return False
    numbers = [number for part in expected.split(ELLIPSIS) for number in NUMBER.findall(part)]
    return all(close(a, b, relative=relative) for a, b in zip(numbers, match.groups(), strict=True))


_NUMBERS = rf"({NUMBER.pattern})"


def _words(text: str) -> str:
    """Return a pattern of text in which blanks count as one or none, since numbers beside them may be longer or shorter."""
    return r"\s*".join(map(re.escape, re.split(r"\s+", text)))


def close(expected: str, found: str, /, *, relative: float = RELATIVE) -> bool:
    """Return whether two printed numbers are the same within the tolerance or one in the last digit that was expected."""
    a, b = (float(text.replace("−", "-")) for text in (expected, found))
    mantissa, _, exponent = expected.lower().partition("e")
    digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return math.isclose(a, b, rel_tol=relative, abs_tol=1.001 * digit if "." in mantissa or exponent else 0.0)
