"""Ranges of flat walls → the length that field curvature adds to all ranges. Every wall's distance and tilt are fitted
too."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.calibration.fit.robust import SURE, RobustFit, blocks, robust_fit
from cadtof_cli.calibration.parts import FieldCurvature, Origin
from cadtof_cli.calibration.petzval import PetzvalCalibration, PetzvalQuality, WallFit
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.errors import SettingsError
from cadtof_cli.optics import LampBeside
from cadtof_cli.units import counted, unambiguous_range_m

LEAST_PIXELS = 50
"""Least number of pixels of a wall to which its distance and tilt are fitted."""

DISTINCT_DISTANCES = 1.2
"""Least ratio of the farthest to the nearest distance of a wall with which the focal length can be fitted."""

MIDDLE = 0.1
"""Share of a wall's pixels, those nearest to the principal point, that are its middle."""

OFF_WALL_M = 0.02
"""A block lies on its wall if its median departs from the wall by no more than this, plus the noise of a pixel."""

LEAST_ON_WALL = 0.6
"""Least share of a wall's blocks that must lie on the wall; only pixels with a single path are in blocks."""

LARGEST_STDERR_M = 0.01
"""Standard error of a coefficient above which the user is warned; it is the standard error of the depth in the corners."""

HIGH_CORRELATION = 0.999
"""Correlation of a coefficient with a wall's parameters above which the user is warned that they can hardly be told apart."""

LARGEST_DISTANCE_ERROR_M = 0.01
"""A wall is refused if its given distance differs by more than this, and surely, from the one that its frames show."""

DISTANCE_ERROR_M = 0.001
"""The user is warned if a given distance differs by more than this, and surely, from the one that the frames show."""

LARGEST_K2_M = 0.5
"""Largest |k2| that is taken for field curvature. Lenses have some centimetres."""

MANY_OUTLIERS = 0.05
"""Share of outliers, among the pixels with a single path, above which the user is told. Noise alone makes far fewer."""

LARGEST_RESIDUAL = 1.5
"""Ratio of the residuals to the noise above which the user is warned."""

_Q, _DISTANCES = 2, slice(3, None, 3)
"""Places of q, and of the distances of the walls, among the parameters of the fit."""


@dataclass(frozen=True, eq=False)
class WallRanges:
    """The measured ranges of one wall and their standard deviations in m, (Y, X); NaN in pixels without a single path.

    `distance_m` is the distance along the optical axis; None if it is not known.
    """

    range_m: Float
    sigma_m: Float
    distance_m: float | None


@dataclass(frozen=True, eq=False)
class _Problem:
    """The problem of the fit: range = D √(1 + q ρ²)/(1 + αu + βv) + k2 ρ² + k4 ρ⁴.

    With a `lamp` beside the camera, half the way of the light takes the place of the range: the lens lengthens the way.

    Its parameters are k2, k4 and q, then distance D and tilt α, β of every wall. `start` holds what the frames show at first
    sight, `given` the values that are known, and NaN for others. u and v are the pixel's distances from the principal
    `point`, over `half_diagonal`, and q = (half diagonal / f)². `wall` is the index of the wall of each of the n ranges,
    which are those of the `usable` pixels, (Y, X) per wall.
    """

    usable: Sequence[Bool]
    u: Float
    v: Float
    wall: Index
    range_m: Float
    sigma_m: Float
    point: tuple[float, float]
    half_diagonal: float
    unambiguous_m: float
    start: Float
    given: Float
    lamp: LampBeside | None

    def residuals(self, parameters: Float) -> tuple[Float, Float]:
        """Return the residuals of the ranges, (n,), and the model's derivatives by the parameters, (n, p), both over
        sigma."""
        rho2 = self.u**2 + self.v**2
        slopes = np.zeros((rho2.size, parameters.size))
        slopes[:, 0], slopes[:, 1] = rho2, rho2**2
        curvature = slopes[:, 0] * parameters[0] + slopes[:, 1] * parameters[1]
        q, stretch = parameters[_Q], np.sqrt(1.0 + parameters[_Q] * rho2)
        distance, alpha, beta = parameters[_Q + 1 :].reshape(-1, 3)[self.wall].T
        leaning = 1.0 + alpha * self.u + beta * self.v
        ranges = distance * stretch / leaning
        slopes[:, 2] = 0.5 * ranges * rho2 / (1.0 + q * rho2)
        of_own_wall = np.stack([stretch / leaning, -ranges / leaning * self.u, -ranges / leaning * self.v], axis=1)
        slopes[:, 3:].reshape(rho2.size, -1, 3)[np.arange(rho2.size), self.wall] = of_own_wall
        if self.lamp is not None:
            ranges = self.lamp.half_way_m(ranges)
            slopes[:, 2:] /= self.lamp.range_per_half_way(ranges, slice(None))[:, np.newaxis]
        # ranges wrap at the unambiguous range, so the difference nearest to 0 counts
        half = 0.5 * self.unambiguous_m
        left = (self.range_m - (ranges + curvature) + half) % self.unambiguous_m - half
        return left / self.sigma_m, slopes / self.sigma_m[:, np.newaxis]


def fit_petzval(walls: Sequence[WallRanges], /, *, optics: Optics, origin: Origin) -> PetzvalCalibration:
    """Return the curvature that all walls share, by weighted least squares in which outliers have no weight.

    Raises:
        SettingsError: a wall has too few pixels with a single path; or the focal length is unknown and cannot be
            fitted, for example because the distances of the walls differ too little; or the frames do not show a flat
            wall, or show it at another distance than the given one; or no lens has the curvature.
    """
    usable = [np.isfinite(wall.range_m) & np.isfinite(wall.sigma_m) & (wall.sigma_m > 0.0) for wall in walls]
    for index, good in enumerate(usable):
        if good.sum() < LEAST_PIXELS:
            raise SettingsError(
                f"wall {index + 1} ({origin.captures[index]}): found {good.sum()} pixels with a single path, expected at "
                f"least {LEAST_PIXELS}: is it a flat wall without multi-path interference, and are the dark and response "
                "calibration in the folder?"
            )
    if optics.focal_length_px is None:
        _require_distinct(walls)
    problem = _problem(usable, walls, optics, origin)
    distances = _doubtful_distances(problem, origin)
    fit = robust_fit(problem.residuals, problem.start, given=problem.given)
    if not fit.parameters[_Q] > 0.0:
        raise SettingsError(
            "the focal length is unknown and cannot be found from the walls: the view is too narrow, or they are not flat: "
            "set focal_length_px under [optics] in capture.toml, or --focal-length-px"
        )
    _require_walls(problem, fit, origin)
    _require_lens(problem, fit)
    without = np.where(np.arange(fit.parameters.size) < _Q, 0.0, problem.given)
    flat = robust_fit(problem.residuals, fit.parameters, given=without)
    quality = _quality(problem, fit, flat)
    quality = replace(quality, findings=_findings(problem, quality, fit, optics) + distances)
    (k2, k4), (k2_stderr, k4_stderr) = fit.parameters[:_Q].tolist(), fit.stderr[:_Q].tolist()
    curvature = FieldCurvature(
        k2_m=k2, k4_m=k4, k2_stderr_m=k2_stderr, k4_stderr_m=k4_stderr, principal_point_px=problem.point
    )
    return PetzvalCalibration(origin, curvature, quality)


def _doubtful_distances(problem: _Problem, origin: Origin) -> tuple[str, ...]:
    """Return a finding for each given distance that the frames contradict: the curvature makes up for its error.

    A distance that they contradict by more than `LARGEST_DISTANCE_ERROR_M` raises a SettingsError.
    """
    given, others, findings = problem.given[_DISTANCES], problem.given.copy(), []
    if np.isnan(given).all():
        return ()
    others[_DISTANCES] = np.nan
    shown = robust_fit(problem.residuals, problem.start, given=others)
    for index in np.flatnonzero(~np.isnan(given)):
        distance, expected = float(shown.parameters[_DISTANCES][index]), float(given[index])
        off, unsure = abs(distance - expected), SURE * shown.stderr[_DISTANCES][index]
        if off > LARGEST_DISTANCE_ERROR_M + unsure:
            raise SettingsError(
                f"wall {index + 1} ({origin.captures[index]}): the frames show it at {distance:.3f} m, expected its given "
                f"distance of {expected:g} m, within {1000 * LARGEST_DISTANCE_ERROR_M:.0f} mm: correct distance_m or "
                "--distance, or leave it out; or run `calibrate response` first, if the camera delays all light"
            )
        if off > DISTANCE_ERROR_M + unsure:
            findings.append(
                f"warning: the frames show wall {index + 1} at {distance:.4f} m, {1000 * off:.1f} mm from "
                f"its given distance; if it were not given, k2 would be {shown.parameters[0]:.4f} m: leave it out, unless it is "
                "exact"
            )
    return tuple(findings)


def _require_lens(problem: _Problem, fit: RobustFit) -> None:
    """Make sure that a lens can have the curvature.

    If a given distance is wrong by the unambiguous range, no phase shows it, and a curvature makes up for it: the ranges of
    a flat wall rise less towards the corners the farther it is.
    """
    if abs(fit.parameters[0]) > LARGEST_K2_M + SURE * fit.stderr[0]:
        raise SettingsError(
            f"k2 = {fit.parameters[0]:.3f} m is more than any lens has, expected {LARGEST_K2_M:g} m at most: correct distance_m "
            f"or --distance, which may be wrong by the unambiguous range of {problem.unambiguous_m:.3f} m, or the focal length"
        )


def _require_walls(problem: _Problem, fit: RobustFit, origin: Origin) -> None:
    """Make sure that most blocks of each capture lie on the wall that was fitted to it."""
    for index, where in enumerate(problem.usable):
        here = problem.wall == index
        sigma = problem.sigma_m[here]
        off = fit.residual[here] * sigma
        on = [abs(np.median(off[block])) <= OFF_WALL_M + np.median(sigma[block]) for block in blocks(where)]
        on_wall = float(np.mean(on)) if on else 1.0
        if on_wall < LEAST_ON_WALL:
            raise SettingsError(
                f"wall {index + 1} ({origin.captures[index]}): {on_wall:.0%} of the parts with a single path lie on a flat "
                f"wall, within {1000 * OFF_WALL_M:.0f} mm and noise, expected {LEAST_ON_WALL:.0%} or more: it is not a flat "
                "wall, or is distorted by other light (MPI: floor, corners, glossy objects). Take a plain wall that fills the "
                "view; other things in view may hide a third of it"
            )


def _require_distinct(walls: Sequence[WallRanges]) -> None:
    medians = [wall.distance_m or float(np.nanmedian(wall.range_m)) for wall in walls]
    if max(medians) < DISTINCT_DISTANCES * min(medians):
        found = f"{counted(len(walls), 'wall')} at {', '.join(f'{median:.2f} m' for median in medians)}"
        raise SettingsError(
            f"the focal length is unknown, and {found} cannot separate the ranges of a flat wall from field curvature: set "
            "focal_length_px under [optics] in capture.toml, or --focal-length-px, or record walls at distances that differ by "
            f"{DISTINCT_DISTANCES - 1:.0%} or more"
        )


def _problem(usable: list[Bool], walls: Sequence[WallRanges], optics: Optics, origin: Origin) -> _Problem:
    """Return the problem for the usable pixels. It starts at walls that face the camera, at their median distance. A given
    distance says by how many unambiguous ranges this is farther than the frames show."""
    point, half_diagonal = optics.principal_point(origin.pixels), 0.5 * math.hypot(*origin.pixels)
    focal = optics.focal_length_px
    pixels = [np.nonzero(good) for good in usable]
    u = np.concatenate([(column - point[0]) / half_diagonal for _, column in pixels])
    v = np.concatenate([(row - point[1]) / half_diagonal for row, _ in pixels])
    whose = np.repeat(np.arange(len(walls)), [good.sum() for good in usable])
    ranges, sigma_m = (
        np.concatenate([values[good] for values, good in zip(planes, usable, strict=True)])
        for planes in ([wall.range_m for wall in walls], [wall.sigma_m for wall in walls])
    )
    q, unambiguous = 0.5 if focal is None else (half_diagonal / focal) ** 2, unambiguous_range_m(origin.periods_ns[0])
    start, given = [0.0, 0.0, q], [np.nan, np.nan, np.nan if focal is None else q]
    for index, wall in enumerate(walls):
        here = whose == index
        shown = _median_distance_m(ranges[here], (u**2 + v**2)[here], q, unambiguous)
        if wall.distance_m is not None:
            shown += unambiguous * round((wall.distance_m - shown) / unambiguous)
        start += [shown, 0.0, 0.0]
        # a wall on one row or one column of pixels shows no tilt across it
        tilts = (np.nan if np.ptp(one) > 0.0 else 0.0 for one in (u, v))
        given += [np.nan if wall.distance_m is None else wall.distance_m, *tilts]
    lamp = LampBeside.of(optics, origin.pixels)
    if lamp is not None:
        lamp = replace(lamp, along_m=np.concatenate([lamp.along_m[good.ravel()] for good in usable]))
        ranges = lamp.half_way_m(ranges)
        sigma_m = sigma_m / lamp.range_per_half_way(ranges, slice(None))
    return _Problem(
        usable=usable,
        u=u,
        v=v,
        wall=whose,
        range_m=ranges,
        sigma_m=sigma_m,
        point=point,
        half_diagonal=half_diagonal,
        unambiguous_m=unambiguous,
        start=np.array(start),
        given=np.array(given),
        lamp=lamp,
    )


def _median_distance_m(ranges: Float, rho2: Float, q: float, unambiguous_m: float) -> float:
    """Return the median distance of a wall that faces the camera. Its corners may lie beyond the unambiguous range: they
    count as near what the middle shows."""
    stretch = np.sqrt(1.0 + q * rho2)
    middle = float(np.median((ranges / stretch)[rho2 <= np.quantile(rho2, MIDDLE)]))
    turns = np.round((middle * stretch - ranges) / unambiguous_m)
    return float(np.median((ranges + turns * unambiguous_m) / stretch))


def _quality(problem: _Problem, fit: RobustFit, flat: RobustFit) -> PetzvalQuality:
    kept, sigma, errors = fit.weights > 0.0, problem.sigma_m, fit.stderr
    after, before = fit.residual * sigma, flat.residual * sigma
    correlation = fit.covariance / np.maximum(np.outer(errors, errors), np.finfo(np.float64).tiny)
    return PetzvalQuality(
        rms_before_m=_rms(before[kept]),
        rms_after_m=_rms(after[kept]),
        noise_rms_m=_rms(sigma[kept]),
        correlation=float(np.abs(correlation[:2, 2:]).max(initial=0.0)),
        focal_length_px=float(problem.half_diagonal / np.sqrt(fit.parameters[_Q])),
        focal_length_known=not np.isnan(problem.given[_Q]),
        walls=tuple(_wall_fit(problem, index, fit, flat) for index in range(len(problem.usable))),
    )


def _wall_fit(problem: _Problem, index: int, fit: RobustFit, flat: RobustFit) -> WallFit:
    here = (fit.weights > 0.0) & (problem.wall == index)
    distance, alpha, beta = fit.parameters[_Q + 1 :].reshape(-1, 3)[index]
    lean, sigma = np.sqrt(fit.parameters[_Q]), problem.sigma_m[here]
    return WallFit(
        distance_m=float(distance),
        distance_stderr_m=float(fit.stderr[_DISTANCES][index]),
        distance_known=not np.isnan(problem.given[_DISTANCES][index]),
        slopes=(float(alpha / lean), float(beta / lean)),
        rms_before_m=_rms(flat.residual[here] * sigma),
        rms_after_m=_rms(fit.residual[here] * sigma),
        noise_rms_m=_rms(sigma),
        pixels=int(here.sum()),
    )


def _findings(problem: _Problem, quality: PetzvalQuality, fit: RobustFit, optics: Optics) -> tuple[str, ...]:
    findings = []
    if optics.principal_point_px is None:
        column, row = problem.point
        findings.append(
            f"no principal point given: the middle of the array, column {column:g} and row {row:g}, is taken"
        )
    if not quality.focal_length_known:
        findings.append(f"no focal length given: fitted to the walls, {quality.focal_length_px:.1f} px")
    (k2, k4), (k2_stderr, k4_stderr) = fit.parameters[:_Q], fit.stderr[:_Q]
    uncertain = max(k2_stderr, k4_stderr) > LARGEST_STDERR_M
    if quality.correlation > HIGH_CORRELATION or uncertain:
        findings.append(
            "warning: curvature, distance and tilt can hardly be separated: "
            f"k2 = {k2:.4f} ± {k2_stderr:.4f} m, k4 = {k4:.4f} ± {k4_stderr:.4f} m, correlation with the "
            f"walls' parameters {quality.correlation:.5f}, condition {fit.condition:.2g}; known distances, more walls at other "
            "distances, or a wall that fills the whole view help"
        )
    dropped = 1.0 - (fit.weights > 0.0).mean()
    if dropped > MANY_OUTLIERS:
        findings.append(f"{dropped:.1%} of the pixels with a single path do not lie on the walls and were left out")
    if quality.rms_after_m > LARGEST_RESIDUAL * quality.noise_rms_m:
        findings.append(
            f"warning: the residual, {1000 * quality.rms_after_m:.2f} mm, is more than the noise, "
            f"{1000 * quality.noise_rms_m:.2f} mm: the walls are not flat, the response is not calibrated, "
            "or a given distance or focal length is wrong"
        )
    return tuple(findings)


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
