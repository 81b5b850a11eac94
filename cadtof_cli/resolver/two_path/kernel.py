"""The front of the compiled two-path solver: checks everything, makes constants of settings and noise, and says what runs.

The solver itself is `_kernel.h`, compiled where a C compiler was at hand when cadtof was installed. Where none was, numpy does
the same operations, with the same bits, in `closed_form`, `one_path`, `uncertainty` and the stages before and after them.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType

import numpy as np

from cadtof_cli.arrays import Float, Float32, Status, Stored
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import LEAST_SHARE, NoiseModel
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.solver import misfit_spread
from cadtof_cli.resolver.two_path.uncertainty import variance_terms

NUMPY = "numpy"

CHOICE = "CADTOF_KERNEL"
"""Environment variable that names what runs, of `available_kernels`; without it the first of them does."""

_STORED_TYPES = (np.uint16, np.int16, np.float32, np.float64, np.complex128)

_ORDERS = {"auto": 0, "1": 1, "2": 2}
_RETURNS = {"first": 0, "strongest": 1, "last": 2}


def _compiled() -> ModuleType | None:
    """Return the extension module, or None where it was not built."""
    try:
        from cadtof_cli.resolver.two_path import _kernel
    except ImportError:
        return None
    return _kernel


def available_kernels() -> tuple[str, ...]:
    """Return the names of what can run here, the fastest first: instruction sets of the compiled solver, then `numpy`."""
    compiled = _compiled()
    return (*(compiled.levels() if compiled else ()), NUMPY)


@lru_cache(maxsize=1)
def chosen_kernel() -> str:
    """Return the name of what runs here.

    Raises:
        SettingsError: the environment asks for what this machine has not.
    """
    available, asked = available_kernels(), os.environ.get(CHOICE)
    if asked and asked not in available:
        raise SettingsError(f"{CHOICE}: found {asked!r}, expected one of {', '.join(available)}")
    return asked or available[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class PixelMaps:
    """What pixels of a frame have of their own, float64 each and None where they have nothing.

    Attributes:
        own: (H, 2, n), parts of phasors, Re p and Im p, from the stored values of their own channel, SC1 and SC2, ...
        other: (H, 2, n), ... from those of the other channel, ...
        constant: (H, 2, n), ... and from nothing.
        samples: (n,), recorded pixels that a phasor is the mean of.
        metres: (n,), per radian.
        shift: (n,) rad, to take from every phase.
    """

    own: Float | None = None
    other: Float | None = None
    constant: Float | None = None
    samples: Float | None = None
    metres: Float | None = None
    shift: Float | None = None


@dataclass(frozen=True, kw_only=True)
class KernelScale:
    """What turns stored values into phasors, parts = stored·gain + offset, and radians and amplitudes into m and V.

    `gain` and `offset` are those of Re p1, Im p1, Re p2, Im p2 where no pixel has a map of its own. Stored values at or beyond
    `saturated` are saturated; None: none are.
    """

    gain: Sequence[float] = (1.0, 1.0, 1.0, 1.0)
    offset: Sequence[float] = (-0.0, -0.0, -0.0, -0.0)
    saturated: tuple[float, float] | None = None
    metres_per_radian: float
    amplitude_v: float


def kernel_constants(settings: ResolverSettings, noise: NoiseModel, scale: KernelScale, /) -> Mapping[str, float]:
    """Return what all pixels of a frame share, by the names of `CONSTANTS` in `_kernel.h`."""
    first, second = noise.each
    terms = variance_terms(noise)
    low, high = scale.saturated or (np.nan, np.nan)
    least, threshold = settings.min_confidence, chi_squared_threshold(settings.false_alarm, pairs=1)
    constants = {
        "saturated_low": low,
        "saturated_high": high,
        "least_power": chi_squared_threshold(settings.false_alarm, pairs=2) if least is None else 0.0,
        "least_modulus": least or 0.0,
        "misfit_limit": threshold if settings.order == "auto" and settings.max_paths > 1 else np.inf,
        "misfit_spread": misfit_spread(noise),
        "weight": first.dark_variance / second.dark_variance,
        "signal": terms.signal,
        "return_ratio": settings.min_return_ratio,
        "metres": scale.metres_per_radian,
        "volts": scale.amplitude_v,
    }
    for h, harmonic in enumerate(noise.each):
        light = 0.5 * harmonic.averaging / harmonic.pulse**2
        constants |= {
            f"per_variance{h + 1}": 1.0 / harmonic.dark_variance,
            f"dark{h + 1}": harmonic.dark_variance,
            f"doubled{h + 1}": light * harmonic.pulse_double,
            f"averaging{h + 1}": harmonic.averaging,
            f"least{h + 1}": LEAST_SHARE * light,
        }
    for name, factors in (("alone", terms.alone), ("own", terms.own), ("other", terms.other)):
        constants |= {f"{name}{power}": factor for power, factor in enumerate(factors)}
    for part in range(4):
        constants |= {f"gain{part + 1}": scale.gain[part], f"offset{part + 1}": scale.offset[part]}
    return constants


def fill_maps(
    stored: Stored,
    /,
    *,
    layers: Float32,
    status: Status,
    constants: Mapping[str, float],
    settings: ResolverSettings,
    maps: PixelMaps,
    pixels: range | None = None,
    kernel: str | None = None,
) -> None:
    """Fill `layers` and `status` of a frame's pixels from its stored values; only these two are changed.

    Args:
        stored: (2, 2, n) values of harmonics 1 and 2 as a file holds them; or complex128 phasors, (2, n).
        layers: float32 (7, n), in the order of maps/layers.py: depths, amplitudes, sigmas of both paths, and confidence.
        status: (n,); comes with the bits that are known already, of which saturated, not finite and hot pixel mean no answer.
        constants: of `kernel_constants`.
        settings: which paths are asked for.
        maps: what pixels have of their own.
        pixels: the flat indices to fill; None: all.
        kernel: of `available_kernels`, but `numpy`; None: the one chosen for this process.

    Raises:
        ValueError: an array has the wrong shape or layout, or there is no such kernel.
        TypeError: an array has the wrong type.
    """
    compiled = _compiled()
    if compiled is None:
        raise ValueError("the compiled kernel was not built")
    count = status.shape[-1] if status.ndim else 0
    asked = range(count) if pixels is None else pixels
    if asked.step != 1:
        raise ValueError(f"pixels: found {asked}, expected neighbours")
    given = np.require(stored if stored.dtype in _STORED_TYPES else stored.astype(np.float64), requirements=["C", "A"])
    shapes = {
        "stored": (given, (2, count) if given.dtype.kind == "c" else (2, 2, count)),
        "layers": (layers, (7, count)),
        "status": (status, (count,)),
        "own": (maps.own, (2, 2, count)),
        "other": (maps.other, (2, 2, count)),
        "constant": (maps.constant, (2, 2, count)),
        "samples": (maps.samples, (count,)),
        "metres": (maps.metres, (count,)),
        "shift": (maps.shift, (count,)),
    }
    for name, (array, shape) in shapes.items():
        if array is not None and array.shape != shape:
            raise ValueError(f"{name}: found shape {array.shape}, expected {shape}")
    compiled.resolve(
        kernel or chosen_kernel(),
        1 if settings.max_paths == 1 else _ORDERS[settings.order],
        _RETURNS[settings.returns],
        asked.start,
        asked.stop,
        np.array([constants[name] for name in compiled.constant_names()]),
        given,
        maps.own,
        maps.other,
        maps.constant,
        maps.samples,
        maps.metres,
        maps.shift,
        layers,
        status,
    )
