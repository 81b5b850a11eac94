"""What one path leaves over of phasors, by closed forms."""

import numpy as np
import pytest

from cadtof_cli.doubts.pixels import left_by_one_path, scatters, squared_misfits, turned_by_phase

HARMONICS = [(1, 2), (1, 2, 3), (1, 3)]


@pytest.mark.parametrize("harmonics", HARMONICS)
def test_noise_is_left_over_as_large_as_it_was_and_surfaces_are_not(harmonics: tuple[int, ...]) -> None:
    rng, h = np.random.default_rng(1), np.array(harmonics)[:, np.newaxis]
    phases = h * rng.uniform(-3.0, 3.0, 20000)
    surfaces = (rng.uniform(0.2, 1.0, 20000) * np.exp(1j * phases)).astype(np.complex128)
    assert np.abs(left_by_one_path(surfaces, harmonics)).max() < 1e-12
    noise = (1e-3 * (rng.normal(size=phases.shape) + 1j * rng.normal(size=phases.shape))).astype(np.complex128)
    left = left_by_one_path(surfaces + noise, harmonics)
    assert np.sqrt(np.mean(left.real**2)) == pytest.approx(1e-3, rel=0.02)
    assert np.sqrt(np.mean(left.imag**2)) == pytest.approx(1e-3, rel=0.02)


@pytest.mark.parametrize("harmonics", HARMONICS)
def test_phasors_are_turned_back_by_the_phase_that_fits_all_harmonics(harmonics: tuple[int, ...]) -> None:
    """Least squares: the phase lies between those of the harmonics, nearer to that of the higher ones."""
    h = np.array(harmonics, np.float64)[:, np.newaxis]
    phase = np.linspace(-3.0, 3.0, 50)
    turned, back = turned_by_phase(np.exp(1j * h * phase), h)
    assert np.abs(turned - 1.0).max() < 1e-9
    assert np.abs(back - np.exp(-1j * h * phase)).max() < 1e-9
    moved = np.exp(1j * h * phase)
    moved[-1] *= np.exp(0.05j)
    _, back = turned_by_phase(moved, h)
    found = np.angle(np.conj(back[0]) * np.exp(-1j * phase))
    assert found == pytest.approx(0.05 * h[-1, 0] / (h * h).sum(), rel=0.01)


def test_what_does_not_fit_one_path_is_the_misfit() -> None:
    """Amplitudes of 1 and 1.1 leave ±.05; phases of 0 and .03 leave what no delay, (1, 2), explains."""
    h = np.array([[1.0], [2.0]])
    assert squared_misfits(np.array([[1.0], [1.1]], complex), h) == pytest.approx(2.0 * 0.05**2, rel=1e-6)
    turned = np.array([[1.0], [np.exp(0.03j)]])
    assert squared_misfits(turned, h) == pytest.approx(0.03**2 / 5.0, rel=0.01)


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.float32])
def test_values_scatter_if_any_plane_does(dtype: type[np.generic]) -> None:
    still, rising = np.full(100, 3), np.arange(100)
    whole = np.issubdtype(dtype, np.integer)
    assert not scatters(np.stack([still, still]).astype(dtype), 0.5)
    assert scatters(np.stack([still, rising]).astype(dtype), 0.5)
    assert scatters(np.stack([rising, still]).astype(dtype), 1.0) != whole
