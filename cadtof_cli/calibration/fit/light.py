"""Whether frames that should be dark saw light, by two signs: the law that ties the harmonics of light, and the level.

The law: light of phase φ gives the fundamental A·exp(iφ), and gives harmonic h a multiple of A·exp(ihφ). The multiple
is the same in every pixel, whatever gains and delays the camera has. Offsets may differ from pixel to pixel, slope over
the array, or be alike in rows, in columns or in all harmonics. If the offsets of two harmonics are related at all, the
relation is a linear map.

The level: if all light has one phase, the law tells nothing. But then all pixels have a phasor in common, and offsets
have only a small one if the stored zero is right.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.calibration.fit.robust import centre_and_spread

OUTLIER = 6.0
"""A pixel is left out if it is more than this many robust standard deviations from the median of its plane."""

LEAST_PIXELS = 200
"""Least number of pixels that are no outliers; fewer show neither the law of light nor the level."""

LEAST_KNOWN = 50
"""Least number of pixels, or of blocks, for the test of the law."""

BLOCK = 5
"""Side of a block, in pixels. The median of a block keeps the light of a scene, and little of the pixels' own offsets."""

LAW_SHARE = 0.05
"""Share of a harmonic's residuals from a linear map that the law of light may predict by chance."""

LAW_SHARE_OF_ROWS = 6.0
"""The same share times the number of rows or columns, whichever is smaller; the larger of both shares counts. Offsets
that are alike in whole rows give only as many independent values as there are rows."""

LAW_SHARE_OF_OUTLIERS = 0.5
"""The same share, for pixels that are outliers: groups of hot pixels have few independent values, and light is far above
the noise there."""

_ROUNDING = 1e-20
"""Share of the squares that rounding errors may leave."""

LIGHT_LEVEL = 0.1
"""Largest length of the phasor that all pixels may have in common at every harmonic, over the modulation amplitude."""


@dataclass(frozen=True)
class LightSeen:
    """Evidence that dark frames saw light.

    Attributes:
        law: share of a harmonic's residuals from a linear map of the fundamental that the law of light predicts, with
            the multiple found in the other half of the pixels; divided by the share that chance reaches.
        level: length of the phasor that the pixels have in common, over the modulation amplitude, at the harmonic at
            which it is shortest.
    """

    law: float
    level: float

    @property
    def follows_law(self) -> bool:
        """Whether the harmonics are related as those of light are."""
        return self.law > 1.0

    @property
    def is_lit(self) -> bool:
        """Whether the frames saw light, or have a level that is as high as with light."""
        return self.follows_law or self.level > LIGHT_LEVEL


def light_seen(volts: Float, /, *, harmonics: tuple[int, ...], amplitude_v: float) -> LightSeen:
    """Return the evidence of light in the mean of dark frames, (H, 2, Y, X) in V; pixels that are not sound are NaN."""
    phasors: Complex = volts[:, 0] + 1j * volts[:, 1]
    usual = _usual(phasors)
    if usual.sum() < LEAST_PIXELS:
        return LightSeen(0.0, 0.0)
    nowhere = complex(np.nan, np.nan)
    # of a scene before the sky, all that gives light is outliers
    outliers = np.where(usual, nowhere, phasors)
    phasors = np.where(usual, phasors, nowhere)
    common = [complex(np.nanmedian(one.real), np.nanmedian(one.imag)) for one in phasors]
    law = max(_law_share(one, harmonics) for one in (phasors, _block_medians(phasors)))
    law = max(law, _law_share(outliers, harmonics, least=LAW_SHARE_OF_OUTLIERS))
    return LightSeen(law, float(min(map(abs, common))) / amplitude_v)


def _usual(phasors: Complex) -> Bool:
    """Return the pixels, (Y, X), that are finite and no outliers in all planes."""
    usual = np.isfinite(phasors).all(axis=0)
    for plane in (*phasors.real, *phasors.imag):
        if not usual.any():
            break
        centre, spread = centre_and_spread(plane[usual])
        with np.errstate(invalid="ignore"):
            usual &= np.abs(plane - centre) <= OUTLIER * max(spread, float(np.finfo(np.float32).eps))
    return np.asarray(usual)


def _block_medians(phasors: Complex) -> Complex:
    """Return medians of blocks of `BLOCK` × `BLOCK` pixels, (H, rows, columns); NaN if fewer than half of its pixels
    are finite."""
    count, height, width = phasors.shape
    rows, columns = height // BLOCK, width // BLOCK
    cut = phasors[:, : rows * BLOCK, : columns * BLOCK].reshape(count, rows, BLOCK, columns, BLOCK)
    pixels = cut.transpose(0, 1, 3, 2, 4).reshape(count, rows, columns, BLOCK**2)
    some = np.isfinite(pixels).sum(axis=3) >= BLOCK**2 // 2
    medians = np.full(some.shape, np.nan, np.complex128)
    medians[some] = np.nanmedian(pixels.real[some], axis=1) + 1j * np.nanmedian(pixels.imag[some], axis=1)
    return medians


def _law_share(phasors: Complex, harmonics: tuple[int, ...], *, least: float = LAW_SHARE) -> float:
    """Return the share of the residuals of an affine map that the law of light predicts, over the share of chance (`least`
    or more); the largest of all harmonics.

    The multiple found in one half of the pixels predicts the other half, and vice versa. This is done for left and
    right, and for top and bottom, and the smaller share counts: offsets that rows or columns have in common by chance
    fail in one of the two.
    """
    known = np.isfinite(phasors).all(axis=0)
    rows, columns = np.nonzero(known)
    if rows.size < LEAST_KNOWN:
        return 0.0
    halves = (columns <= np.median(columns), rows <= np.median(rows))
    first = phasors[0, known]
    length = np.maximum(np.abs(first), np.finfo(np.float64).tiny)
    independent = min(np.unique(rows).size, np.unique(columns).size)
    shares = [0.0]
    for other, harmonic in zip(phasors[1:, known], harmonics[1:], strict=True):
        law = length * (first / length) ** harmonic
        shares.append(min(_foretold(first, other, law, half) for half in halves))
    return float(max(shares) / max(least, LAW_SHARE_OF_ROWS / independent))


def _foretold(first: Complex, other: Complex, law: Complex, half: Bool) -> float:
    """Return the share of both halves' residuals that the law predicts; the multiple for each half is found in the
    other half."""
    left, bent = ([_without_affine(first[part], one[part]) for part in (half, ~half)] for one in (other, law))
    power = [float(np.vdot(one, one).real) for one in bent]
    total = sum(float(np.vdot(one, one).real) for one in left)
    # pixels that all hold the same values leave rounding errors, which are alike
    if min(power) <= 0.0 or total <= _ROUNDING * float(np.vdot(other, other).real):
        return 0.0
    multiples = [complex(np.vdot(b, one)) / p for b, one, p in zip(bent, left, power, strict=True)]
    missed = [one - multiple * b for one, b, multiple in zip(left, bent, reversed(multiples), strict=True)]
    wrong = float(sum(float(np.vdot(one, one).real) for one in missed))
    return 1.0 - wrong / total


def _without_affine(first: Complex, values: Complex) -> Complex:
    """Return the residuals of values from their best affine map of the fundamental."""
    affine = np.stack([np.ones_like(first), first, np.conj(first)], axis=1)
    return np.asarray(values - affine @ np.linalg.lstsq(affine, values, rcond=None)[0])
