"""What the phases of flat targets show over the array: the curvature of the lens's field, and that the targets were flat."""

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.calibration.fit.pixels import PixelFit, mean_rotor
from cadtof_cli.calibration.fit.robust import SURE, RobustFit, robust_fit, shape_rms
from cadtof_cli.calibration.parts import FieldCurvature, Origin
from cadtof_cli.errors import SettingsError
from cadtof_cli.optics import squared_field_radius
from cadtof_cli.units import metres_per_radian

CURVATURE_SIGNIFICANCE = 4.0
"""Field curvature is taken out of the phases if k2 or k4 is larger than this many standard errors."""

LARGEST_LEAN_M = 0.1
"""Targets are refused if one side of the array sees them nearer than the other side by more than this."""

LARGEST_SHAPE_M = 0.03
"""Targets are refused if the root mean square of the blocks' departures from a wall, seen through a curved field, is
larger."""


def field_curvature(pixels: PixelFit, usable: Bool, /, *, point: tuple[float, float], origin: Origin) -> FieldCurvature:
    """Return the field curvature in the phases of the `usable` pixels, (Y·X,); `point` (column, row) is the principal point.

    Coefficients that are not significant are returned as 0. Their standard errors say how large they may be.
    The lens delays all harmonics alike, and so does a delay of the pixel. They are told apart by the shape over the
    array: the delay of the lens is a polynomial in the distance from the principal point.

    Raises:
        SettingsError: the phases show a lean or a shape of the targets.
    """
    squared = squared_field_radius(origin.pixels, point).ravel()[usable]
    harmonics = np.array(origin.harmonics, np.float64)[:, np.newaxis]
    centred = np.angle(np.exp(1j * pixels.phase) / mean_rotor(pixels.phase)[:, np.newaxis])
    weights = pixels.weights.sum(axis=0)
    information = (weights * harmonics**2).sum(axis=0)
    metres = metres_per_radian(origin.periods_ns[0])
    ranges = metres * (weights * harmonics * centred).sum(axis=0) / information
    sigma = metres / np.sqrt(information)
    rows, columns = np.divmod(np.flatnonzero(usable), origin.pixels[1])
    shapes = np.stack([squared, squared**2, np.ones_like(squared), columns, rows], axis=1)
    shapes[:, 3:] /= max(origin.pixels)

    # an array of one row or one column shows no lean across it
    given = np.where(np.ptp(shapes, axis=0) > 0.0, np.nan, 0.0)
    given[2] = np.nan

    def residual(parameters: Float) -> tuple[Float, Float]:
        return (ranges - shapes @ parameters) / sigma, shapes / sigma[:, np.newaxis]

    fit = robust_fit(residual, np.zeros(5), given=given)
    _require_flat(fit, sigma, usable.reshape(origin.pixels))
    (k2, k4), (k2_stderr, k4_stderr) = fit.parameters[:2].tolist(), fit.stderr[:2].tolist()
    if abs(k2) <= CURVATURE_SIGNIFICANCE * k2_stderr and abs(k4) <= CURVATURE_SIGNIFICANCE * k4_stderr:
        k2, k4 = 0.0, 0.0
    return FieldCurvature(k2_m=k2, k4_m=k4, k2_stderr_m=k2_stderr, k4_stderr_m=k4_stderr, principal_point_px=point)


def _require_flat(fit: RobustFit, sigma: Float, where: Bool) -> None:
    """Make sure that the maps of phase and gain show no object of the scene: it would change every corrected frame."""
    lean = float(np.hypot(*fit.parameters[3:]))
    # pixels differ in their own delays, so a few rows seem to lean by chance
    error = float(np.sqrt(fit.parameters[3:] @ fit.covariance[3:, 3:] @ fit.parameters[3:])) / lean if lean else 0.0
    shape = shape_rms(fit.residual * sigma, where)
    if lean > LARGEST_LEAN_M + SURE * error:
        raise SettingsError(
            f"one side of the array sees the targets {1000 * lean:.0f} mm nearer than the other, expected "
            f"{1000 * LARGEST_LEAN_M:.0f} mm at most: the targets do not face the camera, or light comes by other ways on one "
            "side (MPI: floor, side walls). Point the camera square at a plain wall, clear the sides, and record again"
        )
    if shape > LARGEST_SHAPE_M:
        raise SettingsError(
            f"the targets have a shape: parts of the array deviate from a flat wall by {1000 * shape:.0f} mm, expected "
            f"{1000 * LARGEST_SHAPE_M:.0f} mm at most: they are not flat, something stands before them, or light comes by "
            "other ways (MPI). Take a plain wall that fills the view, and record again"
        )
