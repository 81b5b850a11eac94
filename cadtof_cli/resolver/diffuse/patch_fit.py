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
    within = within_room(known_optics=known_optics)
    between = between_rooms(known_optics=known_optics)
    noise_by_patch = error[: model.data, : model.data].transpose(2, 0, 1)
    state = MEAN[:, None] + pattern
    for step in range(STEPS + 1):
        values, jacobian = model.values(state)
        seen = jacobian[:, : model.data].transpose(2, 1, 0)
        difference = residuals(data, values[: model.data])
        room, room_covariance = _room(seen, difference.T, state - pattern, noise_by_patch, within, between)
        prior = room[:, None] + pattern
        expected = values + np.einsum("jan,jn->an", jacobian, prior - state)
        spread = np.einsum("jk,kan->jan", within + room_covariance, jacobian)
        covariance = np.einsum("jan,jbn->abn", jacobian, spread)
        pull = np.linalg.solve(
            covariance[: model.data, : model.data].transpose(2, 0, 1) + noise_by_patch,
            residuals(data, expected[: model.data]).T[..., None],
        )[..., 0]
        change = prior + np.einsum("jan,na->jn", spread[:, : model.data], pull) - state
        if step < STEPS:
            state = state + np.clip(change, -LARGEST_STEP, LARGEST_STEP)
    posterior = expected + np.einsum("abn,nb->an", (covariance + error)[:, : model.data], pull)
    return PatchFit(room, room_covariance, state, expected, posterior, covariance, jacobian)


def _room(
    seen: Float, difference: Float, departure: Float, noise: Float, within: Float, between: Float
) -> tuple[Float, Float]:
    """Return the frame's state and its covariance, given all patches linearised.

    Args:
        seen: Jacobians of the data, (n, data, 6).
        difference: data minus model, (n, data).
        departure: states linearised at, without the pattern, (6, n).
        noise: (n, data, data).
        within: covariance within a room, (6, 6).
        between: covariance between rooms, (6, 6).
    """
    linear = difference + np.einsum("naj,jn->na", seen, departure)
    scatter = seen @ within @ seen.transpose(0, 2, 1) + noise
    weighted = np.linalg.solve(scatter, np.concatenate([seen, linear[..., None]], axis=2))
    normal = np.einsum("naj,nak->jk", seen, weighted) * min(1.0, INDEPENDENT_PATCHES / len(seen))
    precision = np.linalg.inv(between)
    covariance = np.linalg.inv(precision + normal[:, :-1])
    room = covariance @ (precision @ MEAN + normal[:, -1])
    farthest = FARTHEST * np.sqrt(np.diag(between))
    return np.clip(room, MEAN - farthest, MEAN + farthest), covariance
