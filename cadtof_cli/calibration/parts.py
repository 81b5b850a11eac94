"""What parts of a calibration have in common: their origin, the check that they belong to a capture, the field curvature,
the names of their maps."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import WAVEFORMS, CaptureMetadata, Waveform
from cadtof_cli.errors import MetadataError, SettingsError
from cadtof_cli.optics import curvature_m
from cadtof_cli.units import size_text
from cadtof_cli.version import __version__

PartKind = Literal["dark", "response", "petzval"]

PART_KINDS: tuple[PartKind, ...] = get_args(PartKind)
"""The parts of a calibration, in the order in which they are measured and applied."""

Tables = Mapping[str, Mapping[str, Any]]
"""Values by table and key, as a TOML file holds them."""

Maps = Mapping[str, NDArray[Any]]
"""(Y, X) maps by name, as an EXR file holds them: float32, or uint32."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """The origin of a part: the frames that it was made from.

    Attributes:
        captures: folders of the frames.
        frames: number of frames in all of them.
        pixels: (Y, X) of the array.
        periods_ns: modulation periods, the fundamental first.
        waveform: waveform of the modulation.
        used: digests, by kind, of the parts that had been applied to the frames.
        created: time of creation, in UTC.
        version: version of cadtof that made the part.
    """

    captures: tuple[str, ...]
    frames: int
    pixels: tuple[int, int]
    periods_ns: tuple[float, ...]
    waveform: Waveform
    used: Mapping[str, str] = field(default_factory=dict)
    created: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    version: str = __version__

    def __post_init__(self) -> None:
        if self.frames < 1 or min(self.pixels) < 1 or len(self.pixels) != 2:
            raise ValueError(f"found {self.frames} frames of {self.pixels} pixels, expected 1 or more")
        if self.waveform not in WAVEFORMS or not self.periods_ns:
            raise ValueError(f"found waveform {self.waveform!r} and periods {self.periods_ns}")

    @property
    def harmonics(self) -> tuple[int, ...]:
        """Harmonic numbers h."""
        return tuple(round(self.periods_ns[0] / period) for period in self.periods_ns)

    def require_match(self, metadata: CaptureMetadata, pixels: tuple[int, int] | None, /, *, kind: str) -> None:
        """Raise SettingsError unless the part belongs to a capture: the same size of the array, periods and waveform.

        `pixels` is (Y, X), or None if the size is not known yet.
        """
        modulation = metadata.modulation
        checks: list[tuple[str, object, object]] = [("waveform", modulation.waveform, self.waveform)]
        # the harmonics are compared, not the periods: 13.33 and 13.3333 ns are both the third harmonic of 40 ns
        if (modulation.periods_ns[0], modulation.harmonics) != (self.periods_ns[0], self.harmonics):
            checks.append(("periods_ns", list(modulation.periods_ns), list(self.periods_ns)))
        if pixels is not None:
            checks.append(("size", f"{size_text(pixels)} pixels", f"{size_text(self.pixels)} pixels"))
        for name, found, expected in checks:
            if found != expected:
                raise SettingsError(
                    f"the {kind} calibration does not belong to this capture: {name} is {found} in the capture and {expected} "
                    f"in the calibration, made {self.created} from {', '.join(self.captures)}; calibrate with captures of "
                    "the same camera settings"
                )


@dataclass(frozen=True, kw_only=True)
class FieldCurvature:
    """Field curvature of the lens: the length Δ(ρ) = k2 ρ² + k4 ρ⁴ that it adds to every range. The response and Petzval parts
    hold it.

    Attributes:
        k2_m, k4_m: the coefficients; 0 if there is no significant curvature.
        k2_stderr_m, k4_stderr_m: their standard errors.
        principal_point_px: (column, row), from which ρ is measured.
    """

    k2_m: float = 0.0
    k4_m: float = 0.0
    k2_stderr_m: float = 0.0
    k4_stderr_m: float = 0.0
    principal_point_px: tuple[float, float]

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.k2_m, self.k4_m, *self.principal_point_px))):
            raise ValueError(f"found k2 = {self.k2_m}, k4 = {self.k4_m}, expected finite numbers")

    def added_m(self, pixels: tuple[int, int], /) -> Float:
        """Return the length Δ that is added to the range of every pixel, (Y, X), in m."""
        return curvature_m(pixels, self.principal_point_px, (self.k2_m, self.k4_m))

    @classmethod
    def from_tables(cls, coefficients: Mapping[str, Any], optics: Mapping[str, Any], /) -> Self:
        """Build the curvature from the tables of its coefficients, with their standard errors, and of its principal point."""
        column, row = optics["principal_point_px"]
        numbers = {name: float(coefficients[name]) for name in ("k2_m", "k4_m", "k2_stderr_m", "k4_stderr_m")}
        return cls(**numbers, principal_point_px=(float(column), float(row)))


def _plane_names(what: str, harmonics: tuple[int, ...], channels: int) -> list[str]:
    """Return map names such as `phase.H1`, or `offset.H1.SC1` with channels."""
    names = [f"{what}.H{h}" for h in harmonics]
    return [f"{name}.SC{c}" for name in names for c in range(1, channels + 1)] if channels else names


def named_planes(
    what: str, values: NDArray[Any], harmonics: tuple[int, ...], channels: int = 0, /
) -> dict[str, NDArray[Any]]:
    """Return the planes of values, (H, Y, X) or (H, channels, Y, X), each under its name."""
    return dict(zip(_plane_names(what, harmonics, channels), values.reshape(-1, *values.shape[-2:]), strict=True))


def stacked(maps: Maps, what: str, harmonics: tuple[int, ...], channels: int = 0) -> NDArray[np.float32]:
    """Return the maps that `named_planes` has named as one float32 array, (H·channels, Y, X); all must be there."""
    names = _plane_names(what, harmonics, channels)
    missing = [name for name in names if name not in maps]
    if missing:
        raise MetadataError(f"no map named {missing[0]}, found {', '.join(sorted(maps))}")
    return np.stack([np.asarray(maps[name], np.float32) for name in names])
