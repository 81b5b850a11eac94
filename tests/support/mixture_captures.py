"""Captures on disk with known light."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray

from tests.support.forward import AMPLITUDE_V, T1_NS
from tests.support.mixtures import Mixture


def write_capture(
    folder: Path,
    light: Mixture,
    *,
    harmonics: Sequence[int] = (1, 2),
    n_av: float = 1e5,
    size: tuple[int, int] = (12, 16),
    frames: int = 1,
    seed: int = 1,
) -> Path:
    """Write frames with the same light in all pixels, as float TIFF in volts, and their capture.toml."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    periods = ", ".join(f"{T1_NS / h:.8g}" for h in harmonics)
    (folder / "capture.toml").write_text(
        f"[modulation]\nperiods_ns = [{periods}]\n[pixel]\nintegration_length = {n_av}\n", encoding="utf-8"
    )
    for index in range(frames):
        phasors = light.phasors(harmonics, n_av=n_av, size=size[0] * size[1], rng=rng)
        measured = phasors * np.array([[light.pulse(h)] for h in harmonics]) * AMPLITUDE_V
        planes = np.stack((measured.real, measured.imag), axis=1).reshape(len(harmonics), 2, *size)
        tifffile.imwrite(folder / f"frame_{index:04}.tif", planes.astype(np.float32), metadata={"axes": "QCYX"})
    return folder


def read_maps(path: Path) -> dict[str, NDArray[np.float32]]:
    """Layers of an EXR map by name."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}
