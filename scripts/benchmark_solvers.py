"""Measure every solver against the Cramér–Rao bound, scipy and the closed form, and print the tables of docs/solvers.md."""

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from limits.drawn import resolved
from numpy.typing import NDArray
from speed.paper_way import paper_way

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import read_stored
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel, Waveform
from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.files.layers import read_layers
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.noise import MAD_PER_SIGMA
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.paper.solver import TwoShares, two_shares
from cadtof_cli.resolver.paper.starts import RandomStarts
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, frame_voltages
from cadtof_cli.simulation.scene.scenes import Wall
from cadtof_cli.units import C_M_PER_NS
from cadtof_cli.workflows.simulate.record import expose
from tests.support.campaign import camera
from tests.support.defects import Defects
from tests.support.kernels import by_kernel
from tests.support.mixtures import C, F, Mixture, recorded

CARD = Path(__file__).resolve().parent.parent / "sample_data" / "card"

CLEAN_ROWS = 40
"""Rows at the top of the card that have no MPI."""

QVGA = 320 * 240
NS_PER_RAD = 40.0 / (2.0 * np.pi)
SEEDS = 20
WRONG = 1e-6
"""A pixel is wrong if the error of a path exceeds this share of all light: the solver then ended in another minimum."""


LIGHTS = (Mixture((1.0, 0.3), (5.0, 16.0)), Mixture((1.0, 0.1), (5.0, 11.0)), Mixture((1.0,), (5.0,)))
"""Light on which lm is measured: two paths, two paths nearer each other with less MPI, and one path."""


WAVEFORMS: tuple[Waveform, ...] = ("triangle", "sine")


def table(*columns: str) -> None:
    print(f"\n| {' | '.join(columns)} |\n|{'|'.join('---' for _ in columns)}|", flush=True)


def row(*cells: object) -> None:
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def seconds(run: Callable[[], object]) -> float:
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def processor_seconds(run: Callable[[], object]) -> float:
    began = time.process_time()
    run()
    return time.process_time() - began


# --- lm against scipy ------------------------------------------------------------------------------------------------


def wrong(found: NDArray[Any], truth: NDArray[Any]) -> int:
    """Return how many pixels have a path that differs from the closed form's; the order of the two paths does not matter."""
    error = np.minimum(np.abs(found - truth).max(axis=0), np.abs(found[::-1] - truth).max(axis=0))
    return int((~(error <= WRONG * np.abs(truth).sum(axis=0))).sum())


def in_closed_form(phasors: C) -> C:
    """Return both paths of every pixel by the closed form, (2, n)."""
    with np.errstate(all="ignore"):
        two = two_paths(fundamental_frame(phasors[0], phasors[1]))
    return np.stack((two.a * (two.cos_x + 1j * two.sin_x), two.b * (two.cos_y + 1j * two.sin_y)))


def _named(light: Mixture) -> str:
    return f"MPI {light.amplitudes[1]} at {light.delays_ns[1]:g} ns" if len(light.amplitudes) > 1 else "no MPI"


def _by_lm(phasors: C, starts: RandomStarts) -> tuple[TwoShares, float]:
    """Return the paths by lm, and its time in s: the shortest of three runs, because the first run also allocates memory."""
    places = np.arange(phasors.shape[1])
    return two_shares(phasors, harmonics=(1, 2), places=places, starts=starts), min(
        seconds(lambda: two_shares(phasors, harmonics=(1, 2), places=places, starts=starts)) for _ in range(3)
    )


def lm(pixels: int) -> None:
    table(
        f"{pixels} pixels, n_av 1e5, ASR 5", "scipy, µs", "lm, µs", "times faster (≥ 30)", "scipy wrong", "lm wrong (≤)"
    )
    starts = RandomStarts(10, 0)
    drawn = [starts.of(np.arange(pixels), number) for number in range(starts.count)]
    each = np.moveaxis(np.array(drawn), 2, 0)
    rng = np.random.default_rng(0)
    for light in LIGHTS:
        phasors = light.phasors((1, 2), n_av=1e5, size=pixels, rng=rng)
        truth = in_closed_form(phasors)
        with np.errstate(all="ignore"):
            ours, fast = _by_lm(phasors, starts)
        began = time.perf_counter()
        with warnings.catch_warnings(action="ignore"):  # of a start that runs out of calls: nine are left
            theirs = np.stack([paper_way(*given) for given in zip(*phasors, each, strict=True)], axis=1)
        slow = time.perf_counter() - began
        row(
            _named(light),
            f"{slow / pixels * 1e6:.0f}",
            f"{fast / pixels * 1e6:.1f}",
            f"{slow / fast:.0f}",
            wrong(theirs, truth),
            wrong(ours.paths.amplitude * (ours.paths.cos + 1j * ours.paths.sin), truth),
        )
    table("lm on {1,2,3}, MPI 0.3, ASR 5, n_av 2e5 in all", "direct over the bound", "second over the bound")
    for separation in (6.0, 11.0, 20.0):
        light, n_av = Mixture((1.0, 0.3), (5.0, 5.0 + separation)), 2e5 / 3
        found = spread(light, (1, 2, 3), n_av, ResolverSettings(solver="lm"), 4000)
        direct, second = found / light.bound_ns((1, 2, 3), n_av)
        row(f"{separation:g} ns apart", f"{direct:.3f}", f"{second:.3f}")


def starts(pixels: int) -> None:
    """Print how well ten random starts do over many seeds, beside the closed form on the same pixels."""
    table(
        f"{SEEDS} seeds × {pixels} pixels, n_av 1e5, ASR 5",
        "wrong of lm: mean",
        "least and most of a seed",
        "direct RMSE, ns: lm, order 2",
        "closed form, order 2",
        "closed form, order test",
    )
    ways = [ResolverSettings(solver="lm", order="2"), ResolverSettings(order="2"), ResolverSettings()]
    for light in LIGHTS:
        shares, errors = [], []
        for seed in range(SEEDS):
            drawn = light.phasors((1, 2), n_av=1e5, size=pixels, rng=np.random.default_rng([seed, 9]))
            with np.errstate(all="ignore"):
                found = two_shares(
                    drawn, harmonics=(1, 2), places=np.arange(pixels), starts=RandomStarts(10, seed)
                ).paths
            missed = wrong(found.amplitude * (found.cos + 1j * found.sin), in_closed_form(drawn))
            shares.append(missed / pixels)
            errors.append([_direct_error(drawn, light, replace(way, seed=seed)) for way in ways])
        rmse = np.sqrt(np.mean(np.square(errors), axis=0))
        row(
            _named(light),
            f"{np.mean(shares):.2%}",
            f"{min(shares):.2%}, {max(shares):.2%}",
            *(f"{error:.3f}" for error in rmse),
        )


def _direct_error(drawn: C, light: Mixture, settings: ResolverSettings) -> float:
    """Return the RMSE of the direct path's delay, in ns."""
    direct = resolved(drawn, (1, 2), 1e5, settings).paths[0].phase_rad
    error = np.angle(np.exp(1j * (direct - light.delays_ns[0] / NS_PER_RAD)))
    return NS_PER_RAD * float(np.sqrt(np.nanmean(np.square(error))))


# --- harmonics and paths against the bound ---------------------------------------------------------------------------


def spread(light: Mixture, harmonics: tuple[int, ...], n_av: float, settings: ResolverSettings, size: int) -> F:
    """Return the standard deviation of every path's delay, in ns, in the order of the paths in the mixture."""
    drawn = light.phasors(harmonics, n_av=n_av, size=size, rng=np.random.default_rng(1))
    found: F = np.array([np.nanstd(path.phase_rad) for path in resolved(drawn, harmonics, n_av, settings).paths])
    return NS_PER_RAD * found


def harmonics(pixels: int) -> None:
    table(
        "MPI 0.3, ASR 5, n_av 2e5 in all",
        "direct std, ns",
        "over the bound (≤ 1.10)",
        "second over the bound",
        "times better than {1,2}",
    )
    for separation in (4.0, 6.0, 11.0, 20.0):
        light = Mixture((1.0, 0.3), (5.0, 5.0 + separation))
        reference = 0.0
        for numbers in ((1, 2), (1, 2, 3), (1, 2, 3, 4), (1, 2, 4)):
            n_av = 2e5 / len(numbers)
            found = spread(light, numbers, n_av, ResolverSettings(), pixels)
            bound = light.bound_ns(numbers, n_av)
            reference = reference or float(found[0])
            row(
                f"{separation:g} ns apart, {{{','.join(map(str, numbers))}}}",
                f"{found[0]:.4f}",
                f"{found[0] / bound[0]:.3f}",
                f"{found[1] / bound[1]:.3f}",
                f"{reference / found[0]:.2f}",
            )


def paths(pixels: int) -> None:
    table("three paths 8 ns apart, ASR 5, n_av 1e6", "std over the bound (≤ 1.15)", "three found")
    for amplitudes in ((1.0, 0.6, 0.4), (1.0, 0.3, 0.2)):
        light = Mixture(amplitudes, (5.0, 13.0, 21.0))
        for numbers in ((1, 2, 3), (1, 2, 3, 4)):
            drawn = light.phasors(numbers, n_av=1e6, size=pixels, rng=np.random.default_rng(2))
            found = resolved(drawn, numbers, 1e6, ResolverSettings(paths=3))
            ratios = [
                np.nanstd(path.phase_rad) * NS_PER_RAD / bound
                for path, bound in zip(found.paths, light.bound_ns(numbers, 1e6), strict=True)
            ]
            row(
                f"{amplitudes}, {{{','.join(map(str, numbers))}}}",
                " / ".join(f"{ratio:.3f}" for ratio in ratios),
                f"{np.isfinite(found.paths[2].phase_rad).mean():.1%}",
            )


# --- triangle waves ---------------------------------------------------------------------------------------------------


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
    stored, plan, truth = _recorded_pair(waveform, count, separation, n_av=2e5 / count, pixels=(120, 160))
    maps = resolve_frame(stored, plan=plan).maps
    return np.abs(maps.layer(DIRECT_DEPTH) - truth), maps.layer(DIRECT_SIGMA).astype(np.float64)


def _recorded_pair(
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


# --- pooling ---------------------------------------------------------------------------------------------------------


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


# --- speed -----------------------------------------------------------------------------------------------------------


def speed(repeats: int) -> None:
    table(
        "QVGA frame, voltages to maps, processor time", "ms", "times the closed form in numpy (three harmonics: ≤ 25)"
    )
    light, one = Mixture((1.0, 0.3), (5.0, 16.0)), Mixture((1.0,), (5.0,))
    three, discrete = Mixture((1.0, 0.6, 0.4), (5.0, 13.0, 21.0)), ResolverSettings(mpi_model="discrete")
    runs: dict[str, Callable[[], object]] = {
        "closed form {1,2} in numpy, two paths": _frame(light, (1, 2), discrete, kernel=NUMPY),
        "closed form {1,2}, two paths": _frame(light, (1, 2), discrete),
        "closed form {1,2}, one path": _frame(one, (1, 2), discrete),
        "likelihood {1,2,3}, two paths": _frame(light, (1, 2, 3), discrete),
        "likelihood {1,2,3}, two paths 6 ns apart": _frame(Mixture((1.0, 0.3), (5.0, 11.0)), (1, 2, 3), discrete),
        "likelihood {1,2,3}, one path": _frame(one, (1, 2, 3), discrete),
        "likelihood {1,2,3,4}, two paths": _frame(light, (1, 2, 3, 4), discrete),
        "lm {1,2}, two paths": _frame(light, (1, 2), ResolverSettings(solver="lm")),
        "lm {1,2,3}, two paths": _frame(light, (1, 2, 3), ResolverSettings(solver="lm")),
        "triangle waves {1,2}, two paths": _frame_of_triangles(2),
        "triangle waves {1,2,3}, two paths": _frame_of_triangles(3),
        "three paths, {1,2,3}": _frame(three, (1, 2, 3), ResolverSettings(paths=3)),
        "closed form {1,2}, pooled 5 × 5": _frame(light, (1, 2), discrete, pool=5),
    }
    times = {name: min(processor_seconds(run) for _ in range(repeats)) for name, run in runs.items()}
    closed = times["closed form {1,2} in numpy, two paths"]
    for name, taken in times.items():
        row(name, f"{taken * 1e3:.0f}", f"{taken / closed:.1f}")


def _frame(
    light: Mixture, harmonics: tuple[int, ...], settings: ResolverSettings, pool: int = 1, kernel: str | None = None
) -> Callable[[], object]:
    n_av = 1e5
    drawn = light.phasors(harmonics, n_av=n_av, size=QVGA, rng=np.random.default_rng(4))
    drawn *= np.array([[light.pulse(h)] for h in harmonics])
    plan = FramePlan(metadata=recorded(harmonics, n_av=n_av), settings=MapSettings(resolver=settings, pool=pool))
    stored = np.stack((drawn.real, drawn.imag), axis=1).reshape(len(harmonics), 2, 240, 320)
    stored *= plan.metadata.modulation.amplitude_v
    return lambda: by_kernel(kernel, resolve_frame, stored.astype(np.float32), plan=plan)


def _frame_of_triangles(count: int) -> Callable[[], object]:
    stored, plan, _ = _recorded_pair("triangle", count, 11.0, n_av=1e5, pixels=(240, 320))
    return lambda: resolve_frame(stored, plan=plan)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "parts", nargs="*", help="which of lm, starts, harmonics, paths, triangles, pooling, speed [default: all]"
    )
    parser.add_argument("--pixels", type=int, default=4000, help="pixels drawn for each row of the accuracy tables")
    parser.add_argument("--scipy-pixels", type=int, default=4000, help="pixels that scipy solves as well, 2 ms each")
    parser.add_argument(
        "--repeats", type=int, default=5, help="number of runs of every timed frame; the fastest counts"
    )
    arguments = parser.parse_args()
    keep_freed_memory()
    parts: dict[str, Callable[[], None]] = {
        "lm": lambda: lm(arguments.scipy_pixels),
        "starts": lambda: starts(arguments.pixels),
        "harmonics": lambda: harmonics(arguments.pixels),
        "paths": lambda: paths(arguments.pixels),
        "triangles": triangles,
        "pooling": pooling,
        "speed": lambda: speed(arguments.repeats),
    }
    for name in arguments.parts or parts:
        if name not in parts:
            parser.error(f"parts: found {name!r}, expected some of {', '.join(parts)}")
        parts[name]()


if __name__ == "__main__":
    main()
