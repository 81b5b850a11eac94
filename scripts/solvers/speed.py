"""Processor time of a frame by every solver."""

from collections.abc import Callable

import numpy as np

from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.settings import ResolverSettings
from solvers.printed import processor_seconds, row, table
from solvers.triangles import recorded_pair
from tests.support.kernels import by_kernel
from tests.support.mixtures import Mixture, recorded

QVGA = 320 * 240


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
    stored, plan, _ = recorded_pair("triangle", count, 11.0, n_av=1e5, pixels=(240, 320))
    return lambda: resolve_frame(stored, plan=plan)
