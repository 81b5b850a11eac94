"""The front of the compiled twin of the first look at a frame, `_sampled.h`: the light of its samples, and sums over patches."""

from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32, Index, Stored, sealed
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.phasors.voltages import PhasorMap
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.compiled_fit import MOST_HARMONICS
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.kernel import NUMPY, STORED_TYPES, extension


@dataclass(frozen=True, eq=False)
class Look:
    """What a frame is looked at with, besides its stored values.

    Attributes:
        phasor_map: from stored values to phasors.
        saturated: stored values at or beyond these are saturated, in the values' own type; NaN: none are.
        least_power: sum of all |p_h|² over their variances at and below which there is no signal.
        least_modulus: |p_1| below which there is none.
        variances: of the phasors of each harmonic.
        harmonics: their numbers.
        hot: pixels that get no answer, (n,); None: none do.
        samples: over how many recorded pixels each is a mean, (n,); None: 1.
    """

    phasor_map: PhasorMap
    saturated: tuple[float, float]
    least_power: float
    least_modulus: float
    variances: tuple[float, ...]
    harmonics: tuple[int, ...]
    hot: Bool | None = None
    samples: Float | None = None

    @classmethod
    def of(
        cls,
        settings: ResolverSettings,
        noise: NoiseModel,
        phasor_map: PhasorMap,
        saturated: tuple[float, float],
        hot: Bool | None,
        /,
    ) -> "Look":
        """Return what a frame with that noise is looked at with."""
        least, variances = settings.min_confidence, tuple(one.dark_variance for one in noise.each)
        power = chi_squared_threshold(settings.false_alarm, pairs=len(noise.each)) if least is None else 0.0
        return cls(phasor_map, saturated, power, least or 0.0, variances, noise.harmonics, hot, noise.samples)


def compiled_looks(stored: np.dtype[np.generic], harmonics: int, kernel: str, /) -> bool:
    """Return whether the kernel of that name can look at stored values of a type, of so many harmonics."""
    return kernel != NUMPY and stored in STORED_TYPES[:-1] and harmonics <= MOST_HARMONICS


def compiled_light(stored: Stored, look: Look, grid: PatchGrid, /, *, kernel: str) -> tuple[Bool, Float32, Float32]:
    """Return what `PatchLight` holds of a frame's stored values (H, 2, n), with the bits that numpy gives it."""
    places = _places(grid)
    weighted = np.empty((1 + 2 * len(stored), *places.shape), np.float32)
    phase_rad, seen = np.empty(places.shape, np.float32), np.empty(places.shape, np.bool_)
    extension().look_at_samples(
        kernel,
        np.array([*look.saturated, look.least_power, look.least_modulus]),
        np.array(look.harmonics, np.int64),
        np.array([1.0 / variance for variance in look.variances]),
        places,
        *(
            None if one is None else np.ascontiguousarray(one)
            for one in (
                stored,
                look.phasor_map.own,
                look.phasor_map.other,
                look.phasor_map.constant,
                look.hot,
                look.samples,
            )
        ),
        weighted,
        phase_rad,
        seen,
    )
    return seen, phase_rad, weighted


def compiled_sums(weighted: Float32, counted: Bool, /, *, kernel: str) -> Float:
    """Return the sums of (k, n, rows, columns) over those of the n samples that are counted, and at last how many, (k + 1, …)."""
    sums = np.empty((len(weighted) + 1, *counted.shape[1:]))
    extension().sum_patches(kernel, np.ascontiguousarray(weighted), np.ascontiguousarray(counted), sums)
    return sums


@lru_cache(maxsize=4)
def _places(grid: PatchGrid) -> Index:
    """Return where the samples of every patch stand in the frame, flat, (n, rows, columns); −1 outside."""
    size = (grid.height, grid.width)
    return sealed(np.ascontiguousarray(grid.samples(np.arange(1, 1 + grid.height * grid.width).reshape(size)) - 1))
