"""The registry of layers: their names, their order, their units and their values."""

import re
from inspect import signature
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.depth import DepthScale, write_block
from cadtof_cli.maps.layers import error_unit, layer_unit, wanted_layers
from cadtof_cli.resolver.paths import Paths, ResolvedPaths
from tests.support.captures import MAP_LAYERS

ALWAYS = MAP_LAYERS[:-1]

EVERY = wanted_layers(
    paths=3, **{name: True for name, one in signature(wanted_layers).parameters.items() if one.default is False}
)
"""The layers of maps that have all kinds of layers."""


def test_layers_come_in_the_documented_order() -> None:
    found = tuple(layer.name for layer in wanted_layers())
    assert found == ALWAYS, (
        "maps/layers.py: a layer that all maps have is named in MAP_LAYERS of tests/support/captures.py, too"
    )
    most = [layer.name for layer in wanted_layers(paths=4, searched=True, averaged=True)]
    later = [f"path{number}.{quantity}" for number in (3, 4) for quantity in ("depth", "amplitude", "sigma")]
    assert most == [*ALWAYS, *later, "chi_squared", "effective_pixels"]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("direct.depth", "m"),
        ("path3.sigma", "m"),
        ("mpi.amplitude", "V"),
        ("confidence", "V"),
        ("direct.sigma", "m"),
        ("chi_squared", ""),
        ("effective_pixels", ""),
        ("x", ""),
    ],
)
def test_the_unit_of_a_layer_follows_from_its_name(name: str, unit: str) -> None:
    assert layer_unit(name) == unit
    assert {layer.name: layer.unit for layer in wanted_layers(paths=3, searched=True)}.get(name, unit) == unit


def test_differences_in_metres_are_shown_in_centimetres() -> None:
    assert [error_unit(unit) for unit in ("m", "V", "")] == [(100.0, "cm"), (1.0, "V"), (1.0, "")]


def test_every_layer_has_the_unit_that_follows_from_its_name() -> None:
    lost = [layer.name for layer in EVERY if layer_unit(layer.name) != layer.unit]
    assert not lost, f"maps/layers.py: layer_unit does not know {', '.join(lost)}"


def test_the_readme_says_what_each_layer_means() -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    part = readme.partition("## What comes out")[2].partition("\n- ")[0]
    named = set(re.findall(r"`([\w.]+)`", part))
    unnamed = {layer.name for layer in EVERY if not layer.name.startswith("path3.")} - named
    assert not unnamed, f"README.md, What comes out, does not say what {', '.join(sorted(unnamed))} means"


def test_values_are_in_metres_and_volts_and_a_range_below_0_comes_from_the_end() -> None:
    phases = np.array([[1.0, 0.05], [2.0, np.nan], [3.0, np.nan]])
    paths = Paths(phases / 10.0, phases, phases / 100.0)
    resolved = ResolvedPaths(paths, np.array([0.5, 0.25]), np.array([8, 16], np.uint32), np.array([4.0, 5.0]))
    layers = wanted_layers(paths=3, searched=True, averaged=True)
    scale = DepthScale(2.0, 0.5, np.array([9.0, 0.5, 1.0]), np.array([9.0, 0.0, 0.2]))
    maps = DepthMaps.empty(tuple(layer.name for layer in layers), (1, 3))
    maps.values[:] = -1.0
    write_block(maps, slice(1, 3), scale.source(resolved, slice(1, 3), samples=np.array([1.0, 7.0])), layers=layers)
    found = {name: maps.layer(name)[0].tolist() for name in maps.names}
    wrapped = (0.05 - 0.1 + 2 * np.pi) * 2.0
    assert found["direct.depth"] == pytest.approx([-1.0, 1.0, wrapped], abs=1e-6)
    assert found["path3.depth"] == pytest.approx([-1.0, 3.0, np.nan], nan_ok=True)
    assert found["mpi.amplitude"] == pytest.approx([-1.0, 0.1, np.nan], nan_ok=True)
    assert found["direct.sigma"] == pytest.approx([-1.0, 0.01, 0.001])
    assert found["confidence"] == pytest.approx([-1.0, 0.25, 0.125])
    assert found["chi_squared"] == [-1.0, 4.0, 5.0]
    assert found["effective_pixels"] == [-1.0, 1.0, 7.0]
    assert maps.status[0, 1:].tolist() == [8, 16]
