"""What patches hand to their pixels: means, variances within a patch, and what a patch cannot tell."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse.coarse import CoarsePlanes, coarse_planes, needed_entries, patch_posterior
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit
from cadtof_cli.resolver.diffuse.prior import WITHIN_PATCH

DATA, PATCHES = 3, 4
VALID = np.array([[True, True, False], [True, False, True]])


def fit(seed: int = 1, *, targets: tuple[float, float] = (0.3, -0.4)) -> PatchFit:
    rng = np.random.default_rng(seed)
    count = DATA + 2
    jacobian = 0.1 * rng.normal(size=(6, count, PATCHES))
    covariance = 0.02 * np.einsum("jan,jbn->abn", jacobian, jacobian) + 1e-3 * np.eye(count)[..., None]
    expected = rng.normal(size=(count, PATCHES))
    expected[-2], expected[-1] = targets
    room, state = np.zeros(6), np.zeros((6, PATCHES))
    return PatchFit(room, np.zeros((6, 6)), state, expected, expected.copy(), covariance, jacobian)


def planes(known: PatchFit, beside_rad: float) -> CoarsePlanes:
    data = known.expected[:DATA] + 0.01
    noise = 1e-3 * np.repeat(np.eye(DATA)[..., None], PATCHES, axis=2)
    posterior = patch_posterior(data, noise, known)
    return coarse_planes(known, posterior, np.full(PATCHES, beside_rad), VALID)


def test_valid_patches_keep_their_means_and_the_others_get_theirs() -> None:
    known = fit()
    found = planes(known, 0.0)
    assert found.data == DATA
    for plane, expected in zip(found.planes, known.expected, strict=False):
        assert_allclose(plane[VALID], expected, rtol=1e-6)
        assert_allclose(plane[~VALID], expected.mean(), rtol=1e-6)


def test_a_pixel_needs_all_of_its_data_and_what_ties_the_targets_to_them() -> None:
    assert needed_entries(2) == ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1), (3, 3))


def test_what_a_patch_leaves_is_what_its_data_do_not_tell() -> None:
    """Against numpy's own conditioning of a Gaussian, times what PATCH_SHARE and SURPRISE make of it."""
    known = fit()
    found = planes(known, 0.0)
    for patch in range(PATCHES):
        whole = known.covariance[:, :, patch]
        among = whole[:DATA, :DATA] + 1e-3 * np.eye(DATA)
        between = whole[DATA:, :DATA]
        left = whole[DATA:, DATA:] - between @ np.linalg.solve(among, between.T)
        off = np.full(DATA, 0.01)
        chi_squared = off @ np.linalg.solve(among, off)
        kept = 1.7 + 0.35 * chi_squared
        assert found.planes[-2][VALID][patch] == pytest.approx(kept * left[1, 1], rel=1e-4)


def test_light_of_surfaces_beside_the_view_moves_arg_h_and_makes_it_unsure() -> None:
    """Two harmonics have 2 data of phase and modulus …: what they leave out falls with their number."""
    known = fit()
    without, beside = planes(known, 0.0), planes(known, 0.2)
    unsure = 0.2 / (DATA // 2)
    moved = beside.planes[: DATA + 2] - without.planes[: DATA + 2]
    assert_allclose(moved[: DATA + 1], 0.0, atol=1e-7)
    assert_allclose(moved[-1], 0.3 * unsure, rtol=1e-4)
    assert_allclose(beside.planes[-2] - without.planes[-2], (0.5 * unsure) ** 2, rtol=1e-3)
    assert (beside.planes[-1] > without.planes[-1]).all()


@pytest.mark.parametrize("targets", [(0.3, -0.4), (0.05, -0.2), (1.0, 0.5)])
def test_the_phase_of_the_mpi_light_is_as_unsure_as_repetitions_show(targets: tuple[float, float]) -> None:
    """MPI light is p_1·(1 − 1/H_1): its phase, for ln|H_1| and arg H_1 drawn from what is left and from the patch's spread."""
    known = fit(targets=targets)
    small = PatchFit(
        known.room,
        known.room_covariance,
        known.state,
        known.expected,
        known.posterior,
        1e-6 * known.covariance,
        1e-3 * known.jacobian,
    )
    data = small.expected[:DATA]
    posterior = patch_posterior(data, 1e-9 * np.repeat(np.eye(DATA)[..., None], PATCHES, axis=2), small)
    found = coarse_planes(small, posterior, np.zeros(PATCHES), VALID)
    spread = np.einsum("jan,j,jbn->abn", small.jacobian, WITHIN_PATCH**2, small.jacobian)[-2:, -2:]
    rng = np.random.default_rng(4)
    for patch in range(PATCHES):
        left = 1.7 * np.array([[posterior.covariance[max(i, j), min(i, j)][patch] for j in range(2)] for i in range(2)])
        drawn = rng.multivariate_normal(targets, left + spread[..., patch], size=40_000)
        phase = np.angle(1.0 - np.exp(-drawn[:, 0] - 1j * drawn[:, 1]))
        assert found.planes[-1][VALID][patch] == pytest.approx(phase.var(), rel=0.05)
