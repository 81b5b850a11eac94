"""Second paths that change evenly over the view, as those by a mirror, a pane or the lens do. A tail's delays never do.

The q_2 of a patch tells the share and the delay of a second path, if there is one. If the light comes by one even
surface, the delays lie on a + b·X + c·Y + d/cos, whatever the shares. In rooms, the delays follow from many surfaces.
If noise hides the delay of each patch, all patches together still tell: two paths with even shares and delays explain
them, apart from noise.
"""

import numpy as np

from cadtof_cli.arrays import Bool, Float, median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.noise import median_of_noise
from cadtof_cli.resolver.diffuse.second_paths import (
    PatchData,
    Scatter,
    SecondPaths,
    further_harmonics_tell,
    has_one_share,
    of_two_paths,
    predict_further_harmonics,
)
from cadtof_cli.resolver.diffuse.tail import wrapped

EVEN_NS = 0.1
"""Threshold on the scatter of delays about an even function of the view, in ns for every unit that the logarithm of the
share scatters. Below it, delays are even. 518 rendered rooms and corners have .2 and more, at any light."""

ALLOWED_UNEVENNESS = (0.012, 0.04)
"""Standard deviations by which two true paths may differ from evenness: logarithm of their share, and ns. The least
uneven of 518 rooms has .03 and .13."""

SCATTER_IN_ROOMS = (0.1, 0.2)
"""Scatter of the logarithm of the share, and of the delay in ns, that nearly all rooms exceed. Typical are .45 and 1."""

LARGEST_MISFIT = 1.1
"""Largest median χ² of the patches, over that of noise, at which even second paths explain them. Frames with such paths have
.6 to 1.05. In 1555 frames of rooms at integration lengths of 2e3 and more, second paths of one share leave 1.2 and more."""

LARGEST_NEIGHBOUR_PRODUCT = 0.12
"""Largest mean product of the residuals of neighbours, over the noise, at which even second paths explain them. Cards have
up to .11. With second paths of one share, corners and rooms whose tail is hidden by noise in each patch have .14 and more."""

LEAST_FOR_ONE_SHARE, LEAST_FOR_EVEN_SHARES = 0.1, 5.0
"""Smallest χ² that the scatter in rooms must add for the test to say something: with second paths of one share, and with
even shares. Even shares come near the least uneven rooms, so such rooms must be told from them, too."""

STEPS = 5
"""Gauss–Newton steps; most patches are near the answer from the beginning."""

ROBUST_STEPS = 2
"""Steps of the linear fit; each one lowers the weight of values that are far off."""

LARGEST_RESIDUAL = 3.0
"""Residual, in standard deviations of the noise, from which a patch is not compared with its neighbours."""

OUTLIER_CHI_SQUARED = 6.0
"""χ² at which a patch keeps a quarter of its weight, in units of the noise level that the median patch shows. Such
patches show edges, or surfaces without a second path."""

TINY = float(np.finfo(np.float64).tiny)
"""Keeps a fit that is exact to the bit from dividing by zero."""

EVEN_COLUMNS = 3
"""How many of the view's columns, 1, X, Y and 1/cos, count as even if noise is large: the first three."""


@dataclass(frozen=True, eq=False)
class PatchPlaces:
    """Where n patches lie.

    Attributes:
        columns: what is even over the view at each patch, (n, 4): 1, the slopes X and Y of its ray, and 1/cos, by which
            all ranges of a plane across the view grow.
        lit: which patches of the frame these are, (rows, columns).
        rad_per_ns: ω of the fundamental.
        noise_correlation: correlation of the noise of neighbours.
    """

    columns: Float
    lit: Bool
    rad_per_ns: float
    noise_correlation: float = 0.0


@dataclass(frozen=True, eq=False)
class _JointFit:
    """How well even second paths explain patches.

    Attributes:
        misfit: median χ², over that of noise.
        room_chi_squared: what the scatter in rooms would add to χ².
        neighbour_product: mean product of the residuals of neighbours, beyond that of their noise.
    """

    misfit: float
    room_chi_squared: float
    neighbour_product: float

    def is_certain(self, least: float, /) -> bool:
        """Return whether there are such second paths; the scatter in rooms must add at least this χ²."""
        if not (self.room_chi_squared >= least and self.misfit <= LARGEST_MISFIT):
            return False
        return self.neighbour_product <= LARGEST_NEIGHBOUR_PRODUCT


def are_two_paths(data: PatchData, places: PatchPlaces, /) -> bool:
    """Return whether the patches have two true paths each.

    Further harmonics show it, if they can tell. If they cannot, one share of the light or evenness shows it.
    """
    with np.errstate(all="ignore"):
        # if a patch has one path, the delay of the other is NaN
        second = SecondPaths.of(data)
        if further_harmonics_tell(second, data):
            return predict_further_harmonics(second, data)
        return has_one_share(second, rad_per_ns=places.rad_per_ns) or are_even(second, data, places)


def are_even(second: SecondPaths, data: PatchData, places: PatchPlaces, /) -> bool:
    """Return whether second paths lie evenly over the view.

    This is asked of each patch by itself first. If that does not decide, the patches are fitted together.
    """
    if second.known.any():
        uneven = _unevenness(second, places, second.known)
        if uneven.most < (EVEN_NS * places.rad_per_ns) ** 2 * second.log_share_scatter.least:
            return True
        if uneven.least > (ALLOWED_UNEVENNESS[1] * places.rad_per_ns) ** 2:
            return False
    return _are_even_together(second, data, places)


def _unevenness(second: SecondPaths, places: PatchPlaces, patches: Bool) -> Scatter:
    """Return the scatter of some patches' delays about an even function of the view."""
    columns, delays, noise = places.columns[patches], _unwrapped(second.later_rad[patches]), second.noise[1, patches]
    return Scatter.of(delays - columns @ _even_part(delays, noise, columns), noise)


def _unwrapped(delays_rad: Float) -> Float:
    """Return delays, (n,), within half a turn of their circular mean, so that delays a turn apart become neighbours."""
    middle = float(np.arctan2(np.sin(delays_rad).sum(), np.cos(delays_rad).sum()))
    return middle + wrapped(delays_rad - middle)


def _are_even_together(second: SecondPaths, data: PatchData, places: PatchPlaces) -> bool:
    """Return whether second paths of even shares and delays, or of one share, explain all patches together."""
    even = _joint_fit(second, data, places, EVEN_COLUMNS)
    # one share is also even, so it need not be tried if this fails
    if not even.misfit <= LARGEST_MISFIT:
        return False
    if even.is_certain(LEAST_FOR_EVEN_SHARES):
        return True
    return _joint_fit(second, data, places, 1).is_certain(LEAST_FOR_ONE_SHARE)


def _joint_fit(second: SecondPaths, data: PatchData, places: PatchPlaces, share_columns: int) -> _JointFit:
    """Return how well even second paths explain the q_2 of all patches.

    The shares are a sum of the first `share_columns` of the view's columns.
    """
    noise, observed = data.noise(0, 0), np.stack([np.log(np.abs(data.ratios[0])), np.angle(data.ratios[0])])
    columns = places.columns[:, :EVEN_COLUMNS]
    share, later_rad = _jointly_fitted(second, observed, noise, columns[:, :share_columns], columns)
    residual, slopes = _residual(observed, share, later_rad)
    squared_slopes = (slopes * np.stack([np.abs(share), np.full_like(share, places.rad_per_ns)])) ** 2
    noise = noise + np.einsum("ikn,k->in", squared_slopes, np.square(ALLOWED_UNEVENNESS))
    in_rooms = (np.einsum("ikn,k->in", squared_slopes, np.square(SCATTER_IN_ROOMS)) / noise).sum(axis=0)
    # some surfaces of the view may have no second path; their patches are compared with q_2 = 1
    single = (observed * observed / noise).sum(axis=0) < (residual * residual / noise).sum(axis=0)
    normalised = np.where(single, observed, residual) / np.sqrt(noise)
    misfit = float(median((normalised * normalised).sum(axis=0))) / median_of_noise(2)
    return _JointFit(
        misfit, float(median(in_rooms)), _neighbour_product(normalised, places.lit) - places.noise_correlation
    )


def _jointly_fitted(
    second: SecondPaths, observed: Float, noise: Float, shares: Float, delays: Float
) -> tuple[Float, Float]:
    """Return the share and the delay, rad, of every patch by a fit to ln|q_2| and arg q_2, (2, n).

    `shares` and `delays` are the columns whose sums the shares and the delays are.
    """
    split = shares.shape[1]
    state = _start(second, shares, delays)
    of_one_path = (observed * observed / noise).sum(axis=0)
    for _ in range(STEPS):
        residual, slopes = _residual(observed, shares @ state[:split], delays @ state[split:])
        chi_squared = (residual * residual / noise).sum(axis=0)
        far = OUTLIER_CHI_SQUARED * float(median(np.minimum(chi_squared, of_one_path))) / median_of_noise(2)
        weight = (1.0 / (1.0 + chi_squared / far) ** 2) / noise
        columns = np.concatenate([slopes[:, 0, :, None] * shares, slopes[:, 1, :, None] * delays], axis=2)
        state = state + _least_squares(columns.reshape(-1, state.size), weight.ravel(), residual.ravel())
    return shares @ state[:split], delays @ state[split:]


def _neighbour_product(residual: Float, lit: Bool) -> float:
    """Return the mean product of the residuals of neighbours, over their noise, (2, n): 0 unless a tail is left.

    Patches with large residuals are left out: they show another surface, whose patches are alike in any case.
    """
    compared: Bool = np.zeros(lit.shape, np.bool_)
    compared[lit] = (np.abs(residual) < LARGEST_RESIDUAL).all(axis=0)
    image = np.zeros((len(residual), *lit.shape))
    image[:, compared] = residual[:, compared[lit]]
    pairs = int((compared[1:] & compared[:-1]).sum() + (compared[:, 1:] & compared[:, :-1]).sum())
    products = (image[:, 1:] * image[:, :-1]).sum() + (image[:, :, 1:] * image[:, :, :-1]).sum()
    return float(products) / (len(residual) * max(pairs, 1))


def _start(second: SecondPaths, shares: Float, delays: Float) -> Float:
    """Return the start of the fit: the even part of the second paths that the patches have, each by itself.

    It is NaN if too few patches show one.
    """
    share_noise, delay_noise = second.noise
    seen = np.isfinite(second.log_share) & np.isfinite(delay_noise) & (share_noise < 1.0)
    if int(seen.sum()) < shares.shape[1] + delays.shape[1]:
        return np.full(shares.shape[1] + delays.shape[1], np.nan)
    share = _even_part(np.exp(second.log_share[seen]), share_noise[seen], shares[seen])
    return np.concatenate([share, _even_part(second.later_rad[seen], delay_noise[seen], delays[seen])])


def _residual(observed: Float, share: Float, later_rad: Float) -> tuple[Float, Float]:
    """Return what ln|q_2| and arg q_2, (2, n), differ by from those of two paths, and the slopes along share and delay."""
    expected, slopes = of_two_paths(share, later_rad, 2)
    residual = observed - expected
    residual[1] = wrapped(residual[1])
    return residual, slopes


def _even_part(values: Float, variance: Float, columns: Float) -> Float:
    """Return the factors of columns, (n, m), whose sum comes near values, (n,); a few outliers do not matter."""
    noise = np.maximum(variance, float(median(variance)) / 9.0)
    weight = 1.0 / noise
    factors = _least_squares(columns, weight, values)
    for _ in range(ROBUST_STEPS):
        squared = (values - columns @ factors) ** 2
        factors = _least_squares(columns, weight / (1.0 + squared / (4.0 * float(median(squared)) + TINY)), values)
    return factors


def _least_squares(columns: Float, weight: Float, values: Float) -> Float:
    """Return the factors of columns, (n, m), whose sum has the least weighted squared distance from values, (n,)."""
    weighted = columns.T * weight
    normal = weighted @ columns
    normal[np.diag_indices_from(normal)] += 1e-12 * np.trace(normal) + TINY
    return np.asarray(np.linalg.solve(normal, weighted @ values))
