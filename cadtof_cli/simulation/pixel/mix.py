"""The light that arrives at a pixel: laser light by one or many paths, and uniform ambient light. The motion of the target."""

import math
from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.errors import require
from cadtof_cli.records import setting
from cadtof_cli.units import C_M_PER_NS, FWHM_PER_SIGMA

MOST_RATIO = 1e12
"""Largest ratio of photons to the laser's photons: above it, rounding errors are larger than the laser's light."""


def require_ratio(value: float, name: str, found: str) -> None:
    """Raise a SettingsError that names the setting if the value is not a ratio of photons from 0 to `MOST_RATIO`."""
    require(0 <= value <= MOST_RATIO, name, found, f"a ratio from 0 to {MOST_RATIO:g}")


def _countable(counts: Float) -> bool:
    return bool(np.all((counts >= 0) & np.isfinite(counts)))


@dataclass(frozen=True, kw_only=True)
class PhotonMix:
    """Photons by origin, for one pixel or for a block of pixels. Only the ratios of the numbers of photons matter.

    Attributes:
        delays_ns: (P, *pixels), arrival times of the P paths; the first path is the direct path.
        photons: (P, *pixels), photons of each path.
        ambient: (*pixels), photons of ambient light, which arrive at all times of the period with equal probability.
        period_ns: period of the laser and of the fundamental.
        fwhm_ns: full width at half maximum of the laser pulse, which is a Gaussian.
        jitter_ns: standard deviation of the detector's timing.
    """

    delays_ns: Float
    photons: Float
    ambient: Float
    period_ns: float
    fwhm_ns: float
    jitter_ns: float = 0.0

    def __post_init__(self) -> None:
        require(_countable(self.photons), "photons", "one below 0, infinite or NaN", "finite numbers of 0 or more")
        require(_countable(self.ambient), "ambient", "one below 0, infinite or NaN", "finite numbers of 0 or more")
        require(self.delays_ns.shape == self.photons.shape, "delays", self.delays_ns.shape, f"{self.photons.shape}")
        require(1e-6 <= self.period_ns < math.inf, "period", f"{self.period_ns:g} ns", "a time above 0")
        require(0 <= self.fwhm_ns <= 1e9, "pulse width", f"{self.fwhm_ns:g} ns", "0 to 1e9 ns")
        require(0 <= self.jitter_ns <= 1e9, "jitter", f"{self.jitter_ns:g} ns", "0 to 1e9 ns")
        require(bool(np.all(self.total > 0)), "photons", "a pixel without any", "some light in every pixel")

    @property
    def total(self) -> Float:
        """Photons of all origins, (*pixels)."""
        return np.asarray(self.photons.sum(axis=0) + self.ambient)

    @property
    def spread_rad(self) -> float:
        """Standard deviation of a path's arrival times, pulse and jitter together, as a phase of the fundamental."""
        return 2.0 * math.pi * math.hypot(self.fwhm_ns / FWHM_PER_SIGMA, self.jitter_ns) / self.period_ns

    def shares(self) -> Float:
        """Return each path's share of all photons, (P, *pixels)."""
        return np.asarray(self.photons / self.total)

    def jittered(self, jitter_ns: float) -> "PhotonMix":
        """Return the same photons, as a detector with this timing jitter sees them."""
        return replace(self, jitter_ns=jitter_ns)

    def later(self, delay_ns: float) -> "PhotonMix":
        """Return the same photons, with a delay added to every path."""
        return replace(self, delays_ns=self.delays_ns + delay_ns) if delay_ns else self

    def moments(self, highest: int) -> Complex:
        """Return m_k = E exp(i k 2π t / T1) over all photons, k = 0 … highest, as (highest + 1, *pixels).

        Ambient light adds to m_0 alone; the Gaussian pulse gives m_k the factor r_k = exp(−(k 2π s / T1)² / 2).
        """
        turn = np.exp(2j * math.pi / self.period_ns * self.delays_ns)
        power = self.shares().astype(np.complex128)
        moments = np.empty((highest + 1, *self.photons.shape[1:]), dtype=np.complex128)
        moments[0] = 1.0
        for k in range(1, highest + 1):
            power *= turn
            moments[k] = math.exp(-((k * self.spread_rad) ** 2) / 2.0) * power.sum(axis=0)
        return moments


@dataclass(frozen=True, kw_only=True)
class Condition:
    """The paper's light on a pixel: laser : MPI : ambient = 1 : mpi_ratio : asr, with arrival times within one period.

    `further` holds paths of MPI besides the paper's single one: for each, its photons over the laser's, and its arrival in ns.
    """

    asr: float
    mpi_ratio: float
    direct_ns: float = 5.0
    second_ns: float = 16.0
    fwhm_ns: float = 1.7
    further: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        require_ratio(self.asr, "ASR", f"{self.asr:g}")
        require_ratio(self.mpi_ratio, "MPI ratio", f"{self.mpi_ratio:g}")
        require(0 <= self.fwhm_ns <= 1e9, "pulse width", f"{self.fwhm_ns:g} ns", "0 to 1e9 ns")
        for ratio, _ in self.further:
            require_ratio(ratio, "path", f"a ratio of {ratio:g}")

    @property
    def ratios(self) -> tuple[float, ...]:
        """Photons of every path over the laser's, the direct path first."""
        return 1.0, self.mpi_ratio, *(ratio for ratio, _ in self.further)

    @property
    def times_ns(self) -> tuple[float, ...]:
        """Arrival time of every path, the direct path first."""
        return self.direct_ns, self.second_ns, *(time for _, time in self.further)

    def mix(self, period_ns: float) -> PhotonMix:
        """Return the photons of one pixel, without pixel axes; raise SettingsError if a path comes too early or late."""
        require(0 <= self.direct_ns < period_ns, "direct", f"{self.direct_ns:g} ns", f"0 to less than {period_ns:g} ns")
        names = ("second", *("path" for _ in self.further))
        for name, ratio, time_ns in zip(names, self.ratios[1:], self.times_ns[1:], strict=True):
            separation = time_ns - self.direct_ns
            require(
                (ratio == 0 and math.isfinite(time_ns)) or (separation > 0 and time_ns < period_ns),
                name,
                f"{time_ns:g} ns, a separation of {separation:g} ns",
                f"a time after the direct {self.direct_ns:g} ns and before the period's end at {period_ns:g} ns",
            )
        return PhotonMix(
            delays_ns=np.array(self.times_ns),
            photons=np.array(self.ratios),
            ambient=np.array(self.asr),
            period_ns=period_ns,
            fwhm_ns=self.fwhm_ns,
        )


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The speed of the scene away from the camera, and the number of frames, with all harmonics, per second.

    Every harmonic has an equal share of a frame's time. It records the light of the moment when it is read, because the average
    forgets within n_av photons, which is a small part of that time. The truth of a frame holds for the middle of these moments.
    """

    speed_m_s: float = setting(
        0.0,
        "Speed of the scene away from the camera; the harmonics are recorded one after the other.",
        option="--speed",
        metavar="M_PER_S",
    )
    frame_rate_hz: float = setting(
        30.0,
        "Frames per second, with --speed; a frame's time is shared equally by its harmonics.",
        option="--frame-rate",
        metavar="HZ",
    )

    def __post_init__(self) -> None:
        light_m_s = 1e9 * C_M_PER_NS
        require(abs(self.speed_m_s) < light_m_s, "speed", f"{self.speed_m_s:g} m/s", "less than the speed of light")
        rate = self.frame_rate_hz
        require(1e-6 <= rate < math.inf, "frame rate", f"{rate:g} Hz", "a rate of 1e-6 Hz or more")

    def delays_ns(self, harmonics: int, /) -> tuple[float, ...]:
        """Return, for each of so many harmonics, how much later all light comes than in the middle of the frame."""
        between_s = 1.0 / (harmonics * self.frame_rate_hz)
        middle = 0.5 * (harmonics - 1)
        return tuple(2.0 * self.speed_m_s * (row - middle) * between_s / C_M_PER_NS for row in range(harmonics))


AT_REST = Motion()
