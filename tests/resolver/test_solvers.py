"""A contract for the solver of every room: it fits all pixels that it is asked for, and says which pixels it fitted."""

import itertools
import re
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.phasors.response import ideal_response
from cadtof_cli.resolver.response.table import response_block
from cadtof_cli.resolver.settings import SOLVERS, ResolverSettings
from tests.support.mixtures import Mixture

TRIANGLE = CaptureMetadata(modulation=Modulation(waveform="triangle"))

LIGHT = Mixture((1.0, 0.4), (5.0, 14.0))

ROOT = Path(__file__).parents[2]
RESOLVER = ROOT / "cadtof_cli" / "resolver"

MODULES = [
    ".".join(path.relative_to(RESOLVER).with_suffix("").parts)
    for path in sorted(RESOLVER.rglob("*.py"))
    if re.search(r"^solver = ", path.read_text(encoding="utf-8"), re.MULTILINE)
]
"""The modules of the resolver that name the class of a solver."""


def test_every_solver_is_chosen_by_some_settings() -> None:
    chosen = set()
    for name, harmonics, sine in itertools.product(SOLVERS, ((1, 2), (1, 2, 3)), (True, False)):
        with suppress(SettingsError):
            chosen.add(ResolverSettings(solver=name).solver_module(harmonics, sine=sine))
    never = set(MODULES) - chosen
    assert not never, f"resolver/settings.py: solver_module never returns {', '.join(sorted(never))}"
    lost = chosen - set(MODULES)
    assert not lost, f"resolver/settings.py: solver_module returns {', '.join(sorted(lost))}, which names no `solver`"


@pytest.mark.parametrize("name", SOLVERS)
def test_the_page_about_solvers_says_when_to_take_it(name: str) -> None:
    page = (ROOT / "docs" / "solvers.md").read_text(encoding="utf-8")
    told = name == ResolverSettings().solver or f"`--solver {name}`" in page
    assert told, f"docs/solvers.md, Which solver when, needs a row for `--solver {name}`"


@pytest.mark.parametrize("asked_count", [0, 3, 20, 40])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("module", MODULES)
def test_a_solver_fits_all_pixels_that_it_is_asked_for_and_says_which_it_fitted(
    module: str, count: int, asked_count: int
) -> None:
    """The solver returns the places of the fitted pixels in a block of forty, in rising order.

    It may fit more pixels than it was asked for. Every pixel has the same answer when it is fitted alone.
    """
    phasors = LIGHT.phasors((1, 2), n_av=1e6, size=40, rng=np.random.default_rng(3))
    model = response_block(ideal_response(TRIANGLE), None) if module.startswith("response.") else None
    block = None if model is None else model.block(slice(None))
    solver = import_module(f"cadtof_cli.resolver.{module}").solver
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
