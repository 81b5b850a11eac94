"""Response calibration: the response of the channel pairs, and each pixel's own phase and gain."""

from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float32, sealed
from cadtof_cli.calibration.parts import FieldCurvature, Maps, Origin, PartKind, Tables, named_planes, stacked
from cadtof_cli.phasors.response import HarmonicResponse


@dataclass(frozen=True)
class ResponseQuality:
    """How well a response was measured.

    Attributes:
        distances_m: distances of the targets.
        residual: root mean square of the residuals over their noise; 1 if only noise is left.
        phase_stderr_rad, gain_stderr: standard errors of one pixel's entry in the maps, one per harmonic.
        term_stderr: standard errors of the fitted terms, relative to G[h,1], one tuple per harmonic.
        findings: why each term was taken or left, and what was assumed, in words.
    """

    distances_m: tuple[float, ...]
    residual: float
    phase_stderr_rad: tuple[float, ...]
    gain_stderr: tuple[float, ...]
    term_stderr: tuple[tuple[float, ...], ...]
    findings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ResponseCalibration:
    """G[h,k] of every harmonic, and each pixel's own phase and gain: v_h = A·gain_h·Σ_paths a·Σ_k G[h,k]·exp(ik(h·x +
    phase_h)).

    `phase_rad` and `gain` are float32 (H, Y, X). The phase is a delay of the modulation on its way over the array, so
    it stands inside the series. Its mean is 0, because G[h,1] contains the mean delay. The gain is relative to the
    first harmonic. The gain of the first harmonic is 1, because it cannot be told from the target's reflectivity.
    `curvature` was taken out of the phase maps; `resolve` uses it if there is no Petzval calibration. Its standard errors are
    large, because pixels' own phases may look like field curvature by chance.
    `lamp_offset_m` is the place of the lamp with which the ways of the targets' light were computed.
    """

    kind: ClassVar[PartKind] = "response"
    has_maps: ClassVar[bool] = True

    origin: Origin
    responses: tuple[HarmonicResponse, ...]
    phase_rad: Float32
    gain: Float32
    curvature: FieldCurvature
    quality: ResponseQuality
    lamp_offset_m: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        shape = (len(self.origin.harmonics), *self.origin.pixels)
        if tuple(response.harmonic for response in self.responses) != self.origin.harmonics:
            raise ValueError(f"found responses of other harmonics than {self.origin.harmonics}")
        known = len(self.quality.phase_stderr_rad)
        if known != shape[0]:
            raise ValueError(f"phase_stderr_rad: found {known} values, expected one for each of {shape[0]} harmonics")
        for name in ("phase_rad", "gain"):
            values = getattr(self, name)
            if values.shape != shape or not np.isfinite(values).all():
                raise ValueError(f"{name}: found shape {values.shape}, expected finite values of shape {shape}")
            object.__setattr__(self, name, sealed(values.view()))
        if not (self.gain > 0.0).all():
            raise ValueError("gain: found 0 or less, expected gains above 0")

    @property
    def summary(self) -> str:
        """The part in a few words: its orders k."""
        orders = sorted({k for one in self.responses for k, _ in one.terms}, key=lambda k: (abs(k), -k))
        return f"k = {', '.join(map(str, orders[:6]))}{' …' if len(orders) > 6 else ''}"

    def tables(self) -> dict[str, dict[str, Any]]:
        """Return the terms of every harmonic as [k, real part, imaginary part], the field curvature, and the quality of
        the fit."""
        tables: dict[str, dict[str, Any]] = {
            f"harmonic_{response.harmonic}": {"terms": [[k, g.real, g.imag] for k, g in response.terms]}
            for response in self.responses
        }
        tables["field_curvature"] = curvature = asdict(self.curvature)
        point = curvature.pop("principal_point_px")
        tables["optics"] = {"principal_point_px": list(point), "lamp_offset_m": list(self.lamp_offset_m)}
        return tables | {"quality": asdict(self.quality)}

    def maps(self) -> dict[str, NDArray[Any]]:
        """Return phase and gain per harmonic."""
        harmonics = self.origin.harmonics
        return named_planes("phase", self.phase_rad, harmonics) | named_planes("gain", self.gain, harmonics)

    @classmethod
    def from_stored(cls, origin: Origin, tables: Tables, maps: Maps) -> Self:
        """Build the calibration from its tables and maps."""
        quality = tables["quality"]
        return cls(
            origin,
            tuple(
                HarmonicResponse(h, tuple((int(k), complex(re, im)) for k, re, im in tables[f"harmonic_{h}"]["terms"]))
                for h in origin.harmonics
            ),
            stacked(maps, "phase", origin.harmonics),
            stacked(maps, "gain", origin.harmonics),
            FieldCurvature.from_tables(tables["field_curvature"], tables["optics"]),
            ResponseQuality(
                tuple(quality["distances_m"]),
                float(quality["residual"]),
                tuple(quality["phase_stderr_rad"]),
                tuple(quality["gain_stderr"]),
                tuple(tuple(errors) for errors in quality["term_stderr"]),
                tuple(quality["findings"]),
            ),
            tuple(map(float, tables["optics"]["lamp_offset_m"])),
        )
