"""Pixels that see through a surface: freed of the room's tail, so that they can be resolved as separate paths."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.nets import freed_paths
from cadtof_cli.resolver.diffuse.records import DiffuseModel
from cadtof_cli.resolver.diffuse.settings import range_from_phase

LEAST_SHARE = 0.1
"""Least share of either path in a pixel's light; a smaller one may be an error of the typical tail."""

OF_NET = 0.1
"""Largest relative difference of range between a pixel and the net of its patch to which it belongs."""


@dataclass(frozen=True, eq=False)
class NetPixels:
    """Which of n pixels see through a surface.

    Attributes:
        where: these pixels, (n,).
        size: |p1| over |p1| without the tail, (n,).
        own_variance: variance of their direct phase in addition to that of noise, rad².
    """

    where: Bool
    size: Float
    own_variance: float

    def variance(self, others: float, /) -> Float:
        """Return the variance of the direct phases in addition to noise, (n,), rad²; all other pixels have `others`."""
        return np.where(self.where, self.own_variance, others)


def freed_pixels(phasors: Complex, model: DiffuseModel, /, *, first: int) -> tuple[Complex, NetPixels | None]:
    """Return the phasors (H, n) of consecutive pixels of a frame, and which pixels see through a surface.

    Phasors of these pixels are freed of tails. If the frame has no such surface, the phasors are those given, and the
    second answer is None. `first` is the flat index of the first pixel.
    """
    nets = model.nets
    if nets is None:
        return phasors, None
    count = phasors.shape[1]
    net_m = nets.near_m[model.upsampler.grid.patch_of(first + np.arange(count))]
    there = np.isfinite(net_m)
    where = np.zeros(count, np.bool_)
    free, size = phasors.copy(), np.ones(count)
    if there.any():
        seen, net_m = phasors[:, there], net_m[there]
        paths = freed_paths(seen, nets.tails)
        near_m = range_from_phase(paths.near_rad, model.settings)
        two_paths = (paths.near_share > LEAST_SHARE) & (paths.near_share < 1.0 - LEAST_SHARE)
        two_paths &= np.abs(near_m - net_m) < OF_NET * net_m
        where[there] = two_paths
        free[:, there] = np.where(two_paths, paths.phasors, seen)
        size[there] = np.abs(seen[0]) / np.abs(free[0, there])
    return free, NetPixels(where, size, nets.variance)
