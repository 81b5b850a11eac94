"""Materials of Mitsuba: matt, glossy, metal, mirror and glass, plain or with a pattern."""

from typing import Any

import mitsuba as mi
import numpy as np

Plugin = dict[str, Any]
"""A plugin of Mitsuba and its parameters."""

Albedo = float | Plugin


def matt(albedo: Albedo) -> Plugin:
    """Return paint or paper."""
    return _both_sides({"type": "diffuse", "reflectance": _texture(albedo)})


def glossy(albedo: Albedo, roughness: float | None = None) -> Plugin:
    """Return lacquer or tiles: a matt ground under a clear coat, which is smooth if no roughness is given."""
    coat: Plugin = {"type": "plastic"} if roughness is None else {"type": "roughplastic", "alpha": roughness}
    return _both_sides({**coat, "diffuse_reflectance": _texture(albedo), "nonlinear": True})


def metal(roughness: float) -> Plugin:
    """Return brushed aluminium."""
    return _both_sides({"type": "roughconductor", "material": "Al", "alpha": roughness})


def mirror() -> Plugin:
    """Return silver."""
    return _both_sides({"type": "conductor", "material": "Ag"})


def pane() -> Plugin:
    """Return a thin sheet of glass."""
    return {"type": "thindielectric", "int_ior": 1.5}


def tiles(dark: float, light: float, across: int) -> Plugin:
    """Return the albedo of a checkerboard."""
    shades = {f"color{i}": _texture(shade) for i, shade in enumerate((dark, light))}
    return {"type": "checkerboard", **shades, "to_uv": mi.ScalarTransform4f().scale([across, across, 1])}


def grain(rng: np.random.Generator, low: float, high: float) -> Plugin:
    """Return a blotchy albedo: smooth noise of four octaves."""
    image = np.zeros((128, 128))
    for octave in range(2, 6):
        knots = rng.standard_normal((2**octave + 1, 2**octave + 1))
        at = np.linspace(0, 2**octave, 128)
        for _ in range(2):
            knots = np.array([np.interp(at, np.arange(len(line)), line) for line in knots.T])
        image += knots / octave
    image = low + (high - low) * np.clip(0.5 + 0.25 * image / image.std(), 0, 1)
    return {"type": "bitmap", "bitmap": mi.Bitmap(image[..., None].astype(np.float32)), "raw": True}


def drawn(rng: np.random.Generator, shine: float = 0.35) -> Plugin:
    """Return the material of a piece of furniture; `shine` is the share that is not matt."""
    kind, albedo = rng.random(), float(rng.uniform(0.12, 0.8))
    if kind < 0.4 * shine:
        return glossy(albedo)
    if kind < 0.8 * shine:
        return glossy(albedo, float(rng.uniform(0.1, 0.3)))
    return metal(float(rng.uniform(0.25, 0.45))) if kind < shine else matt(albedo)


def paint(rng: np.random.Generator) -> Plugin:
    """Return the material of a wall: most are bright and plain, some have wallpaper."""
    low = float(rng.uniform(0.3, 0.6))
    return matt(grain(rng, low, low + 0.25)) if rng.random() < 0.3 else matt(float(rng.uniform(0.45, 0.85)))


def ground(rng: np.random.Generator) -> Plugin:
    """Return a floor: tiles, polished wood or carpet."""
    kind, low = rng.random(), float(rng.uniform(0.12, 0.4))
    if kind < 0.35:
        return matt(tiles(low, low + 0.3, int(rng.integers(4, 9))))
    return glossy(grain(rng, low, low + 0.25)) if kind < 0.7 else matt(low)


def ceiling(rng: np.random.Generator) -> Plugin:
    """Return white paint."""
    return matt(float(rng.uniform(0.65, 0.88)))


def _both_sides(plugin: Plugin) -> Plugin:
    return {"type": "twosided", "side": plugin}


def _texture(albedo: Albedo) -> Plugin:
    return albedo if isinstance(albedo, dict) else {"type": "spectrum", "value": albedo}
