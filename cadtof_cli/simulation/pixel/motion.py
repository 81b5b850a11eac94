"""A target that moves while its harmonics are recorded one after the other."""

import math
from dataclasses import dataclass

from cadtof_cli.simulation.pixel.mix import require
from cadtof_cli.units import C_M_PER_NS


@dataclass(frozen=True, kw_only=True)
class Motion:
    """How fast the scene moves away from the camera, and how many frames of all harmonics are recorded a second.

    Every harmonic has an equal share of a frame's time, and sees the light of the moment in which it is read: the average forgets
    within n_av photons, which is little of that time. What is true is true in the middle of the moments of a frame.
    """

    speed_m_s: float = 0.0
    frame_rate_hz: float = 30.0

    def __post_init__(self) -> None:
        require(math.isfinite(self.speed_m_s), "speed", f"{self.speed_m_s:g} m/s", "a finite speed")
        rate = self.frame_rate_hz
        require(math.isfinite(rate) and rate > 0, "frame rate", f"{rate:g} Hz", "a rate above 0")

    def delays_ns(self, harmonics: int, /) -> tuple[float, ...]:
        """Return by how much later all light comes at each of so many harmonics than in the middle of the frame."""
        between_s = 1.0 / (harmonics * self.frame_rate_hz)
        middle = 0.5 * (harmonics - 1)
        return tuple(2.0 * self.speed_m_s * (row - middle) * between_s / C_M_PER_NS for row in range(harmonics))


AT_REST = Motion()
