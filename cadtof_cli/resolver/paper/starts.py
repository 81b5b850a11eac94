"""Where the search of Eq. (9) begins, at random."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Float, Index

HALF_SIDE = 3.0
"""Half the side of the square around z = 1/2, the point that swapping the paths leaves, that starts are spread over."""

GOLDEN = 0x9E3779B97F4A7C15
ROUNDS = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))
"""SplitMix64 (Steele, Lea and Flood 2014, doi:10.1145/2714064.2660195), whose n-th number needs none of those before it."""

ROW_SHIFT = 40
"""A pixel's starts are 2^40 numbers apart: no frame has as many pixels."""


@dataclass(frozen=True)
class RandomStarts:
    """The z that each pixel starts from, one after the other: uniform in a square.

    They follow from the seed and the pixel's place in the frame, its flat index, alone: every block and every process draws the
    same, no pixel's luck is that of all others, and more starts leave the first ones as they are.
    """

    count: int
    seed: int

    @cached_property
    def key(self) -> int:
        """What the seed makes of itself: sequences of neighbouring seeds lie far from each other."""
        return int(np.random.SeedSequence(self.seed).generate_state(1, np.uint64)[0])

    def of(self, places: Index, number: int, /) -> Float:
        """Return the start of that number, from 0 on, of the pixels at the places, (n,): Re z and Im z, (2, n)."""
        bits = (places.astype(np.uint64) + np.uint64(number << ROW_SHIFT)) * np.uint64(GOLDEN) + np.uint64(self.key)
        for shift, factor in ROUNDS:
            bits ^= bits >> np.uint64(shift)
            bits *= np.uint64(factor)
        halves = np.stack([bits >> np.uint64(32), bits & np.uint64(0xFFFFFFFF)])
        z: Float = halves * (2.0 * HALF_SIDE / 2**32) + np.array([[0.5 - HALF_SIDE], [-HALF_SIDE]])
        return z
