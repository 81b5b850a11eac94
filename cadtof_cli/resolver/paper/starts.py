"""Random starts of the search of Eq. (9)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Float, Index

HALF_SIDE = 3.0
"""Half the side of the square of the starts. Its centre is z = 1/2, which stays the same when the paths are swapped."""

GOLDEN = 0x9E3779B97F4A7C15
ROUNDS = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))
"""SplitMix64 (Steele, Lea and Flood 2014, doi:10.1145/2714064.2660195): its n-th number can be computed alone."""

ROW_SHIFT = 40
"""The starts of a pixel are 2^40 numbers apart, because no frame has that many pixels."""


@dataclass(frozen=True)
class RandomStarts:
    """The starts z of each pixel, in order: uniform in a square.

    They depend only on the seed and on the place of the pixel in the frame, its flat index. So every block and every
    process draws the same starts, pixels do not share their starts, and with more starts the first ones stay the same.
    """

    count: int
    seed: int

    @cached_property
    def key(self) -> int:
        """Number that is hashed from the seed, so that the sequences of neighbouring seeds lie far from each other."""
        return int(np.random.SeedSequence(self.seed).generate_state(1, np.uint64)[0])

    def of(self, places: Index, number: int, /) -> Float:
        """Return start `number`, counted from 0, of the pixels at the places, (n,): Re z and Im z, (2, n)."""
        bits = (places.astype(np.uint64) + (number << ROW_SHIFT)) * GOLDEN + self.key
        for shift, factor in ROUNDS:
            bits ^= bits >> shift
            bits *= factor
        halves = np.stack([bits >> 32, bits & 0xFFFFFFFF])
        z: Float = halves * (2.0 * HALF_SIDE / 2**32) + np.array([[0.5 - HALF_SIDE], [-HALF_SIDE]])
        return z
