"""Patches with two paths count as a surface that lets light through: each limit, tested on both sides."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.resolver.diffuse.grid import PatchGrid, View, patch_grid
from cadtof_cli.resolver.diffuse.light import PatchMeans
from cadtof_cli.resolver.diffuse.nets import find_nets, freed_paths, typical_tail
from cadtof_cli.resolver.diffuse.records import Nets, Tails
from tests.support.diffuse_frames import M_PER_RAD, OMEGA, Tail
from tests.support.diffuse_patches import traits_of

HARMONICS = (1, 2, 3)

TAIL = np.array([1.0 + Tail(0.2, 3.0, 9.0).phasor(h) for h in HARMONICS])


def grid() -> PatchGrid:
    return patch_grid(96, 128, View(120.0, (63.5, 47.5)))


def wall_m() -> Float:
    """Return the ranges of the patches of a wall that faces the camera 3.5 m away."""
    return np.asarray(3.5 / grid().ray[2])


def rectangle(rows: int, columns: int) -> Bool:
    chosen = np.zeros(grid().ray.shape[1:], bool)
    chosen[3 : 3 + rows, 5 : 5 + columns] = True
    return chosen


def seen_in(
    net: Bool,
    *,
    share: Float | float = 0.5,
    delay_ns: float = 8.0,
    off_m: Float | float = 0.0,
    light: Float | float = 1.0,
    valid: Bool | None = None,
) -> Nets | None:
    """Return what `find_nets` finds in patches of the wall with a net `delay_ns` before it.

    `share` is the share of the net in the light of its patches. The farther paths end `off_m` behind the wall. `light`
    is a factor on the light of all patches, or, if it is one number, on that of the net's patches.
    """
    far_m = wall_m() + off_m
    near, later = far_m / M_PER_RAD - delay_ns * OMEGA, delay_ns * OMEGA
    weight = np.where(net, share, 0.0)
    phasors: Complex = np.stack(
        [
            0.3
            * (np.where(net, light, 1.0) if isinstance(light, float) else light)
            * (
                weight * np.exp(1j * h * near)
                + (1.0 - weight) * np.exp(1j * h * np.where(net, near + later, wall_m() / M_PER_RAD))
            )
            * t
            for h, t in zip(HARMONICS, TAIL, strict=True)
        ]
    )
    every = np.ones(net.shape, bool) if valid is None else valid
    lag_rad = np.angle(phasors[0]) - np.where(net, 1.0, wall_m()) / M_PER_RAD
    back = np.exp(-1j * np.array(HARMONICS[1:])[:, None, None] * np.angle(phasors[0]))
    ratios = phasors[1:] / np.abs(phasors[0]) * back
    means = PatchMeans(ratios, np.abs(phasors[0]), weight, np.angle(phasors[0]), weight)
    posterior = tail_values()[:, None] + np.zeros(int(every.sum()))
    posterior[-1] = lag_rad[every]
    # the other fields play no part
    patches: Any = SimpleNamespace(valid=every, means=means)
    fit: Any = SimpleNamespace(posterior=posterior)
    return find_nets(patches, fit, traits_of(HARMONICS, 0.0, grid()))


def tail_values() -> Float:
    """Return ln|H_h/H_1|, arg H_h − h·arg H_1, ln|H_1| and arg H_1 of TAIL."""
    first, second, third = TAIL
    sizes, phases = np.log(np.abs(TAIL[1:] / first)), np.angle([second / first**2, third / first**3])
    return np.array([*sizes, *phases, np.log(abs(first)), np.angle(first)])


def found_by(net: Bool, **options: Any) -> Bool:
    seen = seen_in(net, **options)
    return np.zeros(net.shape, bool) if seen is None else seen.found


@pytest.mark.parametrize(("rows", "columns", "found"), [(2, 6, True), (1, 12, True), (1, 11, False), (2, 5, False)])
def test_a_net_has_at_least_twelve_patches_side_by_side(rows: int, columns: int, found: bool) -> None:
    net = rectangle(rows, columns)
    np.testing.assert_array_equal(found_by(net), net & found)


def test_patches_that_touch_at_corners_are_side_by_side_and_others_are_not() -> None:
    steps = np.zeros(grid().ray.shape[1:], bool)
    for i in range(7):
        steps[2 + i, 3 + 2 * i : 5 + 2 * i] = True
    np.testing.assert_array_equal(found_by(steps), steps)
    with_gap = rectangle(2, 12)
    with_gap[:, 10:12] = False
    assert not found_by(with_gap).any()


@pytest.mark.parametrize(("columns", "found"), [(14, True), (15, False)])
def test_a_net_covers_at_most_two_fifths_of_the_patches(columns: int, found: bool) -> None:
    net = rectangle(10, columns)
    assert (net.mean() <= 0.4) == found
    np.testing.assert_array_equal(found_by(net), net & found)


@pytest.mark.parametrize(("share", "found"), [(0.24, False), (0.26, True), (0.79, True), (0.86, False)])
def test_the_nearer_path_has_at_least_a_quarter_and_the_farther_a_fifth_of_the_light(share: float, found: bool) -> None:
    net = rectangle(4, 6)
    np.testing.assert_array_equal(found_by(net, share=share, light=2.0), net & found)


@pytest.mark.parametrize(("light", "found"), [(0.38, False), (0.42, True), (3.0, True)])
def test_at_least_a_fifth_of_the_amplitude_of_the_wall_is_left_behind_a_net(light: float, found: bool) -> None:
    net = rectangle(4, 6)
    np.testing.assert_array_equal(found_by(net, share=0.5, light=light), net & found)


def test_beside_a_net_a_weaker_farther_path_is_enough() -> None:
    """A farther path of 15 % is enough if the nearer path continues the net within 6 % of its range."""
    net = rectangle(4, 8)
    shares = np.full(net.shape, 0.5)
    shares[3, 5:] = 0.82
    np.testing.assert_array_equal(found_by(net, share=shares), net)
    shares[3, 5:] = 0.87
    np.testing.assert_array_equal(found_by(net, share=shares), net & (shares < 0.8))
    ends_m = np.zeros(net.shape)
    ends_m[3, 5:] = 0.21
    np.testing.assert_array_equal(found_by(net, off_m=ends_m, delay_ns=4.0), net & (ends_m == 0.0))


@pytest.mark.parametrize(("off_m", "found"), [(0.14, True), (-0.14, True), (0.16, False), (-0.16, False)])
def test_the_farther_path_ends_on_the_wall_within_fifteen_centimetres(off_m: float, found: bool) -> None:
    net = rectangle(4, 6)
    np.testing.assert_array_equal(found_by(net, off_m=off_m), net & found)


@pytest.mark.parametrize(("delay_ns", "found"), [(1.9, False), (2.1, True), (17.8, True), (18.2, False)])
def test_the_paths_are_two_to_eighteen_nanoseconds_apart(delay_ns: float, found: bool) -> None:
    net = rectangle(4, 6)
    np.testing.assert_array_equal(found_by(net, delay_ns=delay_ns), net & found)


def test_invalid_patches_are_no_part_of_a_net() -> None:
    net, valid = rectangle(4, 6), np.ones(grid().ray.shape[1:], bool)
    valid[3, 5:9] = False
    seen = seen_in(net, valid=valid)
    assert seen is not None
    np.testing.assert_array_equal(seen.found, net & valid)


def test_ranges_extend_one_patch_beyond_the_net_and_the_variance_follows_from_the_wall() -> None:
    """The variance of the phase is the sum of two squares.

    One standard deviation is .7 of the distance of the farther paths from the wall; the other is .2 of the tail's lag.
    """
    net, off_m = rectangle(4, 6), 0.1
    seen = seen_in(net, off_m=off_m)
    assert seen is not None
    near_m = wall_m() + off_m - 8.0 * OMEGA * M_PER_RAD
    assert_allclose(seen.near_m[net], near_m[net], atol=1e-3)
    around = np.zeros_like(net)
    around[2:8, 4:12] = True
    np.testing.assert_array_equal(np.isfinite(seen.near_m), around)
    assert_allclose(seen.near_m[2, 4], near_m[3, 5], atol=1e-3)
    assert_allclose(seen.near_m[2, 6], near_m[3, 5:8].mean(), atol=1e-3)
    lag = float(np.angle(TAIL[0]))
    assert seen.variance == pytest.approx((0.7 * off_m / M_PER_RAD) ** 2 + (0.2 * lag) ** 2, rel=0.05)
    assert_allclose((seen.tails.near, seen.tails.far), (TAIL, TAIL))


def test_the_typical_tail_is_that_of_the_median_values() -> None:
    """The values are ln|H_h/H_1|, arg H_h − h·arg H_1, ln|H_1| and arg H_1; the middle one of three patches has TAIL."""
    values = tail_values()[:, np.newaxis] + np.array([-0.2, 0.0, 0.5])
    assert_allclose(typical_tail(values, HARMONICS), TAIL, rtol=1e-9)


@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 4)])
def test_both_paths_are_freed_of_their_tails(harmonics: tuple[int, ...]) -> None:
    near = np.array([1.0 + Tail(0.08, 3.0, 9.0).phasor(h) for h in harmonics])
    far = np.array([1.0 + Tail(0.2, 3.0, 9.0).phasor(h) for h in harmonics])
    rng, h = np.random.default_rng(2), np.array(harmonics)[:, None]
    begin, later, share = rng.uniform(0, 6, 40), rng.uniform(1.2, 2.4, 40), rng.uniform(0.35, 0.7, 40)
    first, second = share * np.exp(1j * h * begin), (1.0 - share) * np.exp(1j * h * (begin + later))
    seen = first * near[:, None] + second * far[:, None]
    found = freed_paths(seen.reshape(-1, 5, 8), Tails(near, far, harmonics))
    assert found.phasors.shape == (len(harmonics), 5, 8)
    assert np.abs(found.phasors.reshape(-1, 40) - first - second).max() < 1e-3
    assert np.abs(found.near_share.ravel() - share).max() < 1e-3
    assert np.abs(found.later_rad.ravel() - later).max() < 1e-3
    same = freed_paths(seen, Tails(near, near, harmonics))
    assert_allclose(same.phasors, seen / near[:, None])


def test_a_net_that_covers_the_whole_view_is_not_found() -> None:
    """Every patch has two paths, so no patch is left to show the wall."""
    assert seen_in(np.ones(grid().ray.shape[1:], bool)) is None


@pytest.mark.parametrize(("light", "found", "other_light"), [(0.38, False, 0.2), (0.42, True, 5.0)])
def test_the_light_of_a_wall_is_the_median_of_its_patches(light: float, found: bool, other_light: float) -> None:
    """A few patches that are much darker or brighter, such as pictures on the wall, change nothing."""
    net, lit = rectangle(4, 6), np.ones(grid().ray.shape[1:])
    lit[:3] = other_light
    np.testing.assert_array_equal(found_by(net, light=np.where(net, light, lit)), net & found)
