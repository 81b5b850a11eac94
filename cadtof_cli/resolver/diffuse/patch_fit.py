"""The state of the room and of every patch: most probable values, by Gauss–Newton on all patches at once.

The frame's state is x ~ N(MEAN, BETWEEN_ROOMS²); a patch's is x + pattern + N(0, WITHIN_ROOM²); its data are those of `tail` plus
noise. Each step linearises every patch, finds x from all of them, and then the patches given x. Their errors are mostly common to
them (the model is wrong in the same way for neighbours), so together they weigh as a few independent ones; what that leaves
uncertain of x stays in every patch's prior.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.diffuse.prior import MEAN, between_rooms, within_room
from cadtof_cli.resolver.diffuse.tail import TailModel, residuals
from cadtof_cli.resolver.likelihood.normal_equations import cholesky, solve

STEPS = 4
"""Gauss–Newton steps; with more the state still moves along what the data leave open, and depth gets no better."""

LARGEST_STEP = 0.8
"""Largest change of a component per step (ln or ns): the model bends over a factor of two."""

INDEPENDENT_PATCHES = 4.0
"""As how many independent patches a frame's patches weigh together."""

FARTHEST = 3.0
"""How far the frame's state may go from the prior's mean, in standard deviations between rooms."""


@dataclass(frozen=True, eq=False)
class PatchFit:
    """The fit of n patches.

    Attributes:
        room: the frame's state, (6,), and its covariance `room_covariance`, (6, 6).
        state: every patch's state, (6, n).
        expected: the model's values before a patch's own data are seen, (data + 2, n).
        posterior: the same after, where the model is linear.
        covariance: prior covariance of the values, without noise, (data + 2, data + 2, n).
        jacobian: of the values, (6, data + 2, n).
    """

    room: Float
    room_covariance: Float
    state: Float
    expected: Float
    posterior: Float
    covariance: Float
    jacobian: Float


def fitted_patches(data: Float, error: Float, model: TailModel, pattern: Float, /, *, known_optics: bool) -> PatchFit:
    """Fit the state of a frame and its patches to their data, (data, n).

    `error`, (data + 2, data + 2, n), is the covariance of what the model's values are wrong by, and of noise; `pattern`, (6, n),
    how the state differs between patches by rule.
    """
    within = within_room(known_optics=known_optics)
    between = between_rooms(known_optics=known_optics)
    noise = error[: model.data, : model.data]
    precision = np.asarray(np.linalg.inv(between), np.float64)
    farthest = FARTHEST * np.sqrt(np.diag(between))
    state = MEAN[:, None] + pattern
    for step in range(STEPS + 1):
        values, jacobian = model.values(state)
        difference = residuals(data, values[: model.data])
        room, room_covariance = _room(jacobian[:, : model.data], difference, state - pattern, noise, within, precision)
        room = np.clip(room, MEAN - farthest, MEAN + farthest)
        prior = room[:, None] + pattern
        expected = values + np.einsum("jan,jn->an", jacobian, prior - state)
        spread = np.einsum("jk,kan->jan", within + room_covariance, jacobian)
        covariance = np.einsum("jan,jbn->abn", jacobian, spread)
        pull = _solved(covariance[: model.data, : model.data] + noise, residuals(data, expected[: model.data]))
        if step < STEPS:
            change = prior + np.einsum("jan,an->jn", spread[:, : model.data], pull) - state
            state = state + np.clip(change, -LARGEST_STEP, LARGEST_STEP)
    posterior = expected + np.einsum("abn,bn->an", (covariance + error)[:, : model.data], pull)
    return PatchFit(room, room_covariance, state, expected, posterior, covariance, jacobian)


def _room(
    seen: Float, difference: Float, departure: Float, noise: Float, within: Float, precision: Float
) -> tuple[Float, Float]:
    """Return the frame's state and its covariance, given all patches linearised.

    Args:
        seen: Jacobians of the data, (6, data, n).
        difference: data minus model, (data, n).
        departure: states linearised at, without the pattern, (6, n).
        noise: (data, data, n).
        within: covariance within a room, (6, 6).
        precision: inverse of the covariance between rooms, (6, 6).
    """
    linear = difference + np.einsum("jan,jn->an", seen, departure)
    scatter = np.einsum("jan,jbn->abn", seen, np.einsum("jk,kan->jan", within, seen)) + noise
    weighted = _solved(scatter, np.concatenate([seen.transpose(1, 0, 2), linear[:, None]], axis=1))
    normal = np.einsum("jan,akn->jk", seen, weighted) * min(1.0, INDEPENDENT_PATCHES / seen.shape[2])
    covariance = np.linalg.inv(precision + normal[:, :-1])
    return covariance @ (precision @ MEAN + normal[:, -1]), covariance


def _solved(matrix: Float, right: Float) -> Float:
    """Return matrix⁻¹·right for symmetric positive definite matrices, (data, data, n), and right sides, (data, …, n)."""
    size = len(matrix)
    lower = np.concatenate([matrix[row, : row + 1] for row in range(size)])
    return solve(cholesky(lower, size), right)
