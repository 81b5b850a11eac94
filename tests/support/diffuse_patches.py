"""Patches of a frame, made from their MPI."""

import math

import numpy as np

from cadtof_cli.arrays import Bool, Complex
from cadtof_cli.phasors.pooling import SharedNoise
from cadtof_cli.resolver.diffuse.grid import PatchGrid, assumed_view, patch_grid
from cadtof_cli.resolver.diffuse.light import FrameTraits, PatchMeans
from cadtof_cli.resolver.diffuse.second_paths import PatchData
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings

PATCHES = (15, 20)
"""Rows and columns of patches."""

LIT: Bool = np.ones(PATCHES, np.bool_)


def traits_of(harmonics: tuple[int, ...], variance: float, grid: PatchGrid | None = None) -> FrameTraits:
    """Return what is known of a frame with a fundamental of 40 ns and the same noise in all harmonics."""
    settings, noise = DiffuseSettings(period_ns=40.0, harmonics=harmonics), np.full(len(harmonics), variance)
    grid = grid or patch_grid(48, 64, assumed_view(48, 64))
    return FrameTraits(grid, settings, noise, tuple(noise.tolist()), SharedNoise(1.0, 0.0))


def patch_data(*mpi: Complex, sigma: float, noisy: bool = True, seed: int = 0) -> PatchData:
    """Return patches of 64 pixels of amplitude .2, with noise; `mpi` holds MPI over direct light per harmonic, (n,)."""
    rng, each, count = np.random.default_rng(seed), sigma / (0.2 * 8.0), math.prod(PATCHES)
    noise = each * (rng.normal(size=(len(mpi), count)) + 1j * rng.normal(size=(len(mpi), count)))
    phasors = 1.0 + np.stack(mpi) + (noise if noisy else 0.0)
    turn = np.conj(phasors[0]) / np.abs(phasors[0])
    ratios = np.stack([p / np.abs(phasors[0]) * turn**h for h, p in enumerate(phasors[1:], start=2)])
    amplitude = 0.2 * np.abs(phasors[0])
    means = PatchMeans(
        ratios.reshape(-1, *PATCHES),
        amplitude.reshape(PATCHES),
        np.full(PATCHES, 64.0),
        np.zeros(PATCHES),
        np.ones(PATCHES),
    )
    return PatchData.of(means, LIT, traits_of(tuple(range(1, len(mpi) + 1)), sigma**2))
