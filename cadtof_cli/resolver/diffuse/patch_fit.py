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
    within, between = within_room(known_optics=known_optics), between_rooms(known_optics=known_optics)
    prior = _RoomPrior(
        within,
        np.asarray(np.linalg.inv(between), np.float64),
        FARTHEST * np.sqrt(np.diag(between)),
        error[: model.data, : model.data],
    )
    state = MEAN[:, None] + pattern
    for _ in range(STEPS):
        values, jacobian = model.values(state)
        given = prior.given(residuals(data, values[: model.data]), jacobian[:, : model.data], state - pattern)
        pull = _pulled(given.scatter, given.seen.swapaxes(0, 1), given.missed)
        change = given.room[:, None] + pattern - state + given.spread @ pull
        state = state + np.maximum(np.minimum(change, LARGEST_STEP), -LARGEST_STEP)
    values, jacobian = model.values(state)
    given = prior.given(residuals(data, values[: model.data]), jacobian[:, : model.data], state - pattern)
    expected = values + (jacobian * (given.room[:, None] + pattern - state)[:, None]).sum(0)
    covariance = _products(_times(given.spread, jacobian), jacobian)
    joint = (covariance + error)[: model.data]
    posterior = expected + _pulled(joint[:, : model.data], joint, residuals(data, expected[: model.data]))
    return PatchFit(given.room, given.room_covariance, state, expected, posterior, covariance, jacobian)


@dataclass(frozen=True, eq=False)
class _Given:
    """The room given all patches, linearised.

    Attributes:
        room: the frame's state, (6,), and `room_covariance`, (6, 6).
        spread: covariance of a patch's state before its own data are seen, (6, 6).
        seen: Jacobians of the data, (6, data, n).
        scatter: covariance of the data with it, (data, data, n).
        missed: what the data are off by then, (data, n).
    """

    room: Float
    room_covariance: Float
    spread: Float
    seen: Float
    scatter: Float
    missed: Float


@dataclass(frozen=True, eq=False)
class _RoomPrior:
    """What is known of a room: covariance `within` it, `precision` and `farthest` departures between rooms; noise of its data."""

    within: Float
    precision: Float
    farthest: Float
    noise: Float

    def given(self, difference: Float, seen: Float, departure: Float) -> _Given:
        """Return the room, given all patches linearised.

        Args:
            difference: data minus model, (data, n).
            seen: Jacobians of the data, (6, data, n).
            departure: states linearised at, without the pattern, (6, n).
        """
        linear = difference + (seen * departure[:, None]).sum(0)
        whole = np.concatenate([seen.swapaxes(0, 1), linear[:, None]], axis=1)
        white = _whitened(self._scatter(self.within, seen), whole)
        normal = np.matmul(white[:, :-1], white.swapaxes(1, 2)).sum(0)
        normal *= min(1.0, INDEPENDENT_PATCHES / seen.shape[2])
        covariance = np.linalg.inv(self.precision + normal[:, :-1])
        room = covariance @ (self.precision @ MEAN + normal[:, -1])
        room = np.clip(room, MEAN - self.farthest, MEAN + self.farthest)
        spread = self.within + covariance
        missed = residuals(linear, _times(room[None], seen)[0])
        return _Given(room, covariance, spread, seen, self._scatter(spread, seen), missed)

    def _scatter(self, spread: Float, seen: Float) -> Float:
        return _products(_times(spread, seen), seen) + self.noise


def _times(matrix: Float, vectors: Float) -> Float:
    """Return a matrix (m, 6) times vectors (6, …), (m, …)."""
    product: Float = (matrix @ vectors.reshape(len(vectors), -1)).reshape(len(matrix), *vectors.shape[1:])
    return product


def _products(first: Float, second: Float) -> Float:
    """Return Σ_j first_jan·second_jbn, (a, b, n)."""
    products: Float = (first[:, :, None] * second[:, None]).sum(0)
    return products


def _pulled(covariance: Float, with_data: Float, missed: Float) -> Float:
    """Return by how much what has the covariances `with_data`, (data, k, n), moves, (k, n), where data miss, (data, n)."""
    white = _whitened(covariance, np.concatenate([with_data, missed[:, None]], axis=1))
    moved: Float = (white[:, :-1] * white[:, -1:]).sum(0)
    return moved


def _whitened(covariance: Float, right: Float) -> Float:
    """Return L⁻¹·right for covariances L·Lᵀ, (data, data, n), and right sides, (data, k, n), which are taken over."""
    left, white = covariance.copy(), right
    for i, row in enumerate(left):
        scale = 1.0 / np.sqrt(row[i])
        white[i] *= scale
        left[i + 1 :, i] *= scale
        for j in range(i + 1, len(left)):
            white[j] -= left[j, i] * white[i]
            left[j, i + 1 : j + 1] -= left[j, i] * left[i + 1 : j + 1, i]
    return white
