"""Measure the simulation of a pixel: photon by photon, beside numpy's cos and sin of as many float64 values, and by
statistics."""

import argparse
import os
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.execution.workers import Workers
from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.mix import Condition, PhotonMix
from cadtof_cli.simulation.pixel.pixel import CHUNK, PixelModel, pixel_weights, record_pixel
from cadtof_cli.simulation.pixel.statistics import VoltageStatistics, draw_voltages
from cadtof_cli.workflows.simulate.simulate import simulate_trials
from cadtof_cli.workflows.simulate.trials import Trials

REPEATS = 5


def main() -> None:
    """Print the time per photon, the time per voltage, and the time of one whole condition of Table 1."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave out the whole condition")
    arguments = parser.parse_args()
    model = PixelModel(averaging=Averaging(integration_length=1.0e5))
    photons = 2 * pixel_weights(model).shape[1]
    phases = 2 * np.pi * np.random.default_rng(0).random(CHUNK)
    plain = _best(lambda: [(np.cos(phases), np.sin(phases)) for _ in range(photons // CHUNK)])
    print(f"numpy cos + sin, float64:    {photons / plain / 1e6:7.1f} M/s, {1e9 * plain / photons:5.1f} ns each")
    for asr, mpi_ratio in ((5.0, 0.3), (1.0, 0.3), (5.0, 0.0)):
        mix = Condition(asr=asr, mpi_ratio=mpi_ratio).mix(40.0)
        ours = _best(partial(_record, model, mix))
        print(
            f"photons, ASR {asr:g}, MPI {mpi_ratio:3g}:      {photons / ours / 1e6:7.1f} M/s, "
            f"{1e9 * ours / photons:5.1f} ns each, {ours / plain:.2f} of numpy (asked: 3 at most)"
        )
    frame = VoltageStatistics(np.zeros((2, 2, 240, 320)), np.full((2, 3, 240, 320), [[[[1.0]], [[0.5]], [[1.0]]]]))
    drawn = _best(lambda: draw_voltages(frame, np.random.default_rng(1), draws=1))
    print(f"voltages of a frame by statistics: {1e9 * drawn / frame.means_v.size:.1f} ns each")
    if not arguments.quick:
        jobs = len(os.sched_getaffinity(0))
        trials = Trials(condition=Condition(asr=5.0, mpi_ratio=0.3), model=model, photon_by_photon=True)
        begun = time.perf_counter()
        simulate_trials((trials,), workers=Workers(jobs=jobs))
        print(f"400 runs of 2 harmonics at n_av 1e5: {time.perf_counter() - begun:.1f} s on {jobs} cores")


def _record(model: PixelModel, mix: PhotonMix) -> Float:
    return record_pixel(model, mix, np.random.default_rng(1).spawn(2))


def _best(work: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return min(times)


if __name__ == "__main__":
    main()
