"""Pixels that see through a net are freed of the tail; all other pixels keep their phasors."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.resolver.diffuse.net_pixels import freed_pixels
from cadtof_cli.resolver.diffuse.records import DiffuseModel, Nets, Tails
from tests.support.diffuse_answers import model_of
from tests.support.diffuse_frames import M_PER_RAD, OMEGA, Tail, phasors_of, wall_range

HARMONICS = (1, 2, 3)

TAIL = np.array([1.0 + Tail(0.2, 3.0, 9.0).phasor(h) for h in HARMONICS])

SIZE = (48, 64)

NET_M = 2.0


@cache
def model() -> DiffuseModel:
    """Return the model of a wall with a net 2 m away in patches of rows 3 and 4 and columns 5 to 8, of 4 × 4 pixels."""
    mpi = {h: complex(t - 1.0) for h, t in zip(HARMONICS, TAIL, strict=True)}
    found = model_of(phasors_of(wall_range(*SIZE, 60.0, 3.5), mpi, harmonics=HARMONICS), harmonics=HARMONICS)
    assert isinstance(found, DiffuseModel)
    near_m = np.full(found.separate.shape, np.nan)
    near_m[3:5, 5:9] = NET_M
    nets = Nets(np.isfinite(near_m), near_m, Tails(TAIL, TAIL, HARMONICS), 0.003)
    return replace(found, nets=nets)


NET = np.zeros(SIZE, bool)
NET[12:20, 20:36] = True


def two_paths(share: Float | float, near_m: Float | float = NET_M, delay_ns: float = 8.0) -> Complex:
    """Return the phasors, (H, n), of two paths with a tail; `share` is the share of the nearer path."""
    ones, begin = np.ones(NET.size), np.asarray(near_m) / M_PER_RAD
    return np.stack(
        [
            0.3 * t * ones * np.exp(1j * h * begin) * (share + (1.0 - share) * np.exp(1j * h * OMEGA * delay_ns))
            for h, t in zip(HARMONICS, TAIL, strict=True)
        ]
    )


def test_only_pixels_of_a_net_are_freed_of_the_tail() -> None:
    seen = two_paths(0.5)
    free, nets = freed_pixels(seen, model(), first=0)
    assert nets is not None
    np.testing.assert_array_equal(nets.where, NET.ravel())
    assert_allclose(free[:, NET.ravel()], (seen / TAIL[:, np.newaxis])[:, NET.ravel()])
    np.testing.assert_array_equal(free[:, ~NET.ravel()], seen[:, ~NET.ravel()])
    assert_allclose(nets.size, np.where(NET.ravel(), abs(TAIL[0]), 1.0))
    assert_allclose(nets.variance(0.01), np.where(NET.ravel(), 0.003, 0.01))


@pytest.mark.parametrize("part", [slice(13 * 64 + 30, 15 * 64 + 25), slice(0, 64), slice(19 * 64, 48 * 64)])
def test_a_part_of_the_pixels_is_freed_as_in_the_whole_frame(part: slice) -> None:
    seen = two_paths(0.4)
    whole, _ = freed_pixels(seen, model(), first=0)
    found, nets = freed_pixels(seen[:, part], model(), first=part.start)
    np.testing.assert_array_equal(found, whole[:, part])
    assert nets is not None
    np.testing.assert_array_equal(nets.where, NET.ravel()[part])


@pytest.mark.parametrize(("share", "freed"), [(0.09, False), (0.11, True), (0.89, True), (0.91, False)])
def test_both_paths_have_at_least_a_tenth_of_the_light_of_a_pixel(share: float, freed: bool) -> None:
    _, nets = freed_pixels(two_paths(share), model(), first=0)
    assert nets is not None
    np.testing.assert_array_equal(nets.where, NET.ravel() & freed)


@pytest.mark.parametrize(("near_m", "freed"), [(1.81, True), (1.79, False), (2.19, True), (2.21, False)])
def test_the_nearer_path_is_within_a_tenth_of_the_range_of_the_net(near_m: float, freed: bool) -> None:
    seen = two_paths(0.5, near_m)
    free, nets = freed_pixels(seen, model(), first=0)
    assert nets is not None
    np.testing.assert_array_equal(nets.where, NET.ravel() & freed)
    assert freed or (free == seen).all()


def test_without_a_net_the_phasors_are_returned_unchanged() -> None:
    seen = two_paths(0.5)
    free, nets = freed_pixels(seen, replace(model(), nets=None), first=0)
    assert free is seen
    assert nets is None
