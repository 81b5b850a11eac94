"""Everything that decides the maps of a frame, besides its pixels: metadata, settings, calibration.

Commands read the defaults of their options here, so heavy modules are imported only when they are needed.
"""

import math
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import require
from cadtof_cli.records import dataclass, setting
from cadtof_cli.resolver.settings import CLOSED_FORM, ResolverSettings
from cadtof_cli.units import size_text

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration
    from cadtof_cli.files.maps import MapHeader
    from cadtof_cli.maps.layers import Layer

DepthKind = Literal["range", "z"]

MOST_POOLED = 255
"""Largest side of the square of neighbours. The time of pooling grows with the square of the side, to minutes per frame."""

MOST_AVERAGED = 1_000_000
"""Largest number of frames that are averaged into one: days of recording."""

DEPTH_IN_WORDS: dict[DepthKind, str] = {"range": "radial range", "z": "planar depth z"}


@dataclass(frozen=True, kw_only=True)
class MapSettings:
    """The settings of maps that a user can choose."""

    resolver: ResolverSettings = field(default_factory=ResolverSettings)
    depth: DepthKind = setting("range", "range: distance along the ray. z: planar depth; needs the focal length.")
    pool: int = setting(
        1,
        "Average N × N neighbouring pixels that see the same light, to reduce noise; N is odd. Adds the layer "
        "effective_pixels.",
    )
    average: int = setting(
        1,
        "Average every N consecutive frames of a capture into one, named after the first. The last group may be smaller.",
    )
    roi: tuple[int, int, int, int] | None = setting(
        None, "Region of interest: write maps of columns X0 to X1 − 1 and rows Y0 to Y1 − 1 only."
    )
    min_confidence_v: float | None = setting(
        None,
        "Smallest confidence, in volts, at which a pixel is resolved.  [default: from the noise and --false-alarm]",
        option="--min-confidence",
    )

    def __post_init__(self) -> None:
        require(self.depth in DEPTH_IN_WORDS, "--depth", repr(self.depth), f"one of {', '.join(DEPTH_IN_WORDS)}")
        odd = self.pool in range(1, MOST_POOLED + 1, 2)
        require(odd, "--pool", self.pool, f"an odd number of pixels such as 3 or 5, at most {MOST_POOLED}")
        require(1 <= self.average <= MOST_AVERAGED, "--average", self.average, f"1 to {MOST_AVERAGED} frames")
        x0, y0, x1, y1 = self.roi or (0, 0, 1, 1)
        corners = "X0,Y0,X1,Y1 with 0 ≤ X0 < X1 and 0 ≤ Y0 < Y1"
        require(0 <= x0 < x1 and 0 <= y0 < y1, "--roi", f"{x0},{y0},{x1},{y1}", corners)
        least = self.min_confidence_v or 0.0
        require(math.isfinite(least) and least >= 0.0, "--min-confidence", least, "a voltage, 0 or more")

    @property
    def without_effect(self) -> dict[str, str]:
        """The fields, besides those that the resolver names, that have no effect beside the others, each with the reason."""
        if self.min_confidence_v is None or (self.resolver.order == "auto" and self.resolver.max_paths > 1):
            return {}
        return {"false_alarm": "with --min-confidence and a given number of paths"}

    def require_roi_within(self, pixels: tuple[int, int], /, *, of: str) -> None:
        """Raise SettingsError if the region of interest is not inside the (Y, X) pixels; the message names the frame or
        capture `of`."""
        if self.roi:
            found, (_, _, x1, y1) = ",".join(map(str, self.roi)), self.roi
            expected = f"it inside the {size_text(pixels)} pixels of {of}"
            require(x1 <= pixels[1] and y1 <= pixels[0], "--roi", found, expected)


@dataclass(frozen=True)
class CalibrationUse:
    """A calibration folder and its digest. A worker gets these instead of the calibration, and reads the folder once.

    `curved` says whether field curvature is taken out of the ranges, `sine` whether the calibrated response is a pure
    sine, as far as the calibration knows.
    """

    folder: Path
    digest: str
    curved: bool = True
    sine: bool = True


@dataclass(frozen=True, kw_only=True)
class FramePlan:
    """What to do with the frames of a capture.

    Attributes:
        metadata: how the frames were recorded.
        settings: the choices of the user.
        calibration: the calibration that is applied to the frames; None: none.
    """

    metadata: CaptureMetadata
    settings: MapSettings = field(default_factory=MapSettings)
    calibration: CalibrationUse | None = None

    def __post_init__(self) -> None:
        modulation, resolver = self.metadata.modulation, self.settings.resolver
        if self.settings.depth == "z" or any(self.metadata.optics.lamp_offset_m or ()):
            from cadtof_cli.optics import known_focal_length

            known_focal_length(self.metadata.optics)
        calibrated_sine = self.calibration is None or self.calibration.sine
        # raises an error if no solver fits
        resolver.solver_module(modulation.harmonics, sine=calibrated_sine and modulation.waveform == "sine")

    def __hash__(self) -> int:
        """Return a hash of a few values that tell plans apart. Caches ask for it with every frame, so it has to be quick."""
        return hash((self.metadata.pixel.integration_length, self.settings.pool, self.settings.depth))

    def read_calibration(self) -> "Calibration | None":
        """Return the calibration that is applied; each process reads it once. None: none is applied.

        Raises:
            MetadataError: the calibration cannot be read, or has changed since the plan was made.
        """
        if self.calibration is None:
            return None
        from cadtof_cli.calibration.store import cached_calibration

        return cached_calibration(self.calibration.folder, self.calibration.digest)

    @cached_property
    def resolver(self) -> ResolverSettings:
        """The settings of the resolver, with the least confidence in units of the modulation amplitude, as phasors have
        it."""
        least_v = self.settings.min_confidence_v
        least = None if least_v is None else least_v / self.metadata.modulation.amplitude_v
        return replace(self.settings.resolver, min_confidence=least)

    @cached_property
    def header(self) -> "MapHeader":
        """The header of all maps; the name of the recorded frame is still empty."""
        from cadtof_cli.files.maps import SOURCE, MapHeader

        periods = ", ".join(f"{period:g}" for period in self.metadata.modulation.periods_ns)
        facts = {"depth": DEPTH_IN_WORDS[self.settings.depth], "periods_ns": periods, SOURCE: ""}
        if self.calibration is not None:
            facts["calibration"] = self.calibration.digest
        if self.settings.roi is not None:
            facts["roi"] = ",".join(map(str, self.settings.roi))
        return MapHeader({layer.name: layer.unit for layer in self.layers}, facts)

    @property
    def layers(self) -> "tuple[Layer, ...]":
        """The layers of the maps, besides the status."""
        from cadtof_cli.maps.layers import wanted_layers

        resolver, averaged = self.settings.resolver, self.settings.pool > 1 or self.settings.average > 1
        searched = resolver.solver_module(self.metadata.modulation.harmonics, sine=True) != CLOSED_FORM
        return wanted_layers(paths=resolver.paths, searched=searched, averaged=averaged)
