"""Where the paper's search begins: random z, drawn for each pixel from the seed and the pixel's place in the frame."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cadtof_cli.arrays import Complex, Index

START_SPREAD = 1.0
"""Standard deviation of the starts' real and imaginary parts around z = 1/2, the point that swapping the paths leaves."""

DRAWN_PIXELS = 4096
"""Neighbours in a frame whose starts are drawn together; fixed, so that starts never depend on blocks and processes."""


class Starts(Protocol):
    """Rows of starts of n pixels, as an array complex128 (S, n) has them."""

    def __len__(self) -> int:
        """Return how many starts a pixel has."""

    def __getitem__(self, rows: slice, /) -> Complex:
        """Return some of the starts of every pixel."""


class RandomStarts:
    """The z that each pixel starts from: complex Gaussian around 1/2, drawn when they are asked for.

    They follow from the seed and the pixel's place in the frame alone, `pixels` being flat indices of neighbours: every block
    and every process draws the same, and no pixel's luck is that of all others. More starts leave the first ones as they are.
    Most pixels need the first alone, so that later rows are often not drawn at all.
    """

    def __init__(self, count: int, /, *, pixels: range, seed: int) -> None:
        self._count, self._pixels = count, pixels
        self._parts = range(pixels.start // DRAWN_PIXELS, -(-pixels.stop // DRAWN_PIXELS))
        self._generators = [
            np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(part,))) for part in self._parts
        ]
        self._drawn: Complex = np.empty((0, len(pixels)), np.complex128)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, rows: slice, /) -> Complex:
        wanted = range(self._count)[rows]
        missing = max(wanted, default=-1) + 1 - len(self._drawn)
        if missing > 0:
            self._drawn = np.concatenate((self._drawn, self._rows(missing)))
        return self._drawn[rows]

    def _rows(self, count: int) -> Complex:
        """Draw so many rows more."""
        starts = np.empty((count, len(self._pixels)), np.complex128)
        for part, generator in zip(self._parts, self._generators, strict=True):
            drawn = generator.standard_normal((count, 2, DRAWN_PIXELS))
            first = part * DRAWN_PIXELS
            here = slice(max(self._pixels.start, first), min(self._pixels.stop, first + DRAWN_PIXELS))
            there = starts[:, here.start - self._pixels.start : here.stop - self._pixels.start]
            there.real, there.imag = START_SPREAD * drawn[:, :, here.start - first : here.stop - first].swapaxes(0, 1)
            there.real += 0.5
        return starts


def random_starts(count: int, /, *, pixels: range, seed: int) -> Complex:
    """Return all of them, (count, n)."""
    return RandomStarts(count, pixels=pixels, seed=seed)[:]


@dataclass(frozen=True)
class ChosenStarts:
    """The starts of some pixels, by their indices."""

    starts: Starts
    pixels: Index

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, rows: slice, /) -> Complex:
        return self.starts[rows][:, self.pixels]
