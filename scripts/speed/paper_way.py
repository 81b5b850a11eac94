"""The paper's solver by scipy, against which our solvers are measured."""

import numpy as np
from scipy.optimize import leastsq

from cadtof_cli.arrays import Float


def paper_way(p1: complex, p2: complex, starts: Float) -> tuple[complex, complex]:
    """Return the two paths as complex amplitudes, by Eq. (9).

    MINPACK's Levenberg–Marquardt searches from each start, (n, 2), and the best result is kept.
    """
    q2 = p2 * abs(p1) / p1**2

    def misfit(z: Float) -> tuple[float, float]:
        a, b = complex(z[0], z[1]), complex(1 - z[0], -z[1])
        left = (a * a / abs(a) if a else 0) + (b * b / abs(b) if b else 0) - q2
        return left.real, left.imag

    solutions = []
    for start in starts:
        z, *_ = leastsq(misfit, start)
        solutions.append((float(np.hypot(*misfit(z))), complex(*z)))
    z = min(solutions, key=lambda pair: pair[0])[1]
    return p1 * z, p1 * (1 - z)
