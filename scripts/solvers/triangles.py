"""Two paths of triangle waves beside those of sines. The frames are samples of the waveform itself."""

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import Waveform
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.units import C_M_PER_NS
from solvers.printed import row, table
from tests.support.campaign import camera
from tests.support.defects import Defects
from tests.support.mixtures import F

WAVEFORMS: tuple[Waveform, ...] = ("triangle", "sine")


def triangles() -> None:
    """Print what two paths of triangle waves leave, beside sines; the frames are samples of the waveform itself."""
    table(
        "MPI 0.3, ASR 5, n_av 2e5 in all",
        "triangles: median error, cm",
        "more than 10 cm off",
        "within 1, 2 sigma",
        "sines: median error, cm",
        "more than 10 cm off",
    )
    for separation in (4.0, 6.0, 11.0, 20.0):
        for count in (2, 3, 4):
            cells: list[str] = []
            for waveform in WAVEFORMS:
                error, sigma = _errors_of(waveform, count, separation)
                cells += [f"{100.0 * np.nanmedian(error):.3f}", f"{np.nanmean(error > 0.1):.2%}"]
                if waveform == "triangle":
                    cells.append(f"{np.nanmean(error < sigma):.3f}, {np.nanmean(error < 2.0 * sigma):.3f}")
            row(f"{separation:g} ns apart, {{{','.join(map(str, range(1, count + 1)))}}}", *cells)


def _errors_of(waveform: Waveform, count: int, separation: float) -> tuple[F, F]:
    """Return the errors of direct depths from .3 to 2.5 m, and their sigma, in m."""
    stored, plan, truth = recorded_pair(waveform, count, separation, n_av=2e5 / count, pixels=(120, 160))
    maps = resolve_frame(stored, plan=plan).maps
    return np.abs(maps.layer(DIRECT_DEPTH) - truth), maps.layer(DIRECT_SIGMA).astype(np.float64)


def recorded_pair(
    waveform: Waveform, count: int, separation: float, *, n_av: float, pixels: tuple[int, int]
) -> tuple[NDArray[np.uint16], FramePlan, F]:
    """Return a frame of two paths, how it is resolved, and the true direct depth, in m."""
    nothing = Defects(phase_rad=(0.0,) * count, gain=(1.0,) * count)
    seen = camera(nothing, waveform=waveform, harmonics=count, pixels=pixels, n_av=n_av)
    truth = np.random.default_rng(1).uniform(0.3, 2.5, pixels)
    ranges, shares = np.stack([truth, truth + C_M_PER_NS / 2.0 * separation]), np.array([1.0, 0.3]) / 6.3
    (stored,) = seen.frames(ranges, shares[:, np.newaxis, np.newaxis] * np.ones_like(ranges), count=1, seed=5)
    settings = MapSettings(resolver=ResolverSettings(mpi_model="discrete"))
    return stored, FramePlan(metadata=seen.metadata, settings=settings), truth
