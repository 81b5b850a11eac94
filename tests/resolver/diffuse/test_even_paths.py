"""Second paths whose shares and delays change evenly over the view are told from tails, which never change evenly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.resolver.diffuse.even_paths import PatchPlaces, are_even, are_two_paths
from cadtof_cli.resolver.diffuse.second_paths import PatchData, SecondPaths, has_one_share, of_two_paths
from tests.support.diffuse_frames import OMEGA, F, Tail
from tests.support.diffuse_patches import LIT, PATCHES, patch_data

ROWS, COLUMNS = PATCHES

DOWN, ACROSS = (
    side.ravel()
    for side in np.meshgrid(np.linspace(-0.43, 0.43, ROWS), np.linspace(-0.57, 0.57, COLUMNS), indexing="ij")
)
"""Slopes of the patches' rays, Y and X."""

COUNT = ROWS * COLUMNS

SLANT: Float = np.sqrt(1.0 + ACROSS**2 + DOWN**2)

PLACES = PatchPlaces(np.stack([np.ones(COUNT), ACROSS, DOWN, SLANT], axis=1), LIT, OMEGA)


def second_paths(
    share: float | F, later_ns: float | F, sigma: float, *, harmonics: int = 2, seed: int = 0
) -> PatchData:
    """Return patches with a second path of this share of the light and this delay."""
    turn: Complex = np.exp(1j * OMEGA * np.broadcast_to(later_ns, COUNT))
    return patch_data(*(share * turn**h for h in range(1, harmonics + 1)), sigma=sigma, seed=seed)


def is_even(data: PatchData) -> bool:
    with np.errstate(all="ignore"):
        return are_even(SecondPaths.of(data), data, PLACES)


def room(uneven: float, sigma: float, *, strength: float = 0.25, seed: int = 0) -> PatchData:
    """Return patches with a tail that is stronger and earlier near two edges of the room, one upright and one level."""
    edges = np.exp(-6.0 * np.abs(ACROSS + 0.1)) + np.exp(-5.0 * np.abs(DOWN - 0.25))
    tails = [Tail(strength * float(np.exp(uneven * x)), 4.0 - 2.0 * uneven * float(x), 8.0) for x in edges]
    mpi = [np.array([tail.phasor(h) for tail in tails]) for h in (1, 2)]
    return patch_data(*mpi, sigma=sigma, seed=seed)


@pytest.mark.parametrize("h", [2, 3])
def test_slopes_of_the_ratio_of_two_paths_are_its_derivatives(h: int) -> None:
    rng, step = np.random.default_rng(1), 1e-6
    share, later = rng.uniform(0.0, 0.9, 50), rng.uniform(-2.5, 2.5, 50)
    found, slopes = of_two_paths(share, later, h)
    first, further = (1.0 + share * np.exp(1j * k * later) for k in (1, h))
    ratio = further / np.abs(first) * (np.conj(first) / np.abs(first)) ** h
    assert_allclose(np.exp(found[0]), np.abs(ratio))
    assert_allclose(np.exp(1j * found[1]), ratio / np.abs(ratio))
    by_share = (of_two_paths(share + step, later, h)[0] - found) / step
    by_delay = (of_two_paths(share, later + step, h)[0] - found) / step
    assert_allclose(slopes, np.stack([by_share, by_delay], axis=1), atol=2e-4)


@pytest.mark.parametrize("sigma", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize(("share", "later_ns"), [(0.1, 6.0), (0.1, 11.0), (0.3, 8.0)])
def test_one_share_at_one_delay_is_taken_for_two_paths(share: float, later_ns: float, sigma: float) -> None:
    data = second_paths(share, later_ns, sigma)
    assert is_even(data)
    assert are_two_paths(data, PLACES)
    with np.errstate(all="ignore"):
        assert not has_one_share(SecondPaths.of(data), rad_per_ns=OMEGA)


def test_weak_shares_and_delays_that_grow_evenly_are_even() -> None:
    """Shares grow from .005 to .03 downwards, and delays from 3 to 20 ns across: a weak card of `simulate`."""
    share, later = 0.0175 + 0.0125 * DOWN / 0.43, 11.5 + 8.5 * ACROSS / 0.57
    for seed in range(5):
        assert is_even(second_paths(share, later, 1e-3, seed=seed))


@pytest.mark.parametrize("later_ns", [9.0 * SLANT, 9.0 + 4.0 * ACROSS, 6.0 + 3.0 * SLANT - 2.0 * DOWN])
def test_even_delays_are_even_with_any_shares(later_ns: F) -> None:
    """A pane stands before a patterned wall. The delays are those of two planes, and the shares follow the pattern."""
    share = 0.15 * np.exp(0.5 * np.random.default_rng(7).normal(size=COUNT))
    assert is_even(second_paths(share, later_ns, 5e-4))
    uneven = later_ns + 0.3 * np.random.default_rng(8).normal(size=COUNT)
    assert not is_even(second_paths(share, uneven, 5e-4))


@pytest.mark.parametrize(("share", "sigma"), [(0.15, 1e-3), (0.4, 2e-3)])
def test_what_noise_alone_makes_of_even_delays_is_even(share: float, sigma: float) -> None:
    shares = share * np.exp(0.5 * np.random.default_rng(7).normal(size=COUNT))
    for seed in range(3):
        assert is_even(second_paths(shares, 6.0 + 2.7 * ACROSS, sigma, seed=seed))


@pytest.mark.parametrize("middle_ns", [-16.0, 8.0, 19.5, 20.5, 23.0])
def test_even_delays_are_even_whichever_way_round_the_period_they_lie(middle_ns: float) -> None:
    """Delays about half the period of 40 ns are seen as late and as early ones."""
    shares = 0.2 * np.exp(0.5 * np.random.default_rng(7).normal(size=COUNT))
    assert is_even(second_paths(shares, middle_ns + 5.0 * ACROSS, 3e-4))


@pytest.mark.parametrize(("uneven_ns", "even"), [(0.05, True), (0.15, False)])
def test_delays_may_be_uneven_by_a_tenth_of_a_nanosecond_per_unit_of_the_scatter_of_shares(
    uneven_ns: float, even: bool
) -> None:
    """The logarithms of the shares scatter by .5, so the delays scatter by half of `uneven_ns`."""
    share = 0.15 * np.exp(0.5 * np.random.default_rng(7).normal(size=COUNT))
    later_ns = 9.0 + 4.0 * ACROSS + 0.5 * uneven_ns * np.random.default_rng(8).normal(size=COUNT)
    assert is_even(second_paths(share, later_ns, 1e-4)) == even


@pytest.mark.parametrize("sigma", [1e-4, 1e-3, 3e-3, 1e-2])
@pytest.mark.parametrize("uneven", [0.2, 0.5, 1.0])
def test_tails_that_change_with_the_surfaces_are_not_even(uneven: float, sigma: float) -> None:
    for seed in range(5):
        assert not is_even(room(uneven, sigma, seed=seed))


def test_noise_that_hides_the_mpi_is_not_taken_for_even_paths() -> None:
    """If noise hides the shares, the frame is not taken for two paths, whether it has a tail or a second path."""
    for seed in range(5):
        assert not is_even(room(0.5, 0.2, seed=seed))
        assert not is_even(second_paths(0.005, 9.0, 1e-2, seed=seed))


def test_a_fifth_of_the_view_may_have_no_second_path_and_a_piece_another_one() -> None:
    """The noise of a share is 11 % of it. So single patches do not tell that all shares are the same."""
    share = np.where(DOWN < -0.26, 0.0, 0.05)
    assert is_even(second_paths(share, 8.0, 2e-3))
    share = np.where((DOWN < -0.2) & (ACROSS < -0.4), 0.2, 0.05)
    assert 0.03 < np.mean(share == 0.2) < 0.08
    assert is_even(second_paths(share, 8.0, 2e-3))


def test_residuals_that_neighbours_have_in_common_show_a_tail_that_noise_hides_in_each_patch() -> None:
    """Shares vary by a seventh over the view, under noise of the same size.

    χ² hardly shows this, but the products of neighbouring residuals do.
    """
    wave = 1.0 + 0.25 * np.sin(12.0 * ACROSS) * np.sin(12.0 * DOWN)
    for seed in range(5):
        assert is_even(second_paths(0.05, 8.0, 5e-3, seed=seed))
        assert not is_even(second_paths(0.05 * wave, 8.0, 5e-3, seed=seed))


def test_a_third_harmonic_that_two_paths_do_not_predict_is_evidence_against_them() -> None:
    tail = Tail(0.3, 3.0, 9.0)
    mpi = [np.full(COUNT, tail.phasor(h)) for h in (1, 2, 3)]
    assert are_two_paths(patch_data(*mpi[:2], sigma=1e-3), PLACES)
    assert not are_two_paths(patch_data(*mpi, sigma=1e-3), PLACES)
    assert are_two_paths(second_paths(0.1, 8.0, 1e-3, harmonics=3), PLACES)


def test_light_without_mpi_or_noise_raises_no_error() -> None:
    nothing = np.zeros(COUNT, np.complex128)
    for sigma in (0.0, 1e-3):
        with np.errstate(all="ignore"):
            assert not are_two_paths(patch_data(nothing, nothing, sigma=sigma), PLACES)
            assert are_two_paths(second_paths(0.1, 8.0, sigma), PLACES) == (sigma > 0.0)


@pytest.mark.parametrize("part", [0.45, 0.5, 0.55, 0.8])
@pytest.mark.parametrize(("share", "later_ns"), [(0.4, 10.7), (0.2, 7.0), (0.1, 14.0)])
def test_any_part_of_the_view_may_have_the_second_path(part: float, share: float, later_ns: float) -> None:
    """The patches without a second path are judged as such. So they do not hide how well the others fit."""
    left = np.where(np.quantile(ACROSS, part) > ACROSS, share, 0.0)
    assert is_even(second_paths(left, later_ns, 5e-4))
