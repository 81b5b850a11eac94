"""The patches that count and the model that a frame gets: each limit of `choice`, tested on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.phasors.pooling import SharedNoise
from cadtof_cli.resolver.diffuse.choice import (
    PatchKinds,
    misfits_without_mpi,
    mpi_probability,
    patch_kinds,
    separate_patches,
    tail_fits,
    two_paths_fail,
)
from cadtof_cli.resolver.diffuse.grid import assumed_view, patch_grid
from cadtof_cli.resolver.diffuse.light import FrameTraits, PatchLight, PatchMeans
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.settings import MpiModel
from tests.support.diffuse_patches import traits_of

SIGMA = 1e-3

VARIANCES: Float = np.array([SIGMA**2, 2 * SIGMA**2, 3 * SIGMA**2])
FRAME = replace(traits_of((1, 2, 3), 0.0), variances=VARIANCES)

TAIL = 0.8 * np.exp(-0.2j)


def frame(ratios: list[complex], *, third: complex = 0.7) -> PatchMeans:
    """Return a row of patches with these q_2 and a common q_3, each with 64 pixels of amplitude .2."""
    second: Complex = np.array([ratios])
    ratio, one = np.stack([second, np.full_like(second, third)]), np.ones((1, len(ratios)))
    return PatchMeans(ratio, 0.2 * one, 64.0 * one, 0.0 * one, one)


def kinds(means: PatchMeans, model: MpiModel = "auto") -> PatchKinds:
    settings = DiffuseSettings(model=model, period_ns=40.0, harmonics=(1, 2, 3))
    columns = means.amplitude.size
    grid = replace(
        patch_grid(240, 320, assumed_view(240, 320)), slope=np.zeros((2, 1, columns)), ray=np.ones((3, 1, columns))
    )
    nothing = PatchLight(
        np.zeros((64, 1, columns), bool),
        np.zeros((64, 1, columns), np.float32),
        np.zeros((7, 64, 1, columns), np.float32),
    )
    traits = FrameTraits(grid, settings, VARIANCES, tuple(VARIANCES.tolist()), SharedNoise(1.0, 0.0))
    return patch_kinds(nothing, means, traits)


def test_a_room_with_a_tail_gets_the_diffuse_model() -> None:
    found = kinds(frame([TAIL] * 64))
    assert (found.choice.reason, found.choice.separate_share, int(found.lit.sum())) == ("tail", 0.0, 64)


def test_a_room_needs_64_patches_with_light() -> None:
    assert kinds(frame([TAIL] * 63)).choice.reason == "few patches with light"
    assert kinds(frame([TAIL] * 63), "diffuse").choice.reason == "few patches with light"
    assert not kinds(frame([TAIL] * 63)).separate.any()


def test_up_to_a_fifth_of_the_patches_may_be_separate() -> None:
    early = np.exp(0.5j)
    within, beyond = (kinds(frame([early] * count + [TAIL] * (100 - count))) for count in (20, 21))
    assert (within.choice.reason, within.choice.separate_share) == ("tail", 0.2)
    assert (beyond.choice.reason, beyond.choice.separate_share) == ("separate paths", 0.21)
    assert within.separate.sum() == 20
    forced = kinds(frame([early] * 100), "diffuse")
    assert (forced.choice.reason, forced.choice.separate_share) == ("tail", 0.0)


def test_ratios_of_1_are_no_mpi_and_separate_patches_stay_marked() -> None:
    found = kinds(frame([np.exp(0.5j)] + [TAIL] * 60 + [1.0] * 39, third=1.0))
    assert (found.choice.reason, found.separate.sum()) == ("tail", 1)
    none = kinds(frame([1.0] * 100, third=1.0))
    assert (none.choice.reason, none.choice.separate_share) == ("no MPI to be seen", 0.0)
    assert kinds(frame([1.0] * 100, third=1.0), "diffuse").choice.reason == "tail"


@pytest.mark.parametrize(("clean", "reason"), [(49, "tail"), (51, "no MPI to be seen")])
def test_a_view_without_mpi_in_half_of_its_patches_has_no_tail(clean: int, reason: str) -> None:
    assert kinds(frame([1.0] * clean + [TAIL] * (100 - clean), third=1.0)).choice.reason == reason


@pytest.mark.parametrize(("times", "reason"), [(1.3, "no MPI to be seen"), (1.5, "tail")])
def test_mpi_is_seen_from_twice_the_variance_of_the_noise_on(times: float, reason: str) -> None:
    """|q_2|, arg q_2, |q_3| and arg q_3 deviate by `times` their noise, so the mean squared deviation is times²."""
    relative = np.sqrt(1.0 / (0.2**2 * 64.0))
    size = [times * np.sqrt(VARIANCES[0] + v) * relative for v in VARIANCES[1:]]
    phase = [times * np.sqrt(h * h * VARIANCES[0] + v) * relative for h, v in zip((2, 3), VARIANCES[1:], strict=True)]
    second, third = ((1.0 - a) * np.exp(-1j * b) for a, b in zip(size, phase, strict=True))
    means = frame([second] * 80, third=third)
    assert kinds(means).choice.reason == reason
    lit = np.ones((1, 80), bool)
    assert_allclose(np.mean(misfits_without_mpi(means, lit, FRAME)), times**2)


def test_noise_alone_gives_mpi_a_low_probability_and_a_room_gives_it_1() -> None:
    rng = np.random.default_rng(4)
    noise = [mpi_probability(float(rng.chisquare(600)) / 600, numbers=600) for _ in range(200)]
    assert float(np.mean(noise)) < 0.1
    assert max(noise) < 0.3
    assert mpi_probability(20.0, numbers=128) == 1.0
    assert mpi_probability(0.8, numbers=600) == mpi_probability(1.0, numbers=600)


def test_the_probability_of_mpi_is_that_of_a_free_variance_against_a_known_one() -> None:
    """The odds are integrated here for n numbers with the mean square m.

    Their variance is 1, or its logarithm has a uniform distribution over a range of 2√π.
    """
    numbers, known = 400, 0.1
    count = 2.0 / (2.0 / numbers + known**2)
    logs = np.linspace(-3.0, 3.0, 60001)
    for misfit in (1.0, 1.3, 1.6):
        relative = np.exp(-0.5 * count * (logs + misfit * np.exp(-logs) - misfit))
        odds = float(relative.sum() * (logs[1] - logs[0])) / (2.0 * np.sqrt(np.pi))
        assert_allclose(mpi_probability(misfit, numbers=numbers), odds / (1.0 + odds), rtol=0.02)


def test_a_frame_that_is_forced_to_have_a_tail_gets_the_probability_of_mpi() -> None:
    assert kinds(frame([1.0] * 100, third=1.0), "diffuse").mpi_probability < 0.1
    assert kinds(frame([TAIL] * 100), "diffuse").mpi_probability == 1.0


def test_the_misfit_is_the_mean_over_lit_patches_only() -> None:
    means = frame([1.0, 1.0 - 5e-3, 7.0], third=1.0)
    lit: Bool = np.array([[True, True, False]])
    single = (5e-3) ** 2 / (3 * SIGMA**2) * 0.2**2 * 64.0
    found = misfits_without_mpi(means, lit, FRAME)
    assert_allclose(np.mean(found), single / 8, rtol=1e-9)


def test_a_patch_counts_with_a_tenth_of_its_pixels_lit_and_an_amplitude_above_three_times_the_noise() -> None:
    amplitude, pixels = np.array([0.0031, 0.0029, 0.2, 0.2]), np.array([64.0, 64.0, 6.0, 7.0])
    means = PatchMeans(np.ones((1, 4), complex), amplitude, pixels, np.zeros(4), pixels / 64.0)
    assert kinds(means).lit.tolist() == [True, False, False, True]
    least = PatchMeans(np.ones((1, 1), complex), np.array([3 * SIGMA]), np.array([64.0]), np.zeros(1), np.ones(1))
    assert kinds(least).lit.tolist() == [False]


@pytest.mark.parametrize(
    ("ratio", "separate"),
    [
        (np.exp(0.0998j), False),
        (np.exp(0.106j), True),
        (1.2, False),
        (1.203, False),
        (1.206, True),
        (np.exp(-2j), False),
    ],
)
def test_a_tail_has_a_phase_of_at_most_a_tenth_and_a_ratio_of_at_most_1_2(ratio: complex, separate: bool) -> None:
    """The limits have a margin of seven times the noise of a mean of 64 pixels: 7 · .001/(.2 · 8) = .0044."""
    means = PatchMeans(
        np.full((1, 1, 1), ratio), np.full((1, 1), 0.2), np.full((1, 1), 64.0), np.zeros((1, 1)), np.ones((1, 1))
    )
    assert bool(separate_patches(means, np.ones((1, 1), bool), SIGMA)[0, 0]) is separate
    assert not separate_patches(means, np.zeros((1, 1), bool), SIGMA).any()


def test_a_tail_fits_if_the_median_misfit_is_at_most_three_times_the_expected_one() -> None:
    for two_path_misfit in (0.0, 1e6):
        assert tail_fits(np.array([1.0] * 4 + [12.0] * 4), np.full(8, two_path_misfit), 4)
        assert not tail_fits(np.array([1.0] * 4 + [12.1] * 5), np.full(9, two_path_misfit), 4)
        assert tail_fits(np.array([9.9]), np.zeros(1), 2)
        assert not tail_fits(np.array([19.0]), np.full(1, two_path_misfit), 6)


@pytest.mark.parametrize(("data", "limit", "most"), [(2, 10.0, 6), (4, 5.0, 16), (6, 5.0, 16)])
def test_no_tail_fits_if_it_leaves_too_many_patches_unexplained(data: int, limit: float, most: int) -> None:
    for count in (most, most + 1):
        chi_squared = np.array([limit * data + 0.1] * count + [limit * data] * 10 + [0.1] * (90 - count))
        assert tail_fits(chi_squared, np.zeros(100), data) is (count == most)


def test_patches_that_two_paths_explain_no_better_are_no_evidence_against_a_tail() -> None:
    """In 30 of 100 patches the tail leaves χ² = 50 per datum.

    These are no evidence against a tail if two paths leave as much in each datum that follows q_2.
    """
    unexplained = np.array([200.0] * 30 + [0.1] * 70)
    assert not tail_fits(unexplained, np.array([100.0] * 30 + [1e6] * 70), 4)
    assert tail_fits(unexplained, np.array([100.1] * 30 + [0.0] * 70), 4)


@pytest.mark.parametrize(("data", "limit"), [(4, 6.0), (6, 12.0)])
def test_two_paths_fail_if_their_median_misfit_of_further_harmonics_is_above_three_times_the_expected_one(
    data: int, limit: float
) -> None:
    """With two harmonics, nothing tells."""
    assert two_paths_fail(np.array([0.0] * 4 + [limit + 0.1] * 5), data)
    assert not two_paths_fail(np.array([0.0] * 4 + [limit] * 5), data)
    assert not two_paths_fail(np.array([1e6]), 2)
