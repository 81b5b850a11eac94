"""Directions drawn about a normal, and evenly spread numbers to draw them from."""

import math

import numpy as np

from cadtof_cli.arrays import Float, Float32

_R2 = (0.7548776662466927, 0.5698402909980532)
"""Steps of the two-dimensional lattice with the smallest gaps (Roberts 2018): 1/g and 1/g², g³ = g + 1."""


def evenly_spread_pairs(count: int, /) -> tuple[Float, Float]:
    """Return `count` evenly spread pairs of numbers in [0, 1); any consecutive pairs are spread evenly too."""
    steps = np.arange(1, count + 1)
    return np.mod(_R2[0] * steps, 1.0), np.mod(_R2[1] * steps, 1.0)


def cosine_weighted(first: Float32, second: Float32, /) -> Float32:
    """Return directions about z with the density cos/π, (3, n), each from two uniform random numbers, (n,) and (n,)."""
    sine, turn = np.sqrt(first), np.float32(2.0 * math.pi) * second
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(np.maximum(1 - first, np.float32(1e-7)))])


def directions_about(normals: Float32, local: Float32, /) -> Float32:
    """Turn directions about the z axis, (3, n), into directions about unit normals, (3, n) (Duff et al. 2017)."""
    x, y, z = normals
    u, v, w = local
    sign = np.where(z >= 0, np.float32(1), np.float32(-1))
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack(
        [
            u * (1 + sign * x * x * a) + v * b + w * x,
            u * sign * b + v * (sign + y * y * a) + w * y,
            -u * sign * x - v * y + w * z,
        ]
    )
