"""MPI that varies over the view as the room foretells is that of a tail; MPI that has an order of its own is not."""

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.diffuse.variation import varies_like_the_tail

COUNT = 4000
ALL = np.ones(COUNT, np.bool_)
NOTHING = np.zeros((2, 2, COUNT))
CLEAR = np.full(COUNT, 7.1)


def correlated(*correlations: float, seed: int = 0) -> tuple[Float, Float]:
    """Return data and what is foretold, (data, n) each, normal and with these correlations."""
    foretold, rest = np.random.default_rng(seed).normal(size=(2, len(correlations), COUNT))
    correlation = np.array(correlations)[:, np.newaxis]
    return correlation * foretold + np.sqrt(1.0 - correlation**2) * rest, foretold


@pytest.mark.parametrize(
    ("correlations", "expected"),
    [((0.9, 0.9), True), ((0.25, 0.25), True), ((0.16, 0.16), False), ((-0.9, 0.9), False), ((0.7, -0.2), True)],
)
def test_all_data_together_must_follow_what_is_foretold(correlations: tuple[float, ...], expected: bool) -> None:
    data, foretold = correlated(*correlations)
    assert varies_like_the_tail(data, foretold, NOTHING, NOTHING, CLEAR, ALL) is expected


def test_only_the_order_counts() -> None:
    """The tail may be stronger than foretold, and a few patches may be far off."""
    data, foretold = correlated(0.5, 0.5)
    data = np.exp(3.0 * data)
    data[:, :40] = 1e9
    for expected in (foretold, np.exp(3.0 * foretold)):
        assert varies_like_the_tail(data, expected, NOTHING, NOTHING, CLEAR, ALL)
        assert not varies_like_the_tail(data, -expected, NOTHING, NOTHING, CLEAR, ALL)


@pytest.mark.parametrize(("noise", "model_error"), [(1.0, 0.0), (0.0, 2.0), (0.5, 1.0)])
def test_errors_of_the_data_do_not_lower_the_correlation(noise: float, model_error: float) -> None:
    """Half of the variance is due to errors: noise, or half of the variance of the model's error."""
    true, foretold = correlated(0.25, 0.25)
    data = true + np.random.default_rng(1).normal(size=true.shape)
    assert not varies_like_the_tail(data, foretold, NOTHING, NOTHING, CLEAR, ALL)
    assert varies_like_the_tail(data, foretold, NOTHING + noise, NOTHING + model_error, CLEAR, ALL)


@pytest.mark.parametrize(("noise", "expected"), [(0.7, False), (0.8, True), (30.0, True)])
def test_data_that_are_mostly_errors_say_nothing(noise: float, expected: bool) -> None:
    data, foretold = correlated(0.0, 0.0)
    assert varies_like_the_tail(data, foretold, NOTHING + noise, NOTHING, CLEAR, ALL) is expected


def test_data_without_any_variation_say_nothing() -> None:
    _, foretold = correlated(0.0, 0.0)
    assert varies_like_the_tail(np.zeros_like(foretold), foretold, NOTHING, NOTHING, CLEAR, ALL)


def test_patches_that_are_left_out_do_not_count() -> None:
    data, foretold = correlated(0.9, 0.9)
    patches = np.arange(COUNT) % 2 == 0
    data[:, ~patches] = -10.0 * foretold[:, ~patches]
    assert varies_like_the_tail(data, foretold, NOTHING, NOTHING, CLEAR, patches)
    assert not varies_like_the_tail(data, foretold, NOTHING, NOTHING, CLEAR, ALL)


@pytest.mark.parametrize(("clear", "expected"), [(0.91, False), (0.89, True)])
def test_light_near_the_noise_says_nothing(clear: float, expected: bool) -> None:
    data, foretold = correlated(0.0, 0.0)
    snr = np.where(np.arange(COUNT) < clear * COUNT, 7.1, 6.9)
    assert varies_like_the_tail(data, foretold, NOTHING, NOTHING, snr, ALL) is expected


def test_inputs_are_not_changed() -> None:
    data, foretold = correlated(0.3, 0.1)
    given = data.copy(), foretold.copy(), NOTHING + 0.1, NOTHING + 0.2
    kept = [one.copy() for one in given]
    varies_like_the_tail(*given, CLEAR, ALL)
    for before, after in zip(kept, given, strict=True):
        np.testing.assert_array_equal(before, after)
