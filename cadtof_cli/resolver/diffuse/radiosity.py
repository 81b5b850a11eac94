"""Light between the patches: how much each gets from all others, after one bounce and after more, and how late."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Complex, Complex64, Float, Float32, median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.elementary import rotor
from cadtof_cli.resolver.diffuse.planes import Surfaces
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel, extension

LATER_ALBEDO = 0.65
"""Mean albedo inside the later bounces; it makes their sum finite. Their strength is free in the fit."""

LATER_BOUNCES = 5
"""Bounces that are summed after the second one. .65⁵ of the light is left then, spread over all directions and delays."""

ALBEDO_RANGE = (0.1, 4.0)
"""Smallest and largest albedo of a patch, over the median albedo. A value beyond is a mirror, a lamp or a wrong depth."""

NEAREST_M2 = 1e-6
"""Smallest squared distance of two patches."""

ROWS_AT_ONCE = 60
"""Rows of a matrix whose rotors numpy computes at once: few enough to stay in a processor's cache."""

MOST_AT_ONCE = 4000
"""Entries of a matrix that are multiplied at once. With more, the order of sums may depend on the number of threads."""

T = TypeVar("T", np.float32, np.complex64)


@dataclass(frozen=True, eq=False)
class Interreflections:
    """Light that comes back by way of other surfaces, over direct light, at unit albedo.

    Attributes:
        seen: g_h, light of two bounces by way of surfaces in the view, complex (H, n).
        beyond: b_h, light of two bounces by way of continued surfaces outside the view, complex (H, n).
        later: m_h, light of three bounces and more, complex (H, n).
        direct: direct light of a patch, cos θ/d², float64 (n,).
        open_share: share of what a patch faces that is none of these surfaces, 0 to 1.
    """

    seen: Complex
    beyond: Complex
    later: Complex
    direct: Float
    open_share: Float

    def at(self, rows: list[int], /) -> "Interreflections":
        """Return the light at some of the harmonics, given by their rows."""
        return replace(self, seen=self.seen[rows], beyond=self.beyond[rows], later=self.later[rows])


def interreflections(
    seen: Surfaces,
    beyond: Surfaces,
    amplitude: Float,
    /,
    *,
    harmonics: tuple[int, ...],
    rad_per_m: float,
) -> Interreflections:
    """Solve the radiosity between the patches, whose first phasors have the given amplitudes (n,), and the pieces beyond them.

    E_j = cos θ_j/d_j² is the direct light on patch j, and d_j its way from the lamp. After one more bounce, Σ_j
    K_ij·E_j·exp(ihω d_j/c) reaches patch i, with K_ij = F_ij·a_j·exp(ihω r_ij/c). F_ij = cos θ_i·cos θ_j·A_j/(π r² +
    A_j) is the form factor, and a_j a relative albedo, |p1|·d²/cos θ. The albedo of the receiver cancels against its
    direct light. Later bounces repeat K.
    """
    count = len(seen.range_m)
    both = _joined(seen, beyond)
    albedo = _relative_albedo(seen, amplitude, len(beyond.range_m))
    form, matrix, turn = _light_matrix(both, both, albedo, rad_per_m)
    faced = _gathered(form[:count], np.ones(len(form), np.float32)).astype(np.float64)
    open_share = np.maximum(1.0 - faced, 0.0)
    light, power = np.empty((3, len(harmonics), count), np.complex128), 1
    for row, h in enumerate(harmonics):
        for _ in range(power, h):
            matrix *= turn
        power = h
        arrival = _direct_light(both, h * rad_per_m)
        for bounce, onto in zip(light, _bounces(matrix, arrival, count), strict=True):
            np.divide(onto[:count], arrival[:count], out=bounce[row])
    second, outside, later = light
    return Interreflections(second, outside, later, seen.cosine / seen.range_m**2, open_share)


def light_of(sources: Surfaces, onto: Surfaces, /, *, rad_per_m: float) -> Complex:
    """Return the light that surfaces (n,) get from lit sources of unit albedo in one bounce, over their direct light, (n,)."""
    _, matrix, _ = _light_matrix(onto, sources, np.ones(len(sources.range_m), np.float32), rad_per_m)
    light = _gathered(matrix, _direct_light(sources, rad_per_m).astype(np.complex64))
    return np.asarray(light / _direct_light(onto, rad_per_m), np.complex128)


def _direct_light(onto: Surfaces, rad_per_m: float) -> Complex:
    """Return the direct light on surfaces, cos θ/d², with the phase of its way from the lamp, (n,)."""
    direct, phase = onto.cosine / onto.range_m**2, rad_per_m * onto.range_m
    light = np.empty(direct.shape, np.complex128)
    light.real, light.imag = direct * np.cos(phase), direct * np.sin(phase)
    return light


def _bounces(matrix: Complex64, arrival: Complex, count: int) -> tuple[Complex64, Complex64, Complex64]:
    """Return the second bounce from the first `count` surfaces, that from the other surfaces, and all later bounces.

    The first of the later bounces has unit albedo.
    """
    lit = arrival.astype(np.complex64)
    seen, beyond = _gathered(matrix[:, :count], lit[:count]), _gathered(matrix[:, count:], lit[count:])
    bounce, later = seen + beyond, np.zeros_like(lit)
    for _ in range(LATER_BOUNCES):
        bounce = np.float32(LATER_ALBEDO) * _gathered(matrix, bounce)
        later += bounce
    return seen, beyond, later / np.float32(LATER_ALBEDO)


def _gathered(matrix: NDArray[T], light: NDArray[T]) -> NDArray[T]:
    """Return matrix @ light, a few rows at a time."""
    count, sources = matrix.shape
    rows = max(1, MOST_AT_ONCE // max(1, sources))
    groups, left = divmod(count, rows)
    gathered, rest = np.empty(count, matrix.dtype), slice(count - left, count)
    together = matrix[: rest.start].reshape(groups, rows, sources)
    np.matmul(together, light, out=gathered[: rest.start].reshape(groups, rows))
    np.matmul(matrix[rest], light, out=gathered[rest])
    return gathered


def _relative_albedo(seen: Surfaces, amplitude: Float, beyond: int) -> Float32:
    """Return albedos over their mean by area, float32; the mean stands for surfaces beyond the view."""
    albedo = amplitude * seen.range_m**2 / seen.cosine
    least, largest = ALBEDO_RANGE
    albedo = np.minimum(np.maximum(albedo / median(albedo), least), largest)
    albedo *= seen.area_m2.sum() / (albedo * seen.area_m2).sum()
    return np.concatenate([albedo, np.ones(beyond)], dtype=np.float32)


def _light_matrix(
    onto: Surfaces, sources: Surfaces, albedo: Float32, rad_per_m: float
) -> tuple[Float32, Complex64, Complex64]:
    """Return form factors F_ij from source j to i, K_ij of the fundamental, and exp(iω r_ij/c), (onto, sources) each.

    The height of a point over a plane is an inner product of two vectors of four components. A squared distance is one of five.
    """
    points, planes, square = _points_and_planes(onto)
    lit_points, lit_planes, lit_square = _points_and_planes(sources)
    form, facing = _inner_products(planes, lit_points), _inner_products(points, lit_planes)
    if onto is sources:
        # a surface does not see itself
        form.ravel()[:: len(form) + 1] = 0.0
    ends = np.concatenate([-2.0 * points[:3], points[3:], square])
    r2 = _inner_products(ends, np.concatenate([lit_points[:3], lit_square, lit_points[3:]]))
    area = sources.area_m2.astype(np.float32)
    matrix, turn = np.empty(form.shape, np.complex64), np.empty(form.shape, np.complex64)
    if (kernel := chosen_kernel()) != NUMPY:
        extension().light_matrix(kernel, rad_per_m, facing, r2, area, albedo, form, matrix, turn)
        return form, matrix, turn
    for over_plane in (form, facing):
        np.maximum(over_plane, 0.0, out=over_plane)
    form *= facing
    form *= area
    np.maximum(r2, np.float32(NEAREST_M2), out=r2)
    reach = np.multiply(r2, np.float32(np.pi), out=facing)
    reach += area
    reach *= r2
    form /= reach
    for row in range(0, len(form), ROWS_AT_ONCE):
        these = slice(row, row + ROWS_AT_ONCE)
        cos, sin = rotor(np.sqrt(r2[these]) * np.float32(rad_per_m))
        sent = form[these] * albedo
        turn.real[these], turn.imag[these] = cos, sin
        matrix.real[these], matrix.imag[these] = sent * cos, sent * sin
    return form, matrix, turn


def _points_and_planes(of: Surfaces) -> tuple[Float32, Float32, Float32]:
    """Return points (x, y, z, 1) and planes (normal, −offset), whose inner product is a height; and |point|², (1, n)."""
    point, normal = (of.ray * of.range_m).astype(np.float32), of.normal.astype(np.float32)
    one, square = np.ones((1, point.shape[1]), np.float32), (point * point).sum(0, keepdims=True)
    return np.concatenate([point, one]), np.concatenate([normal, -(point * normal).sum(0, keepdims=True)]), square


def _inner_products(first: Float32, second: Float32) -> Float32:
    """Return the inner products of all pairs of vectors, (few, n) each, (n, n).

    They have so few components that no number of threads changes the order of the sums.
    """
    products: Float32 = np.matmul(first.T, second)
    return products


def _joined(first: Surfaces, second: Surfaces) -> Surfaces:
    both = zip(vars(first).values(), vars(second).values(), strict=True)
    return Surfaces(*(np.concatenate(pair, axis=-1) for pair in both))
