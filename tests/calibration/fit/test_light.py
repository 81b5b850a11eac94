"""Light in frames that should be dark differs from offsets by the law that ties its harmonics, and by its level."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.calibration.fit.light import LightSeen, light_seen

HEIGHT, WIDTH = 60, 80
AMPLITUDE_V = 0.2746


def _seen(volts: NDArray[np.float64], harmonics: tuple[int, ...] = (1, 2)) -> LightSeen:
    return light_seen(volts, harmonics=harmonics, amplitude_v=AMPLITUDE_V)


def _light(amplitude_v: float, phase: NDArray[np.float64], harmonics: tuple[int, ...] = (1, 2)) -> NDArray[np.float64]:
    """Return voltages of light with this fundamental phase, (H, 2, Y, X); higher harmonics have gains and delays."""
    phasors = [amplitude_v * 0.8 ** (h - 1) * np.exp(1j * (h * phase + 0.3 * (h - 1))) for h in harmonics]
    return np.stack([[one.real, one.imag] for one in phasors])


def _phases() -> NDArray[np.float64]:
    """Return the phases of a slanted wall; they vary by 2 rad over the array."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] / HEIGHT
    return np.asarray(1.0 + 1.3 * x**2 - 0.4 * y)


@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 3), (1, 3)])
def test_light_follows_its_law_and_offsets_do_not(harmonics: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    offsets = rng.uniform(-0.02, 0.02, (len(harmonics), 2, HEIGHT, WIDTH))
    dark = _seen(offsets, harmonics)
    assert not dark.is_lit
    assert dark.law < 0.2
    lit = _seen(offsets + _light(0.09, _phases(), harmonics), harmonics)
    assert lit.follows_law
    assert lit.law > 1.5


@pytest.mark.parametrize(
    "shape", [(2, 2, 1, WIDTH), (1, 2, 1, WIDTH), (2, 2, HEIGHT, 1), (1, 1, HEIGHT, WIDTH), (2, 2, 1, 1)]
)
@pytest.mark.parametrize("seed", range(6))
def test_patterns_of_offsets_do_not_count_as_light(shape: tuple[int, ...], seed: int) -> None:
    """The offsets are alike in whole columns, in whole rows, in all harmonics and channels, or in all pixels."""
    rng = np.random.default_rng([seed, *shape])
    pattern = rng.normal(scale=0.006, size=shape) + rng.normal(scale=2e-4, size=(2, 2, HEIGHT, WIDTH))
    assert not _seen(pattern).is_lit


def test_light_of_one_phase_is_recognised_by_its_level() -> None:
    """If the phase is the same everywhere, the law tells nothing.

    But a tenth of the modulation amplitude in every pixel is more than an offset can be.
    """
    even = np.full((HEIGHT, WIDTH), 2.0)
    noise = np.random.default_rng(1).normal(scale=2e-3, size=(2, 2, HEIGHT, WIDTH))
    seen = _seen(_light(0.09, even) + noise)
    assert seen.level == pytest.approx(0.8 * 0.09 / AMPLITUDE_V, rel=0.01)
    assert seen.is_lit
    assert not seen.follows_law
    assert not _seen(_light(0.02, even) + noise).is_lit


def test_hot_and_unsound_pixels_do_not_count() -> None:
    rng = np.random.default_rng(2)
    volts = rng.uniform(-0.002, 0.002, (2, 2, HEIGHT, WIDTH))
    volts[:, :, rng.random((HEIGHT, WIDTH)) < 0.02] += 0.25
    volts[:, :, :5] = np.nan
    assert _seen(volts).law < 0.5
    assert not _seen(volts).is_lit
    volts[:] = np.nan
    assert _seen(volts) == LightSeen(0.0, 0.0)


def test_a_scene_before_a_sky_without_light_is_found_among_the_outliers() -> None:
    """A fifth of the pixels is lit; hot, dead and equal pixels in their place are no light."""
    rng = np.random.default_rng(4)
    dark = rng.normal(0.0, 4e-4, (2, 2, HEIGHT, WIDTH))
    ground = np.arange(HEIGHT)[:, np.newaxis] >= 0.8 * HEIGHT
    seen = _seen(dark + np.where(ground, _light(0.05, _phases()), 0.0))
    assert seen.follows_law
    assert not _seen(np.where(ground, rng.normal(0.0, 0.05, dark.shape), dark)).is_lit
    # 0.1 and 0.2 V are no binary fractions: what rounding leaves is the same in every pixel
    assert not _seen(np.where(ground, -0.2, dark)).is_lit
    assert not _seen(np.where(rng.random((HEIGHT, WIDTH)) < 0.05, rng.choice([-0.2, 0.1], (2, 2, 1, 1)), dark)).is_lit


def test_with_one_harmonic_only_the_level_decides() -> None:
    assert _seen(_light(0.09, np.full((HEIGHT, WIDTH), 2.0), (1,)), (1,)).is_lit
    assert not _seen(_light(0.01, _phases(), (1,)), (1,)).is_lit


def test_the_level_is_the_length_of_the_shortest_common_phasor_of_the_harmonics() -> None:
    """The phasor consists of the medians of both channels; the level is its length over the modulation amplitude."""
    volts = np.random.default_rng(5).normal(scale=1e-4, size=(2, 2, HEIGHT, WIDTH))
    volts[0] += np.array([0.003, 0.004])[:, np.newaxis, np.newaxis]
    volts[1] += np.array([-0.012, 0.005])[:, np.newaxis, np.newaxis]
    assert _seen(volts).level == pytest.approx(0.005 / AMPLITUDE_V, rel=1e-3)
    assert _seen(volts[::-1]).level == pytest.approx(0.005 / AMPLITUDE_V, rel=1e-3)


@pytest.mark.parametrize(("law", "level", "lit"), [(1.0, 0.1, False), (1.01, 0.0, True), (0.0, 0.101, True)])
def test_light_is_recognised_by_its_law_or_by_its_level(law: float, level: float, lit: bool) -> None:
    seen = LightSeen(law, level)
    assert seen.is_lit is lit
    assert seen.follows_law is (law > 1.0)


@pytest.mark.parametrize(("pixels", "judged"), [(199, False), (200, True)])
def test_fewer_than_two_hundred_pixels_are_not_judged(pixels: int, judged: bool) -> None:
    even = _light(0.09, np.full((HEIGHT, WIDTH), 2.0)) + 1e-4 * np.random.default_rng(6).normal(
        size=(2, 2, HEIGHT, WIDTH)
    )
    even.reshape(2, 2, -1)[:, :, pixels:] = np.nan
    assert (_seen(even).level > 0.0) is judged


def test_light_that_offsets_of_pixels_hide_is_found_in_blocks() -> None:
    """The offsets of single pixels are a third of the light. The law predicts more of medians over 5 × 5 pixels."""
    offsets = np.random.default_rng(7).normal(scale=0.02, size=(2, 2, 120, 160))
    y, x = np.mgrid[:120, :160] / 120.0
    light = _light(0.06, np.asarray(1.0 + 1.6 * x**2 - 0.5 * y))
    assert _seen(offsets + light).law > 1.0
    assert _seen(offsets).law < 1.0


def test_a_fundamental_without_a_signal_predicts_nothing() -> None:
    volts = np.zeros((2, 2, HEIGHT, WIDTH))
    volts[1] = np.random.default_rng(8).normal(scale=0.01, size=(2, HEIGHT, WIDTH))
    seen = _seen(volts)
    assert (seen.law, seen.level) == (0.0, 0.0)
    assert not seen.is_lit


@pytest.mark.parametrize(("height", "chance"), [(60, 0.1), (240, 0.05)])
def test_the_law_predicts_light_without_offsets_completely(height: int, chance: float) -> None:
    """Chance reaches a share of 1/20, or of 6 over the number of rows if that is larger."""
    y, x = np.mgrid[:height, : height * 4 // 3] / height
    seen = _seen(_light(0.09, np.asarray(1.0 + 1.3 * x**2 - 0.4 * y), (1, 2, 3)), (1, 2, 3))
    assert seen.law == pytest.approx(1.0 / chance, rel=1e-6)


@pytest.mark.parametrize(("deviations", "judged"), [(5.8, True), (6.2, False), (-5.8, True), (-6.2, False)])
def test_pixels_within_six_deviations_of_the_median_count(deviations: float, judged: bool) -> None:
    """Of 200 pixels, half are 1 mV above 20 mV and half 1 mV below.

    If the one pixel that is farther off is left out, the other 199 are too few.
    """
    volts = np.full((2, 2, HEIGHT, WIDTH), np.nan)
    flat = volts.reshape(2, 2, -1)
    flat[:, :, :200] = 0.02 + 0.001 * np.where(np.arange(200) % 2, 1.0, -1.0)
    flat[1, 0, 7 if deviations > 0 else 6] = 0.02 + deviations * 0.001 / 0.6744897501960817
    assert (_seen(volts).level > 0.0) is judged


@pytest.mark.parametrize(("height", "width"), [(35, 35), (34, 60)])
def test_fewer_than_fifty_blocks_or_six_rows_of_blocks_do_not_show_the_law(height: int, width: int) -> None:
    """Offsets of single pixels hide the light. 7 × 7 blocks of 5 × 5 pixels would show it, but these are only 49.

    34 × 60 pixels have 72 blocks, but in six rows, and chance explains all of what six rows show.
    """
    y, x = np.mgrid[:height, :width] / 35.0
    light = _light(0.05, np.asarray(1.0 + 1.6 * x**2 - 0.5 * y))
    offsets = np.random.default_rng(9).normal(scale=0.05, size=(2, 2, height, width))
    blocks = height // 5 * (width // 5)
    assert (blocks >= 50) is (width == 60)
    assert _seen(light + offsets).follows_law is False


def test_if_most_pixels_hold_one_value_outliers_are_judged_by_single_precision() -> None:
    """Of 210 pixels, 150 hold the same value, so that their spread is 0.

    The other pixels are outliers if they differ by more than six times the epsilon of float32, 2⁻²³.
    """
    volts = np.full((2, 2, HEIGHT, WIDTH), np.nan)
    flat = volts.reshape(2, 2, -1)
    flat[:, :, :210] = 0.02
    flat[0, 0, 150:210] += 5.5 * 2.0**-23
    assert _seen(volts).level > 0.0
    flat[0, 0, 150:210] += 1.0 * 2.0**-23
    assert _seen(volts).level == 0.0


@pytest.mark.parametrize(("other", "follows"), [(1.0, True), (0.8, True), (0.2, False), (-1.0, False)])
@pytest.mark.parametrize("axis", ["left and right", "above and below"])
def test_the_law_must_hold_with_one_factor_in_both_halves_of_the_array(axis: str, other: float, follows: bool) -> None:
    """If harmonics are tied as those of light, but by another factor in each half, the cause is not light."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    volts = _light(0.09, _phases())
    volts[1] *= np.where(x < WIDTH // 2 if axis == "left and right" else y < HEIGHT // 2, 1.0, other)
    assert _seen(volts).follows_law is follows


@pytest.mark.parametrize(("pixels", "found"), [(11, False), (12, True)])
def test_blocks_with_half_of_their_pixels_count(pixels: int, found: bool) -> None:
    """Noise of single pixels hides the light, so that only blocks show it. `pixels` of each 5 × 5 block are sound."""
    rng = np.random.default_rng(10)
    y, x = np.mgrid[:120, :160] / 120.0
    volts = rng.normal(scale=0.018, size=(2, 2, 120, 160)) + _light(0.06, np.asarray(1.0 + 1.6 * x**2 - 0.5 * y))
    order = rng.random((24, 32, 25)).argsort(axis=2).reshape(24, 32, 5, 5).transpose(0, 2, 1, 3).reshape(120, 160)
    volts[..., order >= pixels] = np.nan
    assert _seen(volts).follows_law is found


@pytest.mark.parametrize("share", [0.1, 0.6])
def test_pixels_of_nan_do_not_change_the_level(share: float) -> None:
    """The light has one phase, with a larger imaginary part. Even most pixels may be NaN."""
    rng = np.random.default_rng(12)
    volts = _light(0.09, np.full((HEIGHT, WIDTH), 1.2)) + rng.normal(scale=2e-3, size=(2, 2, HEIGHT, WIDTH))
    volts[..., rng.random((HEIGHT, WIDTH)) < share] = np.nan
    assert _seen(volts).level == pytest.approx(0.8 * 0.09 / AMPLITUDE_V, rel=0.01)
