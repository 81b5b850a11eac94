"""The Python front of the compiled two-path solver: it checks arrays and turns settings and noise into constants.

The solver itself is `_kernel_paths.h`. If it was not built, numpy does the same operations, with the same bits, in
`closed_form`, `one_path`, `uncertainty` and the stages before and after them.
"""

import math
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32, Status, Stored, sealed
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.noise import LEAST_SHARE, HarmonicNoise, NoiseModel, chi_squared_threshold
from cadtof_cli.phasors.voltages import PhasorMap
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel, extension
from cadtof_cli.resolver.settings import ORDERS, RETURNS, ResolverSettings
from cadtof_cli.resolver.status import ANSWERED, StatusCounts
from cadtof_cli.resolver.two_path.uncertainty import misfit_spread, variance_terms

Buffers = tuple[NDArray[Any] | None, ...]
"""Arrays in the form that the extension takes: contiguous in memory, each of one type."""

STORED_TYPES = (np.uint16, np.int16, np.float32, np.float64, np.complex128)

_NEIGHBOURS: tuple[Literal["C", "A"], ...] = ("C", "A")
"""Requirements for `np.require`: C-contiguous and aligned. An array that meets them is not copied."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KernelScales:
    """The numbers that turn the values of n pixels into maps, besides settings and noise; inputs are not changed.

    Attributes:
        phasor_map: the map from stored values to phasors; None if the input is phasors.
        saturated_counts: stored values at or beyond these limits are saturated; None: no value is saturated.
        metres: metres per radian, one number for all pixels or one per pixel, (n,).
        volts: volts per amplitude of 1.
        phase_offset_rad: phase to subtract from every phase of a pixel, (n,); None: nothing.
        tail: model of the frame's diffuse MPI for these pixels, from `diffuse.pixels.tail_buffers`; None: no diffuse
            MPI.
        most_volts, noise_volts: paths whose amplitudes add up to more than most_volts + noise_volts / √samples are impossible.
    """

    phasor_map: PhasorMap | None
    saturated_counts: tuple[float, float] | None
    metres: float | Float
    volts: float
    phase_offset_rad: Float | None
    tail: Buffers | None
    most_volts: float
    noise_volts: float


class FrameKernel:
    """The kernel with all inputs for n pixels except their stored values; many frames may share it.

    Args:
        scales: the numbers that turn values into maps.
        settings: settings that ask for at most two paths.
        noise: noise of the pixels, and the number of recorded pixels that each is a mean of.
        count: number of pixels, n.
        source_type: type of the stored values or phasors.

    Raises:
        ValueError: an array has the wrong shape.
    """

    def __init__(
        self,
        scales: KernelScales,
        /,
        *,
        settings: ResolverSettings,
        noise: NoiseModel,
        count: int,
        source_type: np.dtype[np.generic],
    ) -> None:
        self._tail, self._source_type, self._compiled = scales.tail or (), source_type, extension()
        self._options = (ORDERS.index(_order(settings)), RETURNS.index(settings.returns))
        self._shapes = (2, count) if scales.phasor_map is None else (2, 2, count), (7, count), (count,)
        own, other, constant = _own_maps(scales.phasor_map)
        arrays = {
            "own": (own, (2, 2, count)),
            "other": (other, (2, 2, count)),
            "constant": (constant, (2, 2, count)),
            "samples": (noise.samples, (count,)),
            "metres": (None if isinstance(scales.metres, float) else scales.metres, (count,)),
            "phase_offset_rad": (scales.phase_offset_rad, (count,)),
        }
        for name, (array, shape) in arrays.items():
            if array is not None and array.shape != shape:
                raise ValueError(f"{name}: found shape {array.shape}, expected {shape}")
        self._arrays = [
            None if one is None else np.require(one, requirements=_NEIGHBOURS) for one, _ in arrays.values()
        ]
        limits = scales.saturated_counts if scales.phasor_map is not None else None
        metres = scales.metres if isinstance(scales.metres, float) else math.nan
        shared = (metres, scales.volts, scales.most_volts, scales.noise_volts)
        self._constants = _constants(settings, noise.each, scales.phasor_map, limits, source_type, shared)

    def fill(self, stored: Stored, /, *, layers: Float32, status: Status, bits: int | None = None) -> None:
        """Fill `layers` and `status` of the pixels from their stored values.

        Args:
            stored: values of harmonics 1 and 2 as a file holds them, (2, 2, n); or phasors, complex128 (2, n).
            layers: float32 (7, n): depth, amplitude and sigma, each of the direct path and of the MPI path, then
                confidence.
            status: (n,), holds the bits known before. Pixels that are saturated, not finite or hot get no answer.
            bits: the bits known before, if they are the same for all pixels; the content of `status` is then ignored.

        Raises:
            ValueError: an array has the wrong shape or layout, or the kernel does not exist here.
            TypeError: an array has the wrong type.
        """
        shapes = stored.shape, layers.shape, status.shape
        if shapes != self._shapes:
            raise ValueError(f"stored, layers and status: found shapes {shapes}, expected {self._shapes}")
        if stored.dtype != self._source_type:
            raise TypeError(f"stored: found {stored.dtype}, expected {self._source_type}")
        values = stored if stored.dtype in STORED_TYPES else stored.astype(np.float64)
        if not (values.flags.c_contiguous and values.flags.aligned):
            values = np.require(values, requirements=_NEIGHBOURS)
        # layers and status are written in place, so they are not copied: the extension refuses them unless they are
        # contiguous
        self._compiled.resolve(
            chosen_kernel(),
            *self._options,
            -1 if bits is None else bits,
            self._constants,
            values,
            *self._arrays,
            layers,
            status,
            *self._tail,
        )


def count_status(status: Status, /) -> StatusCounts:
    """Count the pixels of a status map of any shape by how they were resolved; all kernels count the same."""
    kernel = chosen_kernel()
    if kernel == NUMPY:
        one, two, more, diffuse = (int(np.count_nonzero(status & np.uint32(bit))) for bit in ANSWERED)
    else:
        one, two, more, diffuse = extension().count_status(kernel, np.ascontiguousarray(status))
    return StatusCounts(one, two, more, diffuse, status.size - one - two - more - diffuse)


def shared_constants(settings: ResolverSettings, each: tuple[HarmonicNoise, ...], /) -> dict[str, float]:
    """Return the constants that all frames of one run share, by the names of `CONSTANTS` in `_kernel_frame.h`."""
    terms, least = variance_terms(each), settings.min_confidence
    misfit = chi_squared_threshold(settings.false_alarm, pairs=1)
    constants = {
        "least_power": chi_squared_threshold(settings.false_alarm, pairs=2) if least is None else 0.0,
        "least_modulus": least or 0.0,
        "misfit_limit": misfit if _order(settings) == "auto" else math.inf,
        "misfit_spread": misfit_spread(each),
        "weight": each[0].dark_variance / each[1].dark_variance,
        "signal": terms.signal,
        "return_ratio": settings.min_return_ratio,
    }
    for name, factors in (("alone", terms.alone), ("own", terms.own), ("other", terms.other)):
        constants |= {f"{name}{power}": factor for power, factor in enumerate(factors)}
    for h, harmonic in enumerate(each, start=1):
        constants |= {
            f"per_variance{h}": 1.0 / harmonic.dark_variance,
            f"dark{h}": harmonic.dark_variance,
            f"doubled{h}": harmonic.ambient_variance * harmonic.pulse_double,
            f"averaging{h}": harmonic.averaging,
            f"least{h}": LEAST_SHARE * harmonic.ambient_variance,
        }
    return constants


@lru_cache(maxsize=4)
def _constants(
    settings: ResolverSettings,
    each: tuple[HarmonicNoise, ...],
    phasor_map: PhasorMap | None,
    saturated_counts: tuple[float, float] | None,
    stored_type: np.dtype[np.generic],
    shared: tuple[float, ...],
) -> Float:
    """Return the constants of all pixels of a frame, in the order of `CONSTANTS`.

    Without an offset, −0 is added, because it changes no bit of a sum.
    """
    low, high = saturation(saturated_counts, stored_type)
    gains, offsets = [1.0] * 4, [-0.0] * 4
    if phasor_map is not None and phasor_map.own.shape[2] == 1:
        gains = phasor_map.own.ravel().tolist()
        offsets = offsets if phasor_map.constant is None else phasor_map.constant.ravel().tolist()
    constants = {
        **shared_constants(settings, each),
        "saturated_low": low,
        "saturated_high": high,
        **dict(zip(("metres", "volts", "most_volts", "noise_volts"), shared, strict=True)),
        **{f"gain{part}": gain for part, gain in enumerate(gains, start=1)},
        **{f"offset{part}": offset for part, offset in enumerate(offsets, start=1)},
    }
    names = extension().constant_names()
    if len(names) != len(constants):
        raise SettingsError("the compiled kernel was built from another version of its sources: reinstall cadtof")
    return sealed(np.array([constants[name] for name in names]))


def saturation(
    saturated_counts: tuple[float, float] | None, stored_type: np.dtype[np.generic], /
) -> tuple[float, float]:
    """Return the limits as numpy compares stored values with them: floats in their own type. Without limits, NaN."""
    if saturated_counts is None:
        return math.nan, math.nan
    own_type = stored_type.type if stored_type.kind == "f" else np.float64
    with np.errstate(over="ignore"):
        low, high = (float(np.asarray(limit, np.float64).astype(own_type)) for limit in saturated_counts)
    return low, high


def _order(settings: ResolverSettings) -> str:
    """Return the order of the settings; it is 1 if the settings allow only one path."""
    return "1" if settings.max_paths == 1 else settings.order


def _own_maps(phasor_map: PhasorMap | None) -> tuple[Float | None, Float | None, Float | None]:
    """Return the affine map of every pixel, (2, 2, n) each, or None if all pixels share one map."""
    if phasor_map is None or (phasor_map.own.shape[2] == 1 and phasor_map.other is None):
        return None, None, None
    if phasor_map.other is None or phasor_map.constant is None:
        raise ValueError("phasor_map: found a map of every pixel without other or constant")
    return phasor_map.own, phasor_map.other, phasor_map.constant
