"""Petzval calibration: the length that field curvature adds to every range, measured from flat walls."""

from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Self

from numpy.typing import NDArray

from cadtof_cli.arrays import Float
from cadtof_cli.calibration.parts import FieldCurvature, Maps, Origin, PartKind, Tables


@dataclass(frozen=True)
class WallFit:
    """One wall: its distance along the optical axis, its tilt as slopes (α, β), and root mean squares of its residuals in m.

    Its residuals are those without and with field curvature, and those that noise alone would leave.
    """

    distance_m: float
    distance_stderr_m: float
    distance_known: bool
    slopes: tuple[float, float]
    rms_before_m: float
    rms_after_m: float
    noise_rms_m: float
    pixels: int


@dataclass(frozen=True)
class PetzvalQuality:
    """How well the walls were fitted.

    Attributes:
        rms_before_m: root mean square of the residuals of the best flat walls without curvature.
        rms_after_m: the same for the best flat walls with curvature.
        noise_rms_m: the same if there were only noise, of the frames and of the maps applied to them.
        correlation: largest absolute correlation of a coefficient with a wall's distance, its tilt or the focal length.
        focal_length_px: focal length of the optics, or the fitted one if the optics do not say it.
        focal_length_known: whether the optics say it.
        walls: the fit of each wall.
        findings: assumptions and warnings, in words.
    """

    rms_before_m: float
    rms_after_m: float
    noise_rms_m: float
    correlation: float
    focal_length_px: float
    focal_length_known: bool
    walls: tuple[WallFit, ...]
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PetzvalCalibration:
    """The field curvature, and how well it was measured."""

    kind: ClassVar[PartKind] = "petzval"
    has_maps: ClassVar[bool] = False

    origin: Origin
    curvature: FieldCurvature
    quality: PetzvalQuality

    @property
    def range_offset_m(self) -> Float:
        """The length Δ that is added to the range of every pixel, (Y, X), in m."""
        return self.curvature.added_m(self.origin.pixels)

    @property
    def summary(self) -> str:
        """The part in a few words."""
        return f"k2 = {self.curvature.k2_m:.4f} m, k4 = {self.curvature.k4_m:.4f} m"

    def tables(self) -> dict[str, dict[str, Any]]:
        """Return the coefficients with standard errors, the residuals without and with curvature, and every wall."""
        curvature, quality = asdict(self.curvature), asdict(self.quality)
        point = curvature.pop("principal_point_px")
        walls, findings = quality.pop("walls"), quality.pop("findings")
        residual = {name: quality.pop(name) for name in ("rms_before_m", "rms_after_m", "noise_rms_m", "correlation")}
        tables: dict[str, dict[str, Any]] = {
            "coefficients": curvature,
            "residual": residual,
            "optics": {"principal_point_px": list(point), **quality},
            "findings": {"text": list(findings)},
        }
        return tables | {f"wall_{index}": wall for index, wall in enumerate(walls, start=1)}

    def maps(self) -> dict[str, NDArray[Any]]:
        """Return no maps: the tables hold everything."""
        return {}

    @classmethod
    def from_stored(cls, origin: Origin, tables: Tables, maps: Maps) -> Self:
        """Build the calibration from its tables."""
        optics = dict(tables["optics"])
        curvature = FieldCurvature.from_tables(tables["coefficients"], optics)
        del optics["principal_point_px"]
        walls = [dict(tables[name]) for name in tables if name.startswith("wall_")]
        return cls(
            origin,
            curvature,
            PetzvalQuality(
                walls=tuple(WallFit(**wall | {"slopes": tuple(wall["slopes"])}) for wall in walls),
                findings=tuple(tables["findings"]["text"]),
                **tables["residual"],
                **optics,
            ),
        )
