"""The most probable state of the room and of every patch, by Gauss–Newton on all patches at once.

The state of the frame is x ~ N(MEAN, BETWEEN_ROOMS²). The state of a patch is x + pattern + N(0, WITHIN_ROOM²). Its data
are those of `tail` plus noise. Each step linearises every patch, finds x from all of them, and then the patches given x.
The errors of the patches are mostly common to them, because the model is wrong in the same way for neighbours. So all
patches together weigh as a few independent ones. The uncertainty of x that this leaves stays in the prior of every patch.
"""

from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Float, sealed
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.patch_steps import CompiledSteps, PatchSteps
from cadtof_cli.resolver.diffuse.prior import MEAN, between_rooms, within_room
from cadtof_cli.resolver.diffuse.tail import TailModel
from cadtof_cli.resolver.kernels import is_compiled_for

STEPS = 4
"""Gauss–Newton steps. With more, the state still moves along what the data leave open, and depth does not improve."""

INDEPENDENT_PATCHES = 4.0
"""Weight of all patches of a frame together, in independent patches."""

FARTHEST = 3.0
"""Largest distance of the frame's state from the prior's mean, in standard deviations between rooms."""


@dataclass(frozen=True, eq=False)
class PatchFit:
    """The fit of n patches.

    Attributes:
        room: state of the frame, (6,).
        state: state of every patch, (6, n).
        expected: values of the model before a patch's own data are seen, (data + 2, n), phases with the data's turns.
        posterior: values after its own data are seen, by the linear model, (data + 2, n).
        covariance: prior covariance of the values, without noise, (data + 2, data + 2, n).
        jacobian: of the values, (6, data + 2, n).
    """

    room: Float
    state: Float
    expected: Float
    posterior: Float
    covariance: Float
    jacobian: Float


def fitted_patches(data: Float, error: Float, model: TailModel, pattern: Float, /, *, known_optics: bool) -> PatchFit:
    """Fit the state of a frame and its patches to their data, (data, n).

    `error`, (data + 2, data + 2, n), is the covariance of the errors of the model's values, and of noise. `pattern`, (6, n),
    is how the state differs between patches by rule. All kernels give the same bits.
    """
    prior = _room_prior(known_optics=known_optics)
    kind = CompiledSteps if is_compiled_for(len(model.harmonics)) else PatchSteps
    steps = kind(data, error, np.diag(prior.within), pattern)
    state = MEAN[:, None] + pattern
    for _ in range(STEPS):
        values, jacobian = model.values(state)
        evidence, linear = steps.evidence(values, jacobian, state)
        room, spread = prior.given(evidence)
        state = steps.moved(state, linear, jacobian, room, spread)
    values, jacobian = model.values(state)
    room, spread = prior.given(steps.evidence(values, jacobian, state)[0])
    expected, posterior, covariance = steps.posterior(values, jacobian, state, room, spread)
    return PatchFit(room, state, expected, posterior, covariance, jacobian)


@dataclass(frozen=True, eq=False)
class _RoomPrior:
    """What is known of a room before its data are seen.

    `within` is the covariance within a room. `precision` is the inverse covariance between rooms, and `farthest` the
    largest departures from the mean.
    """

    within: Float
    precision: Float
    farthest: Float

    def given(self, evidence: Float) -> tuple[Float, Float]:
        """Return the state of the room, (6,), and the covariance of a patch's state before its own data are seen, (6, 6).

        Both are given the evidence of all patches, whitened, (data, 7, n): their Jacobians, then their data.
        """
        normal = np.matmul(evidence[:, :-1], evidence.swapaxes(1, 2)).sum(0)
        normal *= min(1.0, INDEPENDENT_PATCHES / evidence.shape[2])
        covariance = np.linalg.inv(self.precision + normal[:, :-1])
        room = covariance @ (self.precision @ MEAN + normal[:, -1])
        room = np.minimum(np.maximum(room, MEAN - self.farthest), MEAN + self.farthest)
        return room, self.within + covariance


@lru_cache(maxsize=2)
def _room_prior(*, known_optics: bool) -> _RoomPrior:
    within, between = within_room(known_optics=known_optics), between_rooms(known_optics=known_optics)
    precision = np.asarray(np.linalg.inv(between), np.float64)
    return sealed(_RoomPrior(within, precision, FARTHEST * np.sqrt(np.diag(between))))
