"""Single photons: the arrival time of each photon, as the phase at which it samples the modulation."""

import math

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.simulation.pixel.mix import PhotonMix


def draw_phases(mix: PhotonMix, generator: np.random.Generator, /, *, count: int, harmonic: int = 1) -> Float32:
    """Return the phases 2π h t/T1 at which the photons of one pixel arrive, float32 (count,), in rad.

    The mix has no pixel axes. One uniform random number per photon decides its origin and, if the photon is ambient light, also
    its arrival time. The arrival time of a laser photon is Gaussian about the delay of its path. float32 resolves 10⁻⁶ of a
    period, a thousandth of the pulse.
    """
    shares = mix.shares()
    ambient = float(mix.ambient / mix.total)
    chance = generator.random(count, dtype=np.float32)
    laser = np.flatnonzero(chance >= ambient) if ambient > 0 else slice(None)
    origin = chance[laser]
    phases = chance if ambient == 0 else np.multiply(chance, np.float32(2.0 * math.pi * harmonic / ambient), out=chance)
    centres = (2.0 * math.pi * harmonic / mix.period_ns * mix.delays_ns).astype(np.float32)
    spread = np.float32(harmonic * mix.spread_rad)
    arrival = generator.standard_normal(len(origin), dtype=np.float32) * spread
    for path, limit in enumerate(ambient + np.cumsum(shares)[:-1]):
        if path == 0:
            arrival += np.where(origin < np.float32(limit), centres[0], centres[1])
        else:
            arrival += (origin >= np.float32(limit)) * (centres[path + 1] - centres[path])
    if len(shares) == 1:
        arrival += centres[0]
    phases[laser] = arrival
    return phases


def draw_detections(
    mix: PhotonMix,
    generator: np.random.Generator,
    /,
    *,
    cycles: int,
    photons_per_cycle: int,
    dead_time_ns: float,
    jitter_ns: float,
) -> Float:
    """Return the times of the photons that a SPAD with dead time detects, float64 (n,), in ns from the first cycle on.

    `photons_per_cycle` photons arrive in each of `cycles` laser periods. Photons that arrive within the dead time after
    a detection are lost; they do not prolong it. `jitter_ns` is the standard deviation of the time that detection adds.
    The mix has no pixel axes, and its own jitter must be 0, because the times at which photons arrive decide which
    photons the SPAD misses, not the times at which it reports them.
    """
    phases = draw_phases(mix, generator, count=cycles * photons_per_cycle).astype(np.float64)
    times = np.mod(phases / (2.0 * math.pi), 1.0).reshape(cycles, photons_per_cycle)
    times += np.arange(cycles)[:, None]
    times = np.sort(times.ravel()) * mix.period_ns
    seen: Float = times[detected(times, dead_time_ns=dead_time_ns)]
    return seen + jitter_ns * generator.standard_normal(len(seen)) if jitter_ns > 0 else seen


def detected(times_ns: Float, /, *, dead_time_ns: float) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the indices of the sorted arrival times (n,) that are detected.

    For every photon, the next photon that would be detected after it is known. Doubling the stride finds the chain of detections
    from the first photon on, in log2(n) steps over all photons at once.
    """
    count = len(times_ns)
    following = np.append(np.searchsorted(times_ns, times_ns + dead_time_ns), count)
    following = np.maximum(following, np.minimum(np.arange(count + 1) + 1, count))
    reached = np.zeros(count + 1, dtype=np.bool_)
    reached[0] = True
    stride = 1
    while stride <= count:
        reached[following[reached]] = True
        following = following[following]
        stride *= 2
    return np.flatnonzero(reached[:count])
