"""Patches with two separate paths: what a decaying tail cannot look like.

A tail lowers |H_2| below |H_1| and makes it lag. Two paths can do otherwise: a weak first return before a strong one, or a strong
second one 12 to 28 ns late (T1 = 40 ns), makes H_2 lead, or larger than H_1.
"""

import numpy as np

from cadtof_cli.arrays import Bool
from cadtof_cli.resolver.diffuse.light import PatchMeans

LARGEST_LEAD_RAD = 0.1
"""Largest arg q_2 of a tail: 0 for one that decays, and what renderings of 30 rooms leave of it."""

LARGEST_RATIO = 1.2
"""Largest |q_2| of a tail: below 1 for one that decays; strong light from one far wall reaches 1.15."""

SEPARATE_SHARE = 0.15
"""Share of separate patches above which a whole frame is taken as two paths: 0 in rendered rooms, .26 to .51 on true ones."""

SEEN_SNR = 3.0
"""Amplitude over noise from which a patch counts."""

SEEN_SHARE = 0.1
"""Share of a patch's pixels that must have a signal for it to count."""

NOISE_MARGIN = 7.0
"""Three standard deviations of arg q_2 in σ/|p1| of a pixel: its variance is 1 + 4 times that of a phase; √5 · 3."""


def lit_patches(means: PatchMeans, noise_sigma: float, /, *, sampled: int) -> Bool:
    """Return which patches count, (rows, columns): enough of their `sampled` pixels are lit enough."""
    lit: Bool = (means.amplitude > SEEN_SNR * noise_sigma) & (means.pixels > SEEN_SHARE * sampled)
    return lit


def separate_patches(means: PatchMeans, lit: Bool, noise_sigma: float, /) -> Bool:
    """Return which of the lit patches no tail explains, beyond what noise does to them, (rows, columns)."""
    margin = (
        NOISE_MARGIN * noise_sigma / np.where(lit, means.amplitude * np.sqrt(np.maximum(means.pixels, 1.0)), np.inf)
    )
    ratio = means.ratios[0]
    separate: Bool = lit & ((np.angle(ratio) > LARGEST_LEAD_RAD + margin) | (np.abs(ratio) > LARGEST_RATIO + margin))
    return separate
