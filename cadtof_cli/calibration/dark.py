"""Dark calibration: the offset and the noise of each pixel without light, and the defective pixels."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Float32, median, sealed
from cadtof_cli.calibration.parts import Maps, Origin, PartKind, Tables, named_planes, stacked
from cadtof_cli.files.frames import CHANNELS
from cadtof_cli.phasors.frame_mean import median_variance_ratio
from cadtof_cli.phasors.voltages import spread_over
from cadtof_cli.resolver.status import Bit

TYPICAL_PIXELS = 4096
"""About how many pixels the noise of each harmonic is measured with. Defective ones are among them; most pixels are sound."""


class Defect(Bit):
    """Kinds of defects of a pixel, as bits."""

    OFFSET = 1, "an offset far from the other pixels'"
    NOISE = 2, "noise far above the other pixels'"
    DEAD = 4, "a value that hardly changes"
    NOT_FINITE = 8, "a value that is saturated or not finite in a dark frame"


@dataclass(frozen=True, eq=False)
class DarkCalibration:
    """Offsets that do not depend on the light, and the noise of a single dark frame, in V, float32 (H, 2, Y, X) each.

    `defects`, uint32 (Y, X), holds bits of `Defect`. `figures` holds the answer of `quality` from the time when the
    part was made; if it is empty, `quality` computes its figures from the maps. `zero_v` is `zero_counts` of the dark
    frames, in V; 0: none was given, or the file held volts or values without it.

    An offset has two sources: electronics and stray charge, and the mean of the sampled wave. All light adds this mean
    alike, because the average of Eq. (1) is over photons of every origin.
    """

    kind: ClassVar[PartKind] = "dark"
    has_maps: ClassVar[bool] = True

    origin: Origin
    offset_v: Float32
    noise_v: Float32
    defects: NDArray[np.uint32]
    figures: Mapping[str, float] = field(default_factory=dict)
    zero_v: float = 0.0

    def __post_init__(self) -> None:
        shape = (len(self.origin.harmonics), CHANNELS, *self.origin.pixels)
        for name, expected in (("offset_v", shape), ("noise_v", shape), ("defects", self.origin.pixels)):
            values = getattr(self, name)
            if values.shape != expected:
                raise ValueError(f"{name}: found shape {values.shape}, expected {expected}")
            object.__setattr__(self, name, sealed(values.view()))

    @property
    def hot(self) -> Bool:
        """Pixels with a defect, to which `resolve` gives no answer, (Y, X)."""
        return np.asarray(self.defects != 0)

    @property
    def sound_offset_v(self) -> Float32:
        """The offsets in V, (H, 2, Y, X); NaN in pixels with a defect."""
        return np.where(self.hot, np.float32(np.nan), self.offset_v)

    @property
    def summary(self) -> str:
        """The part in a few words."""
        return f"{int(self.hot.sum())} bad pixels"

    def defect_counts(self) -> dict[str, int]:
        """Return the number of pixels with each kind of defect."""
        return {str(bit.name).lower(): int(np.count_nonzero(self.defects & bit)) for bit in Defect}

    def quality(self) -> dict[str, float]:
        """Return figures of the fit in V: mean and spread of the offsets, typical noise of a frame, and the offsets'
        standard error."""
        if self.figures:
            return dict(self.figures)
        sound, frames = ~self.hot, self.origin.frames
        noise = float(np.median(self.noise_v[:, :, sound])) if sound.any() else float("nan")
        noise /= math.sqrt(median_variance_ratio(frames)) if frames > 1 else 1.0
        offsets = self.offset_v[:, :, sound].astype(np.float64)
        return {
            "offset_mean_v": float(offsets.mean()) if sound.any() else float("nan"),
            "offset_std_v": float(offsets.std()) if sound.any() else float("nan"),
            "noise_v": noise,
            "offset_stderr_v": noise / math.sqrt(frames),
        }

    def offset_stderr_v(self) -> tuple[float, ...]:
        """Return the standard error of the offsets of each harmonic, in V, by the noise of its channels; 0 if the noise
        is unknown."""
        whole, noise = self.quality(), spread_over(self.noise_v, TYPICAL_PIXELS).astype(np.float64)
        typical = median(noise.reshape(len(noise), -1))
        if not whole["noise_v"] > 0.0:
            return (0.0,) * len(typical)
        # noise below a count does not show in most pixels: all that is known then is the rounding
        shares = typical / median(noise.ravel()) if typical.all() else np.ones_like(typical)
        return tuple((whole["offset_stderr_v"] * shares).tolist())

    def tables(self) -> dict[str, dict[str, Any]]:
        """Return the quality of the fit, the counts of defects, and the zero of the stored values."""
        tables: dict[str, dict[str, Any]] = {"quality": self.quality(), "defects": self.defect_counts()}
        return tables | ({"voltage": {"zero_v": self.zero_v}} if self.zero_v else {})

    def maps(self) -> dict[str, NDArray[Any]]:
        """Return offsets and noise per channel, and the defects."""
        harmonics, maps = self.origin.harmonics, {"defects": self.defects}
        maps |= named_planes("offset", self.offset_v, harmonics, CHANNELS)
        return maps | named_planes("noise", self.noise_v, harmonics, CHANNELS)

    @classmethod
    def from_stored(cls, origin: Origin, tables: Tables, maps: Maps) -> Self:
        """Build the calibration from its maps, with the figures of its tables."""
        shape = (len(origin.harmonics), CHANNELS, *origin.pixels)
        offset, noise = (stacked(maps, what, origin.harmonics, CHANNELS).reshape(shape) for what in ("offset", "noise"))
        zero = float(tables.get("voltage", {}).get("zero_v", 0.0))
        return cls(origin, offset, noise, np.asarray(maps["defects"], np.uint32), dict(tables["quality"]), zero)
