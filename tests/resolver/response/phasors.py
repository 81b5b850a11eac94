"""Noisy phasors of two paths of triangle waves, for tests that compare compiled code with numpy."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float32
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.response.table import ResponseBlock, response_block

MODULATION = Modulation(waveform="triangle")

TRIANGLE = CaptureMetadata(modulation=MODULATION, pixel=Pixel(integration_length=1e5))

NOISE = noise_model(TRIANGLE, integration_length=1e5, quantised=False)

COUNT = 777


def block(*, phases: bool, harmonics: int = 2) -> ResponseBlock:
    """Return the response of a triangle; with `phases`, every pixel adds its own phases to its paths."""
    turned = np.random.default_rng(4).normal(0.0, 0.3, (harmonics, COUNT)) if phases else None
    periods = tuple(40.0 / h for h in range(1, harmonics + 1))
    model = response_block(
        ideal_response(replace(TRIANGLE, modulation=replace(MODULATION, periods_ns=periods))), turned
    )
    return model.block(slice(0, COUNT))


def paths(seed: int) -> Float32:
    """Return a, x, b, y of two paths in COUNT pixels, (4, n)."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.02, 1.0, (2, COUNT))
    x = rng.uniform(0.0, 2.0 * np.pi, COUNT)
    return np.stack([a, x, b, x + rng.uniform(-3.0, 3.0, COUNT)]).astype(np.float32)


def recorded(values: Float32, response: ResponseBlock) -> NDArray[np.complex128]:
    """Return the noisy phasors of the paths in all harmonics, (H, n)."""
    a, x, b, y = values
    rng, rows = np.random.default_rng(9), []
    for row in range(len(response.stages[-1])):
        f, g = (response.at(row, phase) for phase in (x, y))
        light = a * (f.re + 1j * f.im) + b * (g.re + 1j * g.im)
        rows.append(light + 1e-3 * (rng.normal(size=COUNT) + 1j * rng.normal(size=COUNT)))
    return np.array(rows)
