"""How far apart colours look to people who see colours in different ways, and in black and white."""

import numpy as np
from numpy.typing import NDArray

SEEN = {
    "by most people": np.eye(3),
    "with protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "with deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "with tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
    "in black and white": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}
"""What becomes of linear sRGB (Machado et al. 2009, doi:10.1109/TVCG.2009.113, severity 1; relative luminance)."""

_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def rgb(*colours: str) -> NDArray[np.float64]:
    """Return colours `#rrggbb` as sRGB from 0 to 1, (N, 3)."""
    return np.array([[int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)] for colour in colours])


def apart(some: NDArray[np.floating], others: NDArray[np.floating], seen: str) -> NDArray[np.float64]:
    """Return the distances of colours in CIELAB, (N, M), of sRGB from 0 to 1, (N, 3) and (M, 3); about 2.3 can just be seen."""
    first, second = (_lab(np.asarray(one, np.float64), SEEN[seen]) for one in (some, others))
    return np.asarray(np.linalg.norm(first[:, None] - second[None], axis=-1))


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours `#rrggbb`, as WCAG 2 defines it."""
    darker, brighter = sorted(_linear(rgb(one, other)) @ SEEN["in black and white"][0])
    return float((brighter + 0.05) / (darker + 0.05))


def _linear(colours: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def _lab(colours: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    white = _XYZ.sum(axis=1)
    x, y, z = (np.clip(_linear(colours) @ seen.T, 0.0, 1.0) @ _XYZ.T / white).T
    roots = [np.where(one > 0.008856, np.cbrt(one), 7.787 * one + 16.0 / 116.0) for one in (x, y, z)]
    return np.stack([116.0 * roots[1] - 16.0, 500.0 * (roots[0] - roots[1]), 200.0 * (roots[1] - roots[2])], axis=-1)
