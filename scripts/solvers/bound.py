"""More harmonics, and three paths, against the Cramér–Rao bound."""

import numpy as np
from limits.drawn import resolved

from cadtof_cli.resolver.settings import ResolverSettings
from solvers.printed import row, table
from tests.support.mixtures import F, Mixture

NS_PER_RAD = 40.0 / (2.0 * np.pi)


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
