"""The means of a patch's light, compared with sums over its pixels."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse.grid import View, patch_grid
from cadtof_cli.resolver.diffuse.light import is_light, patch_light, patch_means, sample_places
from tests.support.diffuse_patches import traits_of

HARMONICS = (1, 2, 4)


def test_ratios_do_not_depend_on_the_direct_phase_and_are_weighted_by_power() -> None:
    """For phasors A·e^(ihφ)·H_h, the ratio q_h is H_h/|H_1|·exp(−ih·arg H_1) for any A and φ of the pixels."""
    rng = np.random.default_rng(1)
    strength, phase = rng.uniform(0.1, 0.5, (9, 2, 3)), rng.uniform(-np.pi, np.pi, (9, 2, 3))
    light = {1: 0.9 * np.exp(0.3j), 2: 0.6 * np.exp(0.1j), 4: 0.3 * np.exp(-0.7j)}
    p = np.stack([strength * np.exp(1j * h * phase) * light[h] for h in HARMONICS])
    seen = rng.random((9, 2, 3)) < 0.8
    spoilt = np.where(seen, p, 1e200)
    found = patch_light(spoilt, seen, harmonics=HARMONICS)
    means = patch_means(found, np.ones_like(seen), traits_of(HARMONICS, 0.0))
    for row, h in zip(means.ratios, HARMONICS[1:], strict=True):
        expected = light[h] / abs(light[1]) * np.exp(-1j * h * np.angle(light[1]))
        assert_allclose(row, np.full((2, 3), expected), rtol=1e-6)
    power = np.where(seen, np.abs(p[0]) ** 2, 0.0)
    assert_allclose(found.phase_rad[seen], np.angle(p[0])[seen], rtol=1e-6, atol=3e-7)
    assert_allclose(means.pixels, seen.sum(0))
    assert_allclose(means.amplitude, np.sqrt(power.sum(0) / seen.sum(0)), rtol=1e-6)
    first = np.where(seen, np.abs(p[0]) * p[0], 0.0).sum(0)
    assert_allclose(means.phase_rad, np.angle(first), rtol=1e-5)


def test_pixels_are_weighted_by_their_power() -> None:
    first = np.array([0.1, 0.3, 0.2])
    second = first * np.array([0.5, 1.0 + 0.2j, -0.4j])
    light = patch_light(np.stack([first + 0j, second]), np.ones(3, bool), harmonics=(1, 2))
    chosen = np.array([True, True, False])
    means = patch_means(light, chosen, traits_of((1, 2), 0.0))
    assert_allclose(means.ratios, [(0.01 * 0.5 + 0.09 * (1.0 + 0.2j)) / 0.1], rtol=1e-6)
    assert_allclose((means.amplitude, means.pixels), (np.sqrt(0.05), 2.0), rtol=1e-6)


@pytest.mark.parametrize(("amplitude", "sigma"), [(0.25, 0.02), (0.25, 0.04), (0.6, 0.08), (0.1, 0.016)])
def test_noise_does_not_bias_ratios(amplitude: float, sigma: float) -> None:
    """The noise is that of a pixel with one path of amplitude A.

    Its variance across the phasor is smaller by the factor 1 − A, and the mean of both variances by the factor 1 − A².
    """
    rng = np.random.default_rng(3)
    across = sigma * np.sqrt(1.0 - amplitude)
    along = np.sqrt(2.0 * sigma**2 * (1.0 - amplitude**2) - across**2)
    count = 400_000
    first = amplitude + along * rng.standard_normal(count) + 1j * across * rng.standard_normal(count)
    light = patch_light(np.stack([first, *[np.full(count, amplitude)] * 2]), np.ones(count, bool), harmonics=(1, 2, 3))
    mean = partial(patch_means, light, np.ones(count, bool))
    biased = mean(traits_of((1, 2, 3), 0.0))
    assert (np.abs(biased.ratios) < 1.0 - 1.5 * (across / amplitude) ** 2).all()
    corrected = mean(traits_of((1, 2, 3), sigma**2)).ratios
    assert (
        np.abs(corrected - 1.0) < 0.05 * np.abs(biased.ratios - 1.0) + 15.0 * across / amplitude / np.sqrt(count)
    ).all()


@pytest.mark.parametrize("amplitude", [1.02, 1.3])
def test_amplitudes_above_1_get_no_correction_for_noise(amplitude: float) -> None:
    light = patch_light(np.full((3, 4), amplitude, complex), np.ones(4, bool), harmonics=(1, 2, 3))
    means = patch_means(light, np.ones(4, bool), traits_of((1, 2, 3), 0.01))
    assert_allclose(means.ratios, [1.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize("variance", [0.0, 1e-4])
def test_patches_without_pixels_have_no_amplitude_and_finite_ratios(variance: float) -> None:
    light = patch_light(np.full((2, 4), np.nan + 0j), np.zeros(4, bool), harmonics=(1, 2))
    means = patch_means(light, np.ones(4, bool), traits_of((1, 2), variance))
    assert (means.ratios.tolist(), float(means.amplitude), float(means.pixels)) == ([0.0], 0.0, 0.0)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [(1.49, 1.49j, True), (1.5, 0.1, False), (-1.5j, 0.1, False), (0.1, -1.5, False), (0.1, 1.5j, False)],
)
def test_light_has_real_and_imaginary_parts_below_one_and_a_half_at_every_harmonic(
    first: complex, second: complex, expected: bool
) -> None:
    assert bool(is_light(np.array([[first], [second]]))[0]) is expected


def test_light_may_have_a_second_harmonic_of_0_but_no_fundamental_of_0() -> None:
    assert is_light(np.array([[0.1, 0.0], [0.0, 0.1]], complex)).tolist() == [True, False]


@pytest.mark.parametrize("size", [(48, 64), (50, 70), (240, 320)])
def test_places_of_samples_are_their_indices_in_the_frame(size: tuple[int, int]) -> None:
    grid = patch_grid(*size, View(100.0, (30.5, 17.25)))
    image = np.random.default_rng(2).uniform(1.0, 2.0, size)
    places, samples = sample_places(grid), grid.samples(image)
    assert_allclose(np.where(places < 0, 0.0, image.ravel()[places]), samples, rtol=0.0)
    assert ((places == -1) == (samples == 0.0)).all()
