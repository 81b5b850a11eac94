"""Statistics over all runs of a condition: how well the times of the paths are found."""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.simulation.pixel.averaging import averaging_gain
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.pixel import noise_length
from cadtof_cli.simulation.pixel.statistics import time_bounds_ns, voltage_statistics
from cadtof_cli.workflows.simulate.trials import Recordings, Trials

SUCCESS_NS = 1.0
"""Half the width of the paper's success region, Fig. 7."""


@dataclass(frozen=True)
class PathSummary:
    """How well the time of one path was found: times in ns, and the share of runs within ±1 ns. NaN: there is no such path."""

    true_ns: float
    mean_ns: float
    bias_ns: float
    std_ns: float
    bound_ns: float
    within_1ns: float


@dataclass(frozen=True)
class TrialsSummary:
    """Statistics of all runs of a condition.

    Attributes:
        trials: the condition, and how it was recorded and resolved.
        paths: two or more: the direct path, then the paths of the MPI, the strongest first.
        confidence_v: mean magnitude of the first phasor's voltages.
        confidence_model_v: the same magnitude by the analytical model.
        phase_std_rad: standard deviation of the first phasor's phase.
        phase_model_std_rad: the same standard deviation by the analytical model.
        phase_bias_rad: mean of the first phasor's phase minus the phase of the direct path.
        impossible: share of runs whose amplitudes exceed what the modulation can record.
        steps_per_start: mean steps of the paper's search from one start; NaN with any other solver.
    """

    trials: Trials
    paths: tuple[PathSummary, ...]
    confidence_v: float
    confidence_model_v: float
    phase_std_rad: float
    phase_model_std_rad: float
    phase_bias_rad: float
    impossible: float
    steps_per_start: float

    @property
    def direct(self) -> PathSummary:
        """The direct path."""
        return self.paths[0]

    @property
    def second(self) -> PathSummary:
        """The strongest path of the MPI."""
        return self.paths[1]

    @property
    def named_paths(self) -> dict[str, PathSummary]:
        """The paths by name: direct, second, path3 and so on."""
        names = ("direct", "second", *(f"path{number}" for number in range(3, 1 + len(self.paths))))
        return dict(zip(names, self.paths, strict=True))


def summary(trials: Trials, runs: Recordings, /) -> TrialsSummary:
    """Return the statistics of all runs."""
    condition, modulation = trials.condition, trials.model.modulation
    mix = condition.mix(trials.period_ns).jittered(trials.model.jitter_ns)
    gain = averaging_gain(noise_length(trials.model, counted=trials.photon_by_photon))
    model = voltage_statistics(mix, modulation, variance_gain=gain, sample_noise_v=trials.model.sample_noise_v)
    bounds = time_bounds_ns(mix, modulation, model)
    phasors = runs.voltages_v[:, 0, 0] + 1j * runs.voltages_v[:, 0, 1]
    lags = phasors * np.exp(-2j * math.pi * condition.direct_ns / trials.period_ns)
    # phases on both sides of ±π are those of one cluster
    lag = np.angle(lags)
    lag -= _turns(lag - np.angle(lags.mean()))
    lag -= _turns(lag.mean())
    none = np.full(len(phasors), np.nan)
    found = [*runs.times_ns, *[none] * len(condition.ratios)]
    return TrialsSummary(
        trials,
        paths=tuple(
            _path_summary(trials, times, true_ns, float(bounds[path]))
            for times, (path, true_ns) in zip(found, true_times_ns(condition), strict=False)
        ),
        confidence_v=float(np.abs(phasors).mean()),
        confidence_model_v=float(model.confidence_v),
        phase_std_rad=float(np.std(lag, ddof=1)),
        phase_model_std_rad=float(model.phase_precision_rad),
        phase_bias_rad=float(np.mean(lag)),
        impossible=float(np.mean(runs.impossible)),
        steps_per_start=float(np.mean(runs.steps)) if runs.steps.size else math.nan,
    )


def true_times_ns(condition: Condition, /) -> list[tuple[int, float]]:
    """Return, for each row of an answer, the path of the condition and when it arrives; NaN: the path has no light."""
    ratios, times = condition.ratios, condition.times_ns
    rows = [0, *sorted(range(1, len(ratios)), key=lambda path: -ratios[path])]
    return [(path, times[path] if ratios[path] > 0 else math.nan) for path in rows]


def _turns(angles_rad: Float) -> Float:
    """Return the whole turns in angles, in rad; what is left without them lies within ±π."""
    return np.asarray(2.0 * math.pi * np.rint(angles_rad / (2.0 * math.pi)))


def _path_summary(trials: Trials, times_ns: Float, true_ns: float, bound_ns: float) -> PathSummary:
    """Sum up times as errors against the truth. Runs without an answer count in `within_1ns` only, as failures."""
    if math.isnan(true_ns):
        return PathSummary(true_ns, math.nan, math.nan, math.nan, bound_ns, math.nan)
    found, period = times_ns[np.isfinite(times_ns)], trials.period_ns
    errors = _within(found, period) - _within(true_ns, period) if trials.wrapped else _within(found - true_ns, period)
    within = float((np.abs(errors) <= SUCCESS_NS).sum()) / len(times_ns)
    if len(found) < 2:
        return PathSummary(true_ns, math.nan, math.nan, math.nan, bound_ns, within)
    bias = float(errors.mean())
    return PathSummary(true_ns, true_ns + bias, bias, float(errors.std(ddof=1)), bound_ns, within)


def _within(times_ns: Float | float, period_ns: float) -> Float:
    """Return times wrapped to ± half a period."""
    return np.asarray(np.mod(times_ns + period_ns / 2.0, period_ns) - period_ns / 2.0)
