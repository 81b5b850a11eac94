"""What pooling neighbours does to errors, to sigma and to edges."""

from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import read_stored
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.files.layers import read_layers
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.noise import MAD_PER_SIGMA
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, frame_voltages
from cadtof_cli.simulation.scene.scenes import Wall
from cadtof_cli.units import C_M_PER_NS
from cadtof_cli.workflows.simulate.record import expose
from solvers.printed import row, table
from tests.support.mixtures import F, Mixture, recorded

CARD = Path(__file__).resolve().parents[2] / "sample_data" / "card"

CLEAN_ROWS = 40
"""Rows at the top of the card that have no MPI."""


def pooling() -> None:
    """Print the effect of pooling on the card below its clean rows, on a wall, and beside an edge."""
    table("the card", "direct RMSE, cm", "of that without pooling (5 × 5: ≤ 0.35)", "true errors over sigma")
    (capture,) = find_captures([CARD])
    stored, truth = read_stored(capture.frames[0], capture.layout), read_layers(CARD / "truth.exr")[DIRECT_DEPTH]
    _pooled_rows("", stored, capture.source.metadata, truth, slice(CLEAN_ROWS, None))
    table("a wall at 4 m without MPI, n_av 1e5", "direct RMSE, cm", "of that without pooling", "true errors over sigma")
    camera = Camera()
    metadata = CaptureMetadata(optics=camera.optics, pixel=Pixel(integration_length=1e5))
    exposure = Exposure(scene=Wall(distance_m=4.0), camera=camera, metadata=metadata, seed=3)
    band = expose(exposure)
    _pooled_rows("wall, ", frame_voltages(exposure, band, 0), metadata, band.truth[DIRECT_DEPTH], slice(None))
    table("step of 30 cm, ASR 2, MPI 0.3, n_av 1e5", "columns beside the edge off by > 3 cm")
    for window in (1, 5, 7):
        row(f"beside a step, {window} × {window}", _smeared_columns(window))


def _pooled_rows(of: str, stored: Stored, metadata: CaptureMetadata, truth: F, rows: slice) -> None:
    """Print the errors of the direct depth in some rows of a frame, without pooling and with it."""
    alone = 0.0
    for window in (1, 3, 5, 7):
        plan = FramePlan(metadata=metadata, settings=MapSettings(pool=window))
        maps = resolve_frame(stored, plan=plan).maps
        depth, sigma = (maps.layer(name)[rows].astype(np.float64) for name in (DIRECT_DEPTH, DIRECT_SIGMA))
        error = depth - truth[rows]
        rmse = 100.0 * float(np.sqrt(np.nanmean(error**2)))
        alone = alone or rmse
        spread = float(np.nanmedian(np.abs(error / sigma))) / MAD_PER_SIGMA
        row(f"{of}{window} × {window}", f"{rmse:.3f}", f"{rmse / alone:.3f}", f"{spread:.2f}")


def _smeared_columns(window: int) -> int:
    """Return how many columns, of 20 on each side of a step of 30 cm, have a median direct depth that is off by more
    than 3 cm."""
    rng = np.random.default_rng(3)
    harmonics, n_av, height, width, metres = (1, 2), 1e5, 60, 40, C_M_PER_NS / 2.0
    delays = (8.0, 8.0 + 0.3 / metres)
    halves = []
    for delay in delays:
        light = Mixture((1.0, 0.3), (delay, delay + 9.0), asr=2.0)
        drawn = light.phasors(harmonics, n_av=n_av, size=height * width // 2, rng=rng)
        drawn *= np.array([[light.pulse(h)] for h in harmonics])
        halves.append(np.stack((drawn.real, drawn.imag), axis=1).reshape(2, 2, height, width // 2))
    plan = FramePlan(metadata=recorded(harmonics, n_av=n_av), settings=MapSettings(pool=window))
    maps = resolve_frame(plan.metadata.modulation.amplitude_v * np.concatenate(halves, axis=3), plan=plan).maps
    truth = metres * np.repeat(delays, width // 2)
    return int((np.abs(np.median(maps.layer(DIRECT_DEPTH), axis=0) - truth) > 0.03).sum())
