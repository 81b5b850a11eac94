"""Units and conversions between them: times in ns, lengths in m, phases in rad, voltages in V; numbers and texts for people."""

import math
from collections.abc import Sequence

C_M_PER_NS = 0.299792458
"""Speed of light in vacuum."""

FWHM_PER_SIGMA = 2.0 * math.sqrt(2.0 * math.log(2.0))
"""Full width at half maximum of a Gaussian over its standard deviation, 2.3548."""


def counted(number: int, noun: str, /) -> str:
    """Return a number of things in words, such as '1 frame' and '2 frames'."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def size_text(pixels: Sequence[int], /) -> str:
    """Return the size of an array, (Y, X), in the order that people use: columns × rows."""
    return f"{pixels[1]} × {pixels[0]}"


def printable(text: str, /) -> str:
    """Return a text in which characters that are invisible, change the direction of writing or are no Unicode, are escaped."""
    return text if text.isprintable() else "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)


def shortened(text: str, most: int, /) -> str:
    """Return a text of at most `most` characters. A longer text loses its middle, because names differ most at their ends."""
    if len(text) <= most:
        return text
    keep = max(most - 1, 2)
    return f"{text[: keep // 2]}…{text[-(keep - keep // 2) :]}"


def first_of(names: Sequence[str], most: int, /) -> str:
    """Return a text of at most `most` names, and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def unambiguous_range_m(period_ns: float) -> float:
    """Return the range after which the fundamental's phase repeats, c·T1/2, in metres."""
    return C_M_PER_NS * period_ns / 2.0


def metres_per_radian(period_ns: float) -> float:
    """Return the range in metres that one radian of fundamental phase stands for, c·T1/(4π)."""
    return C_M_PER_NS * period_ns / (4.0 * math.pi)
