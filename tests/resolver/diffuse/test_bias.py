"""The bias of two harmonics: the numbers of a view with known surfaces, and the missed share that follows from them."""

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse.bias import (
    LEAST,
    MIDDLE,
    MOST,
    ViewNumbers,
    missed_share,
    remaining_sigma_rad,
    view_numbers,
)
from cadtof_cli.resolver.diffuse.planes import Surfaces
from tests.support.diffuse_frames import F

ROOM = np.array([-0.3, 0.0, 0.0, -2.0, 2.5, 4.4])


def surfaces(range_m: F, normal: F) -> Surfaces:
    """Return surfaces straight ahead at these ranges, (n,), with these normals, (3, n)."""
    one = np.ones(range_m.size)
    return Surfaces(range_m, normal, np.array([[0.0], [0.0], [1.0]]) * one, one, one)


def view(lag_rad: F, *, range_m: F | None = None, amplitude: F | None = None) -> ViewNumbers | None:
    """Return the numbers of a view of eleven patches; six face the camera, and five belong to the floor."""
    ranges = np.linspace(1.0, 2.0, 11) if range_m is None else range_m
    normal = np.zeros((3, 11))
    normal[2, :6], normal[1, 6:] = -1.0, -1.0
    return view_numbers(
        ROOM,
        surfaces(ranges, normal),
        np.exp(np.tile([0.0, 0.4], 6)[:11]) if amplitude is None else amplitude,
        lag_rad=lag_rad,
        seen_rad=0.25 * lag_rad,
        two_path_rad=0.6 * lag_rad,
    )


def test_the_numbers_of_a_view_are_those_of_its_surfaces_and_light() -> None:
    found = view(np.linspace(0.1, 0.3, 11), range_m=np.random.default_rng(1).permutation(np.linspace(1.0, 2.0, 11)))
    assert found is not None
    assert_allclose([found.near, found.deep], [np.log(1.1), np.log(1.9 / 1.1)])
    assert_allclose([found.excess, found.seen], [0.4, 0.25])
    assert_allclose(found.contrast, np.log(0.4 * np.sqrt(6 * 5) / 11))
    assert_allclose(found.facing, 6 / 11)
    assert_allclose([found.albedo, found.decay], [-0.3, 2.5])


def test_views_without_a_lag_or_with_equal_patches_have_no_numbers() -> None:
    assert view(np.zeros(11)) is None
    assert view(np.full(11, -0.1)) is None
    assert view(np.full(11, 0.2), amplitude=np.full(11, 0.3)) is None
    assert view(np.full(11, 0.2), amplitude=np.exp(0.04 * np.tile([-1.0, 1.0], 6)[:11])) is None


def test_the_middle_of_all_views_misses_the_documented_share() -> None:
    assert missed_share(MIDDLE, slowness=1.0) == pytest.approx(0.038)
    assert [MIDDLE.near, MIDDLE.deep] == pytest.approx(np.log([1.5, 2.0]), abs=1e-3)
    # amplitudes scatter by a quarter
    assert MIDDLE.contrast == pytest.approx(np.log(0.25), abs=1e-3)


@pytest.mark.parametrize(
    ("name", "middle", "slope", "least", "most"),
    [
        ("near", 0.405, 0.068, -0.6, 0.3),
        ("contrast", -1.386, -0.026, -1.0, 0.7),
        ("excess", 0.42, -0.195, -0.15, 0.15),
        ("deep", 0.693, 0.023, -0.5, 0.7),
        ("facing", 0.55, 0.105, -0.2, 0.4),
        ("albedo", -0.45, -0.045, -0.5, 0.5),
        ("seen", 0.0, -0.128, 0.0, 0.45),
        ("decay", 2.6, 0.024, -0.7, 0.9),
    ],
)
def test_the_missed_share_changes_in_proportion_up_to_its_limits(
    name: str, middle: float, slope: float, least: float, most: float
) -> None:
    """Less is missed in near rooms, with a high albedo or many seen surfaces; more if surfaces face one way."""

    def increase(change: float) -> float:
        return missed_share(replace(MIDDLE, **{name: middle + change}), slowness=1.0) - 0.038

    for change in (least, 0.3 * most, most):
        assert increase(change) == pytest.approx(slope * change, abs=1e-12)
    # below an excess of .27, less of the share counts
    assert name == "excess" or increase(-9.0) == pytest.approx(slope * least, abs=1e-12)
    assert increase(9.0) == pytest.approx(slope * most)


def test_nothing_is_missed_if_two_paths_give_the_lag_of_the_tail() -> None:
    """A plain corner is an example: nearly all of its MPI comes from the two surfaces that are seen."""
    least = missed_share(replace(MIDDLE, excess=0.27), slowness=1.0)
    assert least > 0.05
    assert missed_share(replace(MIDDLE, excess=0.27 / 3), slowness=1.0) == pytest.approx(least / 3)
    assert missed_share(replace(MIDDLE, excess=0.0), slowness=1.0) == 0.0
    assert missed_share(replace(MIDDLE, excess=-0.5), slowness=1.0) == 0.0


def test_the_remaining_sigma_grows_with_the_difference_of_tail_and_two_paths() -> None:
    """The standard deviation is .115 ns, 1.7 cm, if they differ by much, and half of it if by .067 ns, 1 cm."""
    two = np.linspace(0.1, 0.3, 7)
    per_ns = 2.0 * np.pi / 40.0
    assert remaining_sigma_rad(two, two, rad_per_ns=per_ns, slowness=1.0) == 0.0
    assert remaining_sigma_rad(two + 90.0, two, rad_per_ns=per_ns, slowness=1.0) == pytest.approx(
        0.115 * per_ns, rel=1e-2
    )
    for sign in (-1.0, 1.0):
        assert remaining_sigma_rad(two + sign * 0.067 * per_ns, two, rad_per_ns=per_ns, slowness=1.0) == pytest.approx(
            0.115 / 2 * per_ns
        )


def test_slow_modulation_misses_less_and_has_the_same_remaining_phase() -> None:
    """A period of 100 ns is 2.5 times as slow as the 40 ns at which the numbers were chosen.

    The remaining error is a phase, so as a length it is 2.5 times as large.
    """
    assert missed_share(MIDDLE, slowness=2.5) == pytest.approx(0.038 - 1.5 * 0.06)
    assert missed_share(replace(MIDDLE, excess=0.27 / 2), slowness=2.5) < 0.0
    two, per_ns = np.linspace(0.1, 0.3, 7), 2.0 * np.pi / 40.0
    for increase in (0.003, 0.01, 0.1):
        usual = remaining_sigma_rad(two + increase, two, rad_per_ns=per_ns, slowness=1.0)
        assert remaining_sigma_rad(two + increase, two, rad_per_ns=per_ns / 2.5, slowness=2.5) == pytest.approx(usual)


def test_no_view_changes_the_lag_by_a_half() -> None:
    ends = [[getattr(end, field.name) for end in (LEAST, MOST)] for field in fields(ViewNumbers)]
    shares = [
        missed_share(
            ViewNumbers(
                *(
                    getattr(MIDDLE, f.name) + pair[bit >> i & 1]
                    for i, (f, pair) in enumerate(zip(fields(MIDDLE), ends, strict=True))
                )
            ),
            slowness=1.0,
        )
        for bit in range(256)
    ]
    assert -0.5 < min(shares) < max(shares) < 0.5
