"""Draw pixels many times, resolve them, and sum up the errors: what the scripts of docs/limits share."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from cadtof_cli.resolver.paths import ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.units import metres_per_radian
from tests.support.mixtures import C, F, Mixture, noise_of

SEEDS = 20

CM_PER_RAD = 100.0 * metres_per_radian(40.0)
"""Depth per radian of the fundamental, whose period is 40 ns."""


def resolved(phasors: C, harmonics: Sequence[int], n_av: float, settings: ResolverSettings) -> ResolvedPaths:
    """Resolve phasors, (H, n), with the noise that n_av gives."""
    status = np.zeros(phasors.shape[1], np.uint32)
    return resolve_paths(phasors, status=status, settings=settings, noise=noise_of(harmonics, n_av=n_av))


def drawn(light: Mixture, harmonics: Sequence[int], n_av: float, *, pixels: int, key: Sequence[int]) -> C:
    """Draw the phasors of `pixels` pixels under the same light, once per seed, (H, SEEDS × pixels)."""
    generators = (np.random.default_rng([seed, *key]) for seed in range(SEEDS))
    return np.concatenate(
        [light.phasors(harmonics, n_av=n_av, size=pixels, rng=generator) for generator in generators], axis=1
    )


def errors_cm(found: ResolvedPaths, light: Mixture) -> F:
    """Return the errors of the direct depth, in cm."""
    error: F = CM_PER_RAD * np.angle(np.exp(1j * (found.paths[0].phase_rad - light.phases[0])))
    return error


def rms(values: F) -> float:
    """Return the root of the mean square of all values that are not NaN."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def write_csv(path: Path, rows: Iterable[Mapping[str, float]]) -> None:
    """Write rows with the same columns, every number with five significant digits."""
    table = list(rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table[0])
        writer.writerows([f"{value:.5g}" for value in row.values()] for row in table)


def markdown(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *lines))


def power(length: float) -> str:
    """Return an integration length as the pages write it, such as 1e5."""
    return f"{length:.0e}".replace("e+0", "e")


def named_noise(asr: float, n_av: float) -> str:
    """Return an ASR and an integration length as the pages write them."""
    return f"ASR {asr:g}, n_av {power(n_av)}"
