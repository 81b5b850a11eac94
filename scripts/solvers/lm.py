"""The paper's method, as `--solver lm` has it, against scipy and against the closed form."""

import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from limits.drawn import resolved
from numpy.typing import NDArray
from speed.paper_way import paper_way

from cadtof_cli.resolver.paper.solver import TwoShares, two_shares
from cadtof_cli.resolver.paper.starts import RandomStarts
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths
from solvers.bound import NS_PER_RAD, spread
from solvers.printed import row, seconds, table
from tests.support.mixtures import C, Mixture

SEEDS = 20
WRONG = 1e-6
"""A pixel is wrong if the error of a path exceeds this share of all light: the solver then ended in another minimum."""

LIGHTS = (Mixture((1.0, 0.3), (5.0, 16.0)), Mixture((1.0, 0.1), (5.0, 11.0)), Mixture((1.0,), (5.0,)))
"""Light on which lm is measured: two paths, two paths nearer each other with less MPI, and one path."""


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
