"""The answer of a pixel, compared with Gaussian conditioning in whole matrices: mean, variance, and the MPI light."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse.choice import DiffuseChoice
from cadtof_cli.resolver.diffuse.coarse import CoarsePlanes, needed_entries
from cadtof_cli.resolver.diffuse.grid import View, patch_grid
from cadtof_cli.resolver.diffuse.pixels import diffuse_pixels
from cadtof_cli.resolver.diffuse.records import DiffuseModel, DiffusePixels
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.diffuse.upsampling import upsampler
from tests.support.diffuse_frames import M_PER_RAD, F, Z

SHAPE = (8, 12)

PIXELS = SHAPE[0] * SHAPE[1]

HARMONICS = (1, 2, 3)

DATA = 2 * (len(HARMONICS) - 1)

VARIANCES = (4e-6, 6e-6, 9e-6)

PATCH_VARIANCE, MPI_VARIANCE = 3e-4, 2e-3


def spread(seed: int = 3) -> F:
    """Return the covariance of data, ln|H_1| and arg H_1 between the pixels of a patch."""
    root = 0.05 * np.random.default_rng(seed).normal(size=(DATA + 2, DATA + 2))
    return np.asarray(root @ root.T + 1e-4 * np.eye(DATA + 2))


def means() -> F:
    return np.array([-0.10, -0.25, -0.30, -0.80, 0.20, 0.35])


def model(
    *, mean: F | None = None, mpi_variance: float = MPI_VARIANCE, range_m: F | float = 2.0, covariance: F | None = None
) -> DiffuseModel:
    """Return a model that is the same for all patches, except for `mean`, (values, rows, columns)."""
    grid = patch_grid(*SHAPE, View(20.0, ((SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2)))
    between = spread() if covariance is None else covariance
    constant = [*(between[entry] for entry in needed_entries(DATA)), PATCH_VARIANCE, mpi_variance]
    every = np.ones((grid.rows, grid.columns))
    values = means()[:, None, None] * every if mean is None else mean
    planes = np.concatenate([values, np.array(constant)[:, None, None] * every]).astype(np.float32)
    return DiffuseModel(
        DiffuseSettings(period_ns=40.0, harmonics=HARMONICS),
        DiffuseChoice("tail", 6, 0.0),
        VARIANCES,
        CoarsePlanes(planes, DATA, needed_entries(DATA)),
        upsampler(planes, range_m * every, every > 0, grid),
        every < 0,
        0.25,
    )


def light(seed: int = 5, strength: float = 0.2) -> Z:
    """Return phasors, (H, n), with random direct phases; their data scatter about the means as pixels of a patch do."""
    rng = np.random.default_rng(seed)
    values = means() + rng.multivariate_normal(np.zeros(DATA + 2), spread(), PIXELS)
    first = strength * rng.uniform(0.5, 1.5, PIXELS) * np.exp(1j * rng.uniform(-np.pi, np.pi, PIXELS))
    further = [
        np.abs(first) * np.exp(values[:, i]) * np.exp(1j * (values[:, DATA // 2 + i] + h * np.angle(first)))
        for i, h in enumerate(HARMONICS[1:])
    ]
    return np.stack([first, *further])


def expected_answer(p: Z, variances: F, mpi_variance: float = MPI_VARIANCE) -> dict[str, float]:
    """Return the answer of one pixel with phasors (H,), computed in double precision with whole matrices.

    The unknown is ln(p_1/direct). Its noise is that of ln p_1, which is also in all data.
    """
    h, count = np.array(HARMONICS), len(HARMONICS) - 1
    least = np.array([0.1, 1.0, 1.0]) * np.sqrt(variances)
    size = np.maximum(np.abs(p), least)
    noise = np.diag(variances / size**2)
    sizes, phases = np.zeros((DATA + 2, count + 1)), np.zeros((DATA + 2, count + 1))
    for i in range(count):
        sizes[i, [0, i + 1]] = -1.0, 1.0
        phases[count + i, [0, i + 1]] = -h[i + 1], 1.0
    sizes[-2, 0] = phases[-1, 0] = 1.0
    whole = spread() + sizes @ noise @ sizes.T + phases @ noise @ phases.T
    differences = (
        np.concatenate([np.log(size[1:] / size[0]), np.angle(p[1:]) - h[1:] * np.angle(p[0])]) - means()[:DATA]
    )
    differences[count:] = np.angle(np.exp(1j * differences[count:]))
    gain = whole[DATA:, :DATA] @ np.linalg.inv(whole[:DATA, :DATA])
    left = whole[DATA:, DATA:] - gain @ whole[:DATA, DATA:]
    logarithm, lag = means()[DATA:] + gain @ differences
    direct = p[0] * np.exp(-logarithm - 1j * lag)
    mpi = p[0] - direct
    chi_squared = differences @ np.linalg.solve(whole[:DATA, :DATA], differences)
    misfit = max(chi_squared / (2.0 + 1.5 * DATA), 1.0)
    return {
        "direct_phase_rad": np.angle(direct) % (2 * np.pi),
        "direct_amplitude": abs(direct),
        "direct_sigma_rad": np.sqrt((max(left[1, 1], 0.05 * noise[0, 0]) + PATCH_VARIANCE) * misfit),
        "mpi_phase_rad": np.angle(direct) % (2 * np.pi) + np.angle(mpi / direct) % (2 * np.pi),
        "mpi_amplitude": abs(mpi),
        "mpi_sigma_rad": min(np.sqrt((mpi_variance + noise[0, 0]) * misfit), np.pi / np.sqrt(3)),
        "chi_squared": chi_squared,
    }


def answered(p: Z, tail: DiffuseModel, samples: F | None = None) -> DiffusePixels:
    return diffuse_pixels(p, model=tail, first=0, usable=np.ones(PIXELS, bool), samples=samples)


def assert_answers(found: DiffusePixels, p: Z, variances: F, mpi_variance: float = MPI_VARIANCE) -> None:
    for pixel in range(PIXELS):
        expected = expected_answer(p[:, pixel], variances[:, pixel], mpi_variance)
        for name, value in expected.items():
            assert_allclose(getattr(found, name)[pixel], value, rtol=2e-3, atol=2e-4, err_msg=f"{name} of {pixel}")


@pytest.mark.parametrize("strength", [0.2, 0.005])
def test_the_answer_of_a_pixel_is_conditioned_on_its_data(strength: float) -> None:
    p = light(strength=strength)
    variances = np.array(VARIANCES)[:, None] * np.ones(PIXELS)
    found = answered(p, model())
    assert found.answered.all()
    assert_answers(found, p, variances)


def test_means_of_more_samples_have_less_noise() -> None:
    p, samples = light(strength=0.01), np.linspace(1.0, 30.0, PIXELS)
    found = answered(p, model(), samples)
    assert_answers(found, p, np.array(VARIANCES)[:, None] / samples)


def test_a_harmonic_fainter_than_its_noise_counts_as_large_as_its_noise() -> None:
    """|p_h| counts as at least the noise of the harmonic, and |p_1| as at least a tenth of its noise."""
    p = light()
    p[1, ::3] *= 0.3 * np.sqrt(VARIANCES[1]) / np.abs(p[1, ::3])
    p[2, 1::3] *= 0.2 * np.sqrt(VARIANCES[2]) / np.abs(p[2, 1::3])
    p[0, 5::7] *= 0.05 * np.sqrt(VARIANCES[0]) / np.abs(p[0, 5::7])
    found = answered(p, model())
    for pixel in range(PIXELS):
        expected = expected_answer(p[:, pixel], np.array(VARIANCES))
        assert_allclose(found.chi_squared[pixel], expected["chi_squared"], rtol=0.03)
        assert_allclose(found.direct_sigma_rad[pixel], expected["direct_sigma_rad"], rtol=0.02)
        assert_allclose(found.mpi_sigma_rad[pixel], expected["mpi_sigma_rad"], rtol=0.02)


@pytest.mark.parametrize(("mpi_variance", "sigma_rad"), [(-1.0, None), (30.0, np.pi / np.sqrt(3.0))])
def test_the_sigma_of_a_phase_is_at_most_that_of_a_random_phase(mpi_variance: float, sigma_rad: float | None) -> None:
    p = light()
    found = answered(p, model(mpi_variance=mpi_variance))
    noise = np.sqrt(VARIANCES[0] * np.maximum(found.chi_squared / (2.0 + 1.5 * DATA), 1.0)) / np.abs(p[0])
    assert_allclose(found.mpi_sigma_rad, noise if sigma_rad is None else sigma_rad, rtol=1e-5)


def test_the_variance_grows_with_the_misfit_of_a_pixel_that_contradicts_the_tail() -> None:
    """Sigma of a pixel that sees an edge was that of its neighbours; it was off by ten sigma and more."""
    p = light()
    usual = answered(p, model())
    p[1] *= np.exp(1j * np.where(np.arange(PIXELS) % 2 == 0, 1.5, 0.0))
    found = answered(p, model())
    assert (found.chi_squared[::2] > 20.0).all()
    assert_allclose(found.direct_sigma_rad[1::2], usual.direct_sigma_rad[1::2])
    for name in ("direct_sigma_rad", "mpi_sigma_rad"):
        grown = getattr(found, name) / getattr(usual, name)
        expected = np.maximum(found.chi_squared / 8.0, 1.0) / np.maximum(usual.chi_squared / 8.0, 1.0)
        assert_allclose(grown, np.sqrt(expected), rtol=1e-3)


def test_pixels_without_light_and_unusable_pixels_are_not_answered() -> None:
    p, usable = light(), np.ones(PIXELS, bool)
    usable[3] = False
    p[:, 10], p[1, 11], p[2, 12], p[0, 13], p[0, 14] = np.nan, 1.51, -1.51j, 0.0, 1.49
    found = diffuse_pixels(p, model=model(), first=0, usable=usable)
    assert np.flatnonzero(~found.answered).tolist() == [3, 10, 11, 12, 13]
    for values in (*found.direct, *found.mpi, found.chi_squared):
        assert np.flatnonzero(np.isnan(values)).tolist() == [3, 10, 11, 12, 13]


@pytest.mark.parametrize("offset_m", [0.0, 0.3])
def test_a_pixel_uses_patches_at_its_own_range_after_their_lag_is_subtracted(offset_m: float) -> None:
    """The left half is at 1 m with a lag of .2 rad, the right half at 3 m with .5 rad; the data tell nothing more.

    The range offset is the difference between the range of a pixel and the range of its phase.
    """
    grid = model().upsampler.grid
    near = np.arange(grid.columns) < grid.columns // 2
    lag = np.where(near, 0.2, 0.5) * np.ones((grid.rows, 1))
    mean = np.concatenate([np.zeros((DATA + 1, *lag.shape)), lag[None]])
    unsure = 1e-6 * np.eye(DATA + 2)
    tail = model(mean=mean, range_m=np.where(near, 1.0, 3.0) * np.ones((grid.rows, 1)), covariance=unsure)
    tail = replace(tail, range_offset_m=np.full(SHAPE, offset_m) if offset_m else None)
    column = np.arange(PIXELS) % SHAPE[1]
    edge = grid.columns // 2 * grid.side
    at_m = np.where(column < edge + 1, 1.0, 3.0)
    lag = np.where(column < edge + 1, 0.2, 0.5)
    phase = (at_m - offset_m) / M_PER_RAD + lag
    p = np.stack([0.3 * np.exp(1j * h * phase) for h in HARMONICS])
    found = answered(p, tail)
    assert_allclose(found.direct_phase_rad * M_PER_RAD, at_m - offset_m, atol=0.02)


def test_the_range_of_a_pixel_is_that_of_its_phase_minus_the_lag_of_its_patches() -> None:
    """Patches are at 1 m on the left and at 2.9 m on the right, all with a lag of 2 rad, which is 1.9 m of range.

    ln|H_1| differs between the halves, so the amplitude shows whose patches a pixel used.
    """
    grid = model().upsampler.grid
    near = np.arange(grid.columns) < grid.columns // 2
    every = np.ones((grid.rows, 1))
    mean = np.concatenate([np.zeros((DATA, grid.rows, grid.columns)), np.full((2, grid.rows, grid.columns), 2.0)])
    mean[DATA] = np.where(near, 0.1, 0.7) * every
    tail = model(mean=mean, range_m=np.where(near, 1.0, 2.9) * every, covariance=1e-6 * np.eye(DATA + 2))
    column = np.arange(PIXELS) % SHAPE[1]
    left = column < grid.columns // 2 * grid.side
    phase = np.where(left, 1.0, 2.9) / M_PER_RAD + 2.0
    found = answered(np.stack([0.3 * np.exp(1j * h * phase) for h in HARMONICS]), tail)
    assert_allclose(found.direct_amplitude, 0.3 * np.exp(-np.where(left, 0.1, 0.7)), rtol=0.01)


def test_direct_phases_are_within_a_turn_and_mpi_phases_within_a_turn_after_them() -> None:
    found = answered(light(seed=9), model())
    assert ((found.direct_phase_rad >= 0.0) & (found.direct_phase_rad < 2.0 * np.pi)).all()
    behind = found.mpi_phase_rad - found.direct_phase_rad
    assert ((behind >= 0.0) & (behind < 2.0 * np.pi)).all()
