"""A contract for the solver of every room: it fits all pixels that it is asked for, and says which pixels it fitted."""

from importlib import import_module

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.response.table import response_block
from cadtof_cli.resolver.settings import ResolverSettings
from tests.support.mixtures import Mixture

TRIANGLE = CaptureMetadata(modulation=Modulation(waveform="triangle"))

LIGHT = Mixture((1.0, 0.4), (5.0, 14.0))


@pytest.mark.parametrize("asked_count", [0, 3, 20, 40])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("room", ["two_path", "likelihood", "paper", "response"])
def test_a_solver_fits_all_pixels_that_it_is_asked_for_and_says_which_it_fitted(
    room: str, count: int, asked_count: int
) -> None:
    """The solver returns the places of the fitted pixels in a block of forty, in rising order.

    It may fit more pixels than it was asked for. Every pixel has the same answer when it is fitted alone.
    """
    phasors = LIGHT.phasors((1, 2), n_av=1e6, size=40, rng=np.random.default_rng(3))
    model = response_block(ideal_response(TRIANGLE), None) if room == "response" else None
    block = None if model is None else model.block(slice(None))
    solver = import_module(f"cadtof_cli.resolver.{room}.solver").solver
    noise = noise_model(TRIANGLE if model else CaptureMetadata(), integration_length=1e6, quantised=False)

    def fit(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wanted = np.isin(np.arange(40), places)
        with np.errstate(all="ignore"):
            start = solver(phasors, noise=noise, settings=ResolverSettings(), response=block, first=0)
            chosen, found = start.fit(count, wanted, limit=None)
        fitted = np.arange(40)[chosen]
        assert fitted.shape == found.chi_squared.shape == found.paths.amplitude.shape[1:]
        assert set(places) <= set(fitted)
        assert (np.diff(fitted) > 0).all()
        return fitted, found.paths.phase_rad

    places = np.sort(np.random.default_rng(4).permutation(40)[:asked_count])
    fitted, phases = fit(places)
    for place in places[:2]:
        alone, phase = fit(np.array([place]))
        np.testing.assert_array_equal(phase[:, alone == place], phases[:, fitted == place])
