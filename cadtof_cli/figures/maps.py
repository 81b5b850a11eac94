"""A picture of a frame's maps: depths, their errors where truth is known, sigma, confidence, and what became of each pixel."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Status
from cadtof_cli.figures.page import Block, Classes, Panel, Scaled, draw_page
from cadtof_cli.figures.pixel_classes import class_shares

DEPTHS: Final = "viridis"
SIGMAS: Final = "magma"
ERRORS: Final = "RdBu_r"
VOLTAGES: Final = "inferno"
"""Scales of colours: perceptually uniform, and told apart by the colour-blind."""


@dataclass(frozen=True, eq=False)
class MapPicture:
    """What the picture shows, (Y, X) each: depths, sigma and truth in m, confidence in V, status bits; and which depth it is."""

    title: str
    direct_m: Float
    mpi_m: Float
    confidence_v: Float
    sigma_m: Float
    status: Status
    truth_m: Float | None = None
    first_phasor_m: Float | None = None
    depth: str = "radial range"
    amplitude_v: Float | None = None


def draw_maps(picture: MapPicture, path: Path, /, *, kind: str = "png") -> None:
    """Draw the maps as a picture of a kind such as png or pdf; a legend tells the colours of pixels that have no depth."""
    status, kind_of_depth = picture.status, picture.depth
    depth_unit = f"{kind_of_depth}, m"
    direct, first = picture.direct_m, picture.first_phasor_m
    depths = [Panel("direct depth", direct, status)]
    if first is not None:
        depths.insert(0, Panel("first phasor alone", first, status))
    shown = np.concatenate([panel.values.ravel() for panel in depths])
    upper: list[Block] = [
        Scaled(tuple(depths), depth_unit, DEPTHS, limits_of(shown)),
        Scaled(
            (Panel("MPI depth", picture.mpi_m, status, one_path=True),),
            depth_unit,
            DEPTHS,
            limits_of(picture.mpi_m),
        ),
    ]
    lower: list[Block] = [] if picture.truth_m is None else [_errors(picture, picture.truth_m)]
    sigma, confidence = 100 * picture.sigma_m, 1000 * picture.confidence_v
    of_sigma = Scaled((Panel("σ of direct depth", sigma, status),), "predicted, cm", SIGMAS, (0.0, limits_of(sigma)[1]))
    of_light = Scaled(
        (Panel("confidence", confidence, status),), "first phasor, mV", VOLTAGES, (0.0, limits_of(confidence)[1])
    )
    lower += [of_sigma, of_light]
    if picture.truth_m is None and picture.amplitude_v is not None:
        amplitude = Panel("direct amplitude", 1000 * picture.amplitude_v, status)
        lower.append(Scaled((amplitude,), "mV", VOLTAGES, (0.0, limits_of(amplitude.values)[1])))
    upper.append(Classes.of(paths=status))
    draw_page((upper, lower), path, title=picture.title, kind=kind, shares=class_shares(status))


def _errors(picture: MapPicture, truth: Float) -> Scaled:
    named = [("direct − truth", picture.direct_m)]
    if picture.first_phasor_m is not None:
        named.insert(0, ("first phasor − truth", picture.first_phasor_m))
    errors = [100 * (depth - truth) for _, depth in named]
    panels = tuple(
        Panel(f"{name}\n{_median(error)}", error, picture.status)
        for (name, _), error in zip(named, errors, strict=True)
    )
    return Scaled(panels, "cm", ERRORS, signed_limits(*errors))


def _median(error: Float) -> str:
    finite = np.abs(error[np.isfinite(error)])
    return f"median {np.median(finite):.2f} cm off" if finite.size else "nowhere both"


def signed_limits(*differences: NDArray[np.floating], share: float = 90.0) -> tuple[float, float]:
    """Return limits about 0 that hold a share, in %, of each of several maps of differences."""
    sizes = [np.abs(one[np.isfinite(one)]) for one in differences]
    limit = max((float(np.percentile(size, share)) for size in sizes if size.size), default=1.0) or 1e-3
    return -limit, limit


def limits_of(values: NDArray[np.floating]) -> tuple[float, float]:
    """Return the range that all but the outermost half per cent of the finite values lie in, a little widened."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = np.percentile(finite, (0.5, 99.5))
    margin = 0.02 * (high - low) + 1e-6
    return float(low - margin), float(high + margin)
