"""Colours of a page: its scales, the limits of each layer, which all frames of a run share, and thumbnails."""

import base64
import json
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, spread_values
from cadtof_cli.files.png import indexed_png
from cadtof_cli.report.frames import sampled

COLOURS = 255
"""Number of colours of the scale of depths; one more colour stands for no answer."""


@lru_cache(maxsize=1)
def palette() -> dict[str, Any]:
    """Return the colours of the page as `#rrggbb`: of scales (evenly spaced), of no answer, and of the status bits."""
    source = files("cadtof_cli.report").joinpath("page", "palette.json")
    return dict(json.loads(source.read_text(encoding="utf-8")))


def small_plane(plane: NDArray[Any], /, *, longest_px: int) -> NDArray[np.float32]:
    """Return every n-th pixel of a plane (Y, X), so that its longer side has `longest_px` at most."""
    small: NDArray[np.float32] = sampled(plane, -(-max(plane.shape) // longest_px)).astype(np.float32)
    return small


def thumbnail(depth_m: NDArray[np.float32], limits_m: tuple[float, float], /) -> str:
    """Return a picture of depths (Y, X) between limits as a data URI; limits may be equal or NaN."""
    lowest, highest = limits_m
    width = highest - lowest if highest > lowest else 1.0
    with np.errstate(invalid="ignore"):
        share = np.clip((depth_m.astype(np.float64) - lowest) / width, 0.0, 1.0)
    places = np.where(np.isnan(share), COLOURS, np.rint(np.nan_to_num(share) * (COLOURS - 1))).astype(np.uint8)
    picture = indexed_png(places, _colour_table())
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")


@lru_cache(maxsize=1)
def _colour_table() -> NDArray[np.uint8]:
    named = palette()
    stops = np.array([_rgb(colour) for colour in named["sequential"]])
    places = np.linspace(0.0, len(stops) - 1.0, COLOURS)
    scale: Float = np.stack([np.interp(places, np.arange(len(stops)), stops[:, k]) for k in range(3)], axis=1)
    table: NDArray[np.uint8] = np.vstack([np.rint(scale), _rgb(named["no_answer"])]).astype(np.uint8)
    return table


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


Limits = tuple[float, float, float, float]
"""Limits of a layer: the quantiles of 1 % and 99 %, the lowest value and the highest value."""

MOST_PIXELS = 20_000
"""About so many pixels of a layer, evenly spread, are used to find its limits. More pixels would hardly change them."""


def widen(limits: dict[str, Limits], name: str, plane: NDArray[np.floating], /) -> None:
    """Make the limits of a layer wide enough for one more plane of it, (Y, X); values that are not finite are ignored."""
    some = spread_values(plane, MOST_PIXELS)
    values = some[np.isfinite(some)].astype(np.float64)
    if values.size:
        low, high = np.quantile(values, (0.01, 0.99))
        found = (float(low), float(high), float(values.min()), float(values.max()))
        low, high, lowest, highest = zip(limits.get(name, found), found, strict=True)
        limits[name] = min(low), max(high), min(lowest), max(highest)
