"""The higher terms of a response that a set of targets can determine, and their values."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.calibration.fit.pixels import Observations, PixelFit, Terms, fit_pixels, series, two_way
from cadtof_cli.calibration.fit.robust import centre_and_spread, scaled_inverse

CANDIDATES = (-1, 0, -3, 5, 3)
"""Orders k that are tried besides 1: imbalance, offset, and the harmonics of waveforms between sine and triangle."""

LARGEST_STDERR = 2e-3
"""Largest standard error of a term that is taken, relative to G[h,1]: 2 mrad are 2 mm at a period of 40 ns."""

LARGEST_CONDITION = 1e4
"""Largest condition number of the normal matrix, with unit diagonal, of the terms that are taken: they can then be told
apart."""

LEAST_SIGNIFICANCE = 6.0
"""Least size of a term that is taken, in standard errors, in at least one harmonic."""

LARGEST_RESIDUAL = 1.5
"""Ratio of the residuals to the noise above which a fit does not explain the targets."""

LEAST_TERM = 2e-4
"""Least size of a term that is taken, relative to G[h,1], in at least one harmonic: 0.2 mm."""

HIGHEST_CONDITION = 1e12
"""Condition of a normal matrix above which rounding leaves no digits of its inverse."""

NO_DIGITS = 1e-9
"""Share of the largest eigenvalue of a normal matrix below which another eigenvalue is rounding."""

PASSES = 4
"""Number of times that terms are chosen and fitted, each time without the outliers of the pass before."""

OUTLIER = 5.0
"""A pixel is an outlier if the root of its misfit exceeds the median by more than this many robust standard deviations."""


@dataclass(frozen=True)
class TermFit:
    """The terms that were taken.

    Attributes:
        terms: all terms of each harmonic, the waveform's among them.
        stderr: standard errors of each harmonic's terms, in the order in which they were taken.
        residual: root mean square of the residuals over the noise; 1 if only noise is left, and if there is one distance.
        findings: why each term was taken or left, in words.
        kept: the pixels to which the terms were fitted, (n,); the other pixels are outliers.
        stretch: distance of each target that fits best, over the given one, (N,); None: these were taken for exact.
    """

    terms: Terms
    stderr: tuple[tuple[float, ...], ...]
    residual: float
    findings: tuple[str, ...]
    kept: Bool
    stretch: Float | None = None


def fit_terms(observed: Observations, base: Sequence[dict[int, complex]], /, *, distances: int) -> TermFit:
    """Return the terms that the observations need and can determine, starting from `base`, G[h,k]/G[h,1] of the ideal waveform.

    `distances` is the number of distinct distances of the targets. With one distance, no term can be told from the
    pixels' own phases.

    Errors of the distances look like terms. If fewer terms and other distances fit surely better, these are taken.
    """
    terms: Terms = tuple(dict(one) for one in base)
    kept = np.ones(observed.phase.shape[1], np.bool_)
    if distances < 2:
        said = (
            "warning: one distance: only k = 1 and the maps are determined. If SC1 and SC2 differ in gain, or the waveform is "
            "not the ideal one, depths at other distances will be wrong, at 5 % by centimetres, and sigma will not say it: "
            "record targets at two or more distances, spread over the range"
        )
        return TermFit(terms, tuple(() for _ in terms), 1.0, (said,), kept)
    orders, exact = _fit(observed, base, kept, free_distances=False)
    if not set(orders) - {-1}:
        return exact
    fewer, free = _fit(observed, base, exact.kept, free_distances=True)
    gain = (exact.residual**2 - free.residual**2) * observed[exact.kept].volts.size
    surely = gain > LEAST_SIGNIFICANCE**2 * len(observed.volts) * free.residual**2
    return free if set(fewer) < set(orders) and surely and free.residual < LARGEST_RESIDUAL else exact


def _fit(
    observed: Observations, base: Sequence[dict[int, complex]], kept: Bool, /, *, free_distances: bool
) -> tuple[tuple[int, ...], TermFit]:
    """Return the orders that were taken, and the fit. With exact distances, `kept` is where it begins: it finds outliers
    itself."""
    changes: Terms = tuple({} for _ in base)
    terms: Terms = tuple(dict(one) for one in base)
    stretch = np.ones(len(observed.volts))
    for _ in range(PASSES):
        system = _System(fit_pixels(observed[kept], terms), terms, base, observed.harmonics, free_distances)
        orders, reasons = system.selection(_needed(changes, system))
        changes = system.changed(changes, orders)
        terms = tuple(composed(start, change) for start, change in zip(base, changes, strict=True))
        if free_distances:
            step = system.stretch(orders)
            stretch *= step
            observed = replace(observed, phase=observed.phase * step[:, np.newaxis])
        else:
            root = np.sqrt(fit_pixels(observed, terms).misfit)
            centre, spread = centre_and_spread(root)
            kept = np.asarray(root <= centre + OUTLIER * spread)
    pixels = fit_pixels(observed[kept], terms)
    system = _System(pixels, terms, base, observed.harmonics, free_distances)
    residual = float(np.sqrt(max(pixels.misfit.sum() - system.explained, 0.0) / system.freedom(len(orders))))
    errors = system.stderr(orders)
    reasons |= {k: _taken(changes, errors[:, index], k) for index, k in enumerate(orders)}
    findings = tuple(f"k = {k:+d}: {reasons[k]}" for k in CANDIDATES)
    found = TermFit(terms, tuple(map(tuple, errors.tolist())), residual, findings, kept)
    return orders, replace(found, stretch=stretch) if free_distances else found


def composed(base: dict[int, complex], changes: dict[int, complex]) -> dict[int, complex]:
    """Return the terms of a waveform `base` after changes by k. A change of k = −1 is an imbalance, which mirrors the
    whole series."""
    terms = dict(base)
    for k, change in changes.items():
        for order, share in _shape(base, k).items():
            terms[order] = terms.get(order, 0j) + change * share
    return terms


def _shape(base: dict[int, complex], k: int) -> dict[int, complex]:
    """Return how much each order changes if the change of k is 1."""
    return {k: 1.0 + 0j} | ({-order: value.conjugate() for order, value in base.items()} if k == -1 else {})


def _needed(changes: Terms, system: "_System") -> tuple[int, ...]:
    """Return the orders, of those taken before, with changes that are still significant in the new system."""
    orders = tuple(changes[0])
    errors = system.stderr(orders)
    return tuple(
        k
        for index, k in enumerate(orders)
        if any(
            abs(change[k]) > max(LEAST_TERM, LEAST_SIGNIFICANCE * error)
            for change, error in zip(changes, errors[:, index], strict=True)
        )
    )


def _taken(changes: Terms, errors: Float, k: int) -> str:
    sizes = ", ".join(f"{abs(change[k]):.5f} ± {error:.5f}" for change, error in zip(changes, errors, strict=True))
    return f"used, {sizes} of k = 1"


def _without_own(values: Complex, weights: Float) -> Float:
    """Return real and imaginary parts of values, (N, H, n), over their errors, as one row, without what pixels may have of
    their own: in the real part a sum of one part per target and one per harmonic, in the imaginary part one per harmonic."""
    harmonic, target = two_way(values.real, weights)
    real = values.real - harmonic - target[:, np.newaxis, :]
    imaginary = values.imag - (values.imag * weights).sum(axis=0) / weights.sum(axis=0)
    return (np.stack([real, imaginary]) * np.sqrt(weights)).ravel()


class _System:
    """Normal equations for changes of every candidate term in every harmonic, with the pixels' own parameters eliminated.

    The unknowns are the real and the imaginary part of k = CANDIDATES[0] in the first harmonic, in the second …, then
    of the next k. With `free_distances`, the errors of the targets' distances are eliminated, too. They explain the part
    `explained` of the misfit.
    """

    def __init__(
        self,
        pixels: PixelFit,
        terms: Terms,
        base: Sequence[dict[int, complex]],
        harmonics: tuple[int, ...],
        free_distances: bool,
    ) -> None:
        self._harmonics = len(harmonics)
        self._targets, self._pixels = pixels.left.shape[0], pixels.left.shape[2]
        self._free = self._targets - 1 if free_distances else 0
        left = _without_own(pixels.left, pixels.weights)
        columns = []
        for k in CANDIDATES:
            for row in range(len(harmonics)):
                theta = pixels.theta[:, row]
                shape = sum(g * np.exp(1j * (order - 1) * theta) for order, g in _shape(base[row], k).items())
                answer = shape / series(terms[row], theta)
                for unit in (1.0, 1j):
                    column = np.zeros(pixels.left.shape, np.complex128)
                    column[:, row] = unit * answer
                    columns.append(_without_own(column, pixels.weights))
        matrix = np.stack(columns)
        self._normal = matrix @ matrix.T
        self._side = matrix @ left
        self._power = float((left**2).sum())
        self.explained = 0.0
        if free_distances:
            self._free_distances(matrix, left, pixels, harmonics)

    def _free_distances(self, matrix: Float, left: Float, pixels: PixelFit, harmonics: tuple[int, ...]) -> None:
        """Eliminate an error of each target's distance. It changes all its phases by the same share."""
        ways = (pixels.theta[:, 0] - pixels.phase[0]) / harmonics[0]
        usual = ways.mean(axis=1)
        rows = []
        for target, way in enumerate(ways / usual[:, np.newaxis]):
            column = np.zeros(pixels.weights.shape, np.complex128)
            column[target] = 1j * np.multiply.outer(harmonics, way)
            rows.append(_without_own(column, pixels.weights))
        # changes whose mean is not 0 are left out: the pixels' own delays contain such a change
        distances = np.stack(rows) - np.mean(rows, axis=0)
        inverse = np.linalg.pinv(distances @ distances.T, rcond=NO_DIGITS, hermitian=True)
        side, shared = distances @ left, distances @ matrix.T
        self._stretch, self._stretch_per_change = inverse @ side / usual, inverse @ shared / usual[:, np.newaxis]
        self.explained = float(side @ inverse @ side)
        self._normal -= shared.T @ inverse @ shared
        self._side -= shared.T @ inverse @ side
        self._power -= self.explained

    def stretch(self, orders: tuple[int, ...]) -> Float:
        """Return the best distance of each target over the present one, (N,), after the changes of the given orders.

        The mean distance stays as it is, because the pixels' own delays contain its error.
        """
        step = self._solved(orders)[0].ravel() if orders else np.zeros(0)
        return np.asarray(1.0 + self._stretch - self._stretch_per_change[:, self._places(orders)] @ step)

    def _places(self, orders: Sequence[int]) -> Index:
        width = 2 * self._harmonics
        starts = np.array([width * CANDIDATES.index(k) for k in orders], np.intp)
        return np.asarray((starts[:, np.newaxis] + np.arange(width)).ravel(), np.intp)

    def freedom(self, orders: int) -> float:
        """Return the degrees of freedom: how many more numbers were measured than are fitted with so many orders."""
        n, h = self._targets, self._harmonics
        return float(self._pixels * ((n - 1) * h + (n - 1) * (h - 1)) - 2 * h * orders - self._free)

    def _solved(self, orders: Sequence[int]) -> tuple[Float, Float, float]:
        """Return changes and standard errors, (len(orders), H, 2) each, and the condition of their normal matrix."""
        places = self._places(orders)
        normal, side = self._normal[np.ix_(places, places)], self._side[places]
        shape = (len(orders), self._harmonics, 2)
        inverse, condition = scaled_inverse(normal, most=HIGHEST_CONDITION)
        if inverse is None:
            return np.zeros(shape), np.full(shape, np.inf), np.inf
        change = inverse @ side
        left = max(self._power - float(change @ side), 0.0) / self.freedom(len(orders))
        errors = np.sqrt(np.diag(inverse) * left)
        return change.reshape(shape), errors.reshape(shape), condition

    def selection(self, taken: tuple[int, ...]) -> tuple[tuple[int, ...], dict[int, str]]:
        """Return the orders to be fitted, and why the other orders were left.

        The orders are those taken before, and then all others that are significant, the most significant first.
        """
        findings: dict[int, str] = {}
        while True:
            scores: dict[int, float] = {}
            for k in CANDIDATES:
                if k in taken:
                    continue
                change, errors, condition = self._solved((*taken, k))
                size, error = np.hypot(change[-1, :, 0], change[-1, :, 1]), errors[-1].max(axis=-1)
                significance = float((size / error).max())
                if condition > LARGEST_CONDITION or error.max() > LARGEST_STDERR:
                    findings[k] = (
                        f"not used, because it cannot be determined: standard error {error.max():.1e}, "
                        f"condition {condition:.1e}; record more distances, spread over the range"
                    )
                elif significance < LEAST_SIGNIFICANCE or size.max() < LEAST_TERM:
                    findings[k] = f"not used, because it is not needed: {size.max():.1e} ± {error.max():.1e} of k = 1"
                else:
                    scores[k] = significance
            if not scores:
                return taken, findings
            taken = (*taken, max(scores, key=lambda k: scores[k]))

    def changed(self, changes: Terms, orders: tuple[int, ...]) -> Terms:
        """Return the changes of the given orders after one Gauss–Newton step; the changes of other orders are dropped."""
        if not orders:
            return tuple({} for _ in changes)
        step, _, _ = self._solved(orders)
        return tuple(
            {k: change.get(k, 0j) + complex(*step[index, row]) for index, k in enumerate(orders)}
            for row, change in enumerate(changes)
        )

    def stderr(self, orders: tuple[int, ...]) -> Float:
        """Return the standard error of each order in each harmonic, (H, len(orders)): that of its real or imaginary
        part, the larger."""
        if not orders:
            return np.zeros((self._harmonics, 0))
        return np.asarray(self._solved(orders)[1].max(axis=-1).T)
