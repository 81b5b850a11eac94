"""The state of a room and its patches: for a linear model, it is that of Gaussians conditioned on all data at once."""

from dataclasses import field

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.coarse import patch_posterior
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit, fitted_patches
from cadtof_cli.resolver.diffuse.patch_steps import CompiledSteps, PatchSteps
from cadtof_cli.resolver.diffuse.prior import MEAN, between_rooms, within_room
from cadtof_cli.resolver.diffuse.radiosity import Interreflections
from cadtof_cli.resolver.diffuse.tail import TailModel
from cadtof_cli.resolver.kernels import NUMPY, available_kernels
from tests.support.diffuse_frames import OMEGA, F
from tests.support.kernels import by_kernel

NO_LIGHT = np.zeros((3, 1), complex)

DATA = 4

VALUES = DATA + 2


@dataclass(frozen=True)
class LinearModel(TailModel):
    """A model whose values are linear in the state, with `slope`, (values, 6, n), and `constant`, (values, n)."""

    slope: F = field(default_factory=lambda: np.empty(0))
    constant: F = field(default_factory=lambda: np.empty(0))

    def values(self, state: F, /) -> tuple[F, F]:
        return np.einsum("ajn,jn->an", self.slope, state) + self.constant, np.swapaxes(self.slope, 0, 1).copy()


def linear_model(patches: int, *, seed: int = 1, strength: float = 0.1) -> LinearModel:
    rng = np.random.default_rng(seed)
    light = Interreflections(NO_LIGHT, NO_LIGHT, NO_LIGHT, np.ones(1), np.ones(1))
    slope, constant = strength * rng.normal(size=(VALUES, 6, patches)), 0.1 * rng.normal(size=(VALUES, patches))
    return LinearModel(light, (1, 2, 3), OMEGA, slope=slope, constant=constant)


def problem(patches: int, seed: int = 2) -> tuple[LinearModel, F, F, F]:
    """Return a model, data from a room that is not the typical one, errors, and a pattern.

    The error of the last value is correlated with those of the data.
    """
    model, rng = linear_model(patches), np.random.default_rng(seed)
    pattern = 0.3 * rng.normal(size=(6, patches))
    state = MEAN[:, None] + pattern + 0.3 * rng.normal(size=(6, 1)) + 0.1 * rng.normal(size=(6, patches))
    error = np.zeros((VALUES, VALUES, patches))
    error[:DATA, :DATA] = np.stack(
        [0.01 * np.diag(rng.uniform(0.5, 2.0, DATA)) + 0.003 for _ in range(patches)], axis=-1
    )
    error[-1, :DATA] = error[:DATA, -1] = 0.002 * rng.normal(size=(DATA, patches))
    return model, model.values(state)[0][:DATA], error, pattern


def room_by_conditioning(model: LinearModel, data: F, error: F, pattern: F, *, known: bool) -> tuple[F, F]:
    """Return mean and covariance of the room's state, conditioned on all data of all patches at once.

    More than four patches together weigh as four: the variance of each is larger by that factor.
    """
    between, within = between_rooms(known_optics=known), within_room(known_optics=known)
    patches = data.shape[1]
    slopes = np.concatenate([model.slope[:DATA, :, n] for n in range(patches)])
    among = slopes @ between @ slopes.T
    for n in range(patches):
        rows, slope = slice(DATA * n, DATA * (n + 1)), model.slope[:DATA, :, n]
        among[rows, rows] += (slope @ within @ slope.T + error[:DATA, :DATA, n]) * max(1.0, patches / 4.0)
    residual = (data - model.values(MEAN[:, None] + pattern)[0][:DATA]).T.ravel()
    with_room = between @ slopes.T
    room = MEAN + with_room @ np.linalg.solve(among, residual)
    return room, between - with_room @ np.linalg.solve(among, with_room.T)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("patches", [1, 3, 4, 9])
def test_room_and_patches_are_those_of_conditioned_gaussians(patches: int, known: bool) -> None:
    model, data, error, pattern = problem(patches)
    found = fitted_patches(data, error, model, pattern, known_optics=known)
    room, room_covariance = room_by_conditioning(model, data, error, pattern, known=known)
    assert_allclose(found.room, room, rtol=1e-9)
    spread = within_room(known_optics=known) + room_covariance
    for n in range(patches):
        slope, prior = model.slope[..., n], room + pattern[:, n]
        expected = slope @ prior + model.constant[:, n]
        covariance = slope @ spread @ slope.T
        among = covariance[:DATA, :DATA] + error[:DATA, :DATA, n]
        gain = (covariance + error[..., n])[:, :DATA] @ np.linalg.inv(among)
        residual = data[:, n] - expected[:DATA]
        assert_allclose(found.expected[:, n], expected, rtol=1e-8)
        assert_allclose(found.covariance[..., n], covariance, atol=1e-10)
        assert_allclose(found.posterior[:, n], expected + gain @ residual, rtol=1e-8)
        assert_allclose(found.jacobian[..., n], slope.T)
        pull = np.linalg.solve(among, residual)
        assert_allclose(found.state[:, n], prior + spread @ slope[:DATA].T @ pull, rtol=1e-8)


def fit_of_one_patch(target: float) -> PatchFit:
    """Return the fit of one patch whose nearly noiseless data put the fourth component `target` away from the mean."""
    model = linear_model(1, strength=0.0)
    model.slope[0, 3, 0] = 1.0
    state = MEAN[:, None].copy()
    state[3] += target
    error = 1e-9 * np.eye(VALUES)[..., None]
    return fitted_patches(model.values(state)[0][:DATA], error, model, np.zeros((6, 1)), known_optics=True)


@pytest.mark.parametrize(("target", "reached"), [(0.5, 0.5), (-2.9, -2.9), (3.1, 3.1), (3.9, 3.2), (-4.5, -3.2)])
def test_the_state_of_a_patch_moves_by_at_most_four_steps_of_four_fifths(target: float, reached: float) -> None:
    assert_allclose(fit_of_one_patch(target).state[3, 0] - MEAN[3], reached, rtol=1e-6)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_state_of_a_room_is_at_most_three_standard_deviations_from_the_mean(side: float) -> None:
    """ln v has a standard deviation of 1.8 between rooms, and of 1.2 within a room."""
    found = fit_of_one_patch(side * 40.0)
    assert_allclose(found.room[3] - MEAN[3], side * 3.0 * 1.8)
    assert_allclose(fit_of_one_patch(side * 2.0).room[3] - MEAN[3], side * 2.0 / (1.0 + (1.2 / 1.8) ** 2), rtol=1e-5)


def test_phases_that_differ_by_full_turns_give_the_same_fit() -> None:
    model, data, error, pattern = problem(5)
    turned = data.copy()
    turned[2] += 2.0 * np.pi
    turned[3, ::2] -= 4.0 * np.pi
    found, found_turned = (fitted_patches(given, error, model, pattern, known_optics=True) for given in (data, turned))
    assert_allclose(found_turned.room, found.room)
    assert_allclose(np.exp(1j * found_turned.posterior[2:4]), np.exp(1j * found.posterior[2:4]))
    assert_allclose(found_turned.posterior[[0, 1, 4, 5]], found.posterior[[0, 1, 4, 5]])


@pytest.mark.parametrize("kernel", available_kernels())
@pytest.mark.parametrize("turns", [-1, 0, 2])
def test_a_linear_model_that_is_off_by_more_than_half_a_turn_is_moved_back_and_not_on(kernel: str, turns: int) -> None:
    """The model fits the data at the state of the patch; taken back to that of the room, it is 4 rad off.

    The patch was moved on by the rest of the turn, and the lag with it: depths in rooms were metres off.
    """
    data, state = np.array([[-0.1], [-1.4 + 2.0 * np.pi * turns]]), MEAN[:, None].copy()
    values = np.array([[-0.1], [-1.4], [0.0], [0.6]])
    jacobian = np.zeros((6, 4, 1))
    jacobian[4, 1:, 0] = -4.0, 0.0, 1.0
    state[4] += 1.0
    kind = PatchSteps if kernel == NUMPY else CompiledSteps
    steps = kind(data, 1e-6 * np.eye(4)[..., None], np.ones(6), np.zeros((6, 1)))

    def step() -> tuple[F, ...]:
        linear = steps.evidence(values, jacobian, state)[1]
        moved = steps.moved(state, linear, jacobian, MEAN, np.eye(6))
        return (moved, *steps.posterior(values, jacobian, state, MEAN, np.eye(6)))

    moved, expected, posterior, covariance = by_kernel(kernel, step)
    assert_allclose(moved, state, atol=1e-6)
    assert_allclose(expected[1:, 0], [2.6 + 2.0 * np.pi * turns, 0.0, -0.4])
    assert_allclose(posterior[1:, 0], [data[1, 0], 0.0, 0.6], atol=1e-5)
    fit = PatchFit(MEAN, state, expected, posterior, covariance, jacobian)
    known = patch_posterior(data, 1e-6 * np.eye(4)[..., None], fit)
    assert_allclose(known.shifts[1], 1.0, atol=1e-5)
