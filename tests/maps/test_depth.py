"""Paths become metres and volts: a turn of the phase is twice the unambiguous range there and back."""

import numpy as np
import pytest

from cadtof_cli.maps.depth import DepthScale, write_paths
from cadtof_cli.maps.layers import DepthMaps, LayerChoice, empty_maps, layer_unit
from cadtof_cli.resolver.paths import Path, ResolvedPaths
from tests.support.mixtures import F

METRES, VOLTS = 0.299792458 * 40.0 / (4 * np.pi), 0.2746
SCALE = DepthScale(METRES, VOLTS)


def path(phase_rad: F, *, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    return Path(rng.uniform(0.1, 0.4, phase_rad.size), phase_rad, rng.uniform(1e-3, 1e-2, phase_rad.size))


def resolved(count: int = 6, *, others: int = 0, chi_squared: bool = False) -> ResolvedPaths:
    rng = np.random.default_rng(9)
    one, two, *more = (path(rng.uniform(0.5, 6.0, count), seed=seed) for seed in range(2 + others))
    return ResolvedPaths(
        one,
        two,
        rng.uniform(0.1, 0.5, count),
        np.arange(1, count + 1, dtype=np.uint32),
        tuple(more),
        rng.uniform(0, 9, count) if chi_squared else None,
    )


def blank(layers: LayerChoice | None = None) -> DepthMaps:
    maps = empty_maps(3, 4, layers=layers or LayerChoice())
    maps.pages[:] = -1.0
    maps.status[:] = 99
    return maps


def test_depth_amplitude_and_sigma_in_metres_and_volts_from_a_pixel_on() -> None:
    paths, maps = resolved(), blank()
    write_paths(paths, scale=SCALE, maps=maps, start=5)
    for name, one in (("direct", paths.direct), ("mpi", paths.mpi)):
        for what, values in (
            ("depth", one.phase_rad * METRES),
            ("amplitude", one.amplitude * VOLTS),
            ("sigma", one.sigma_rad * METRES),
        ):
            layer = maps.layer(f"{name}.{what}").ravel()
            np.testing.assert_allclose(layer[5:11], values, rtol=1e-7)
            assert (np.delete(layer, range(5, 11)) == -1.0).all()
    np.testing.assert_allclose(maps.layer("confidence").ravel()[5:11], paths.confidence * VOLTS, rtol=1e-7)
    assert maps.status.ravel().tolist() == [99] * 5 + [1, 2, 3, 4, 5, 6] + [99]


def test_what_the_lens_adds_is_taken_off_and_below_zero_is_the_end_of_the_range() -> None:
    offset = np.linspace(0.0, 0.11, 12)
    true = np.array([0.001, 1.0, 3.0, 4.0, 5.9, 5.94])
    recorded = (true + offset[5:11]) % 5.99584916
    paths = ResolvedPaths(
        path(recorded / METRES, seed=1),
        path((true + 6.2 + offset[5:11]) / METRES, seed=2),
        np.ones(6),
        np.zeros(6, np.uint32),
    )
    assert recorded[5] < 1.0
    maps = blank()
    write_paths(paths, scale=DepthScale(METRES, VOLTS, range_offset_m=offset), maps=maps, start=5)
    np.testing.assert_allclose(maps.layer("direct.depth").ravel()[5:11], true, rtol=1e-5)
    # an echo behind the range stays behind it
    np.testing.assert_allclose(maps.layer("mpi.depth").ravel()[5:11], true + 6.2, rtol=1e-5)


def test_planar_depth_shrinks_depths_and_sigmas_alone_after_the_lens() -> None:
    planar, offset = np.linspace(0.5, 1.0, 12), np.full(12, 0.1)
    paths, maps = resolved(others=1), blank(LayerChoice(paths=3))
    write_paths(paths, scale=DepthScale(METRES, VOLTS, planar, offset), maps=maps, start=2)
    factor = planar[2:8]
    for name, one in (("direct", paths.direct), ("mpi", paths.mpi), ("path3", paths.others[0])):
        depth = (one.phase_rad * METRES - 0.1) * factor
        np.testing.assert_allclose(maps.layer(f"{name}.depth").ravel()[2:8], depth, rtol=1e-6)
        np.testing.assert_allclose(maps.layer(f"{name}.sigma").ravel()[2:8], one.sigma_rad * METRES * factor, rtol=1e-6)
        np.testing.assert_allclose(maps.layer(f"{name}.amplitude").ravel()[2:8], one.amplitude * VOLTS, rtol=1e-6)


def test_further_layers_are_numbered_from_the_third_path_on() -> None:
    layers = LayerChoice(paths=4, chi_squared=True, effective_pixels=True)
    paths, maps = resolved(others=2, chi_squared=True), blank(layers)
    write_paths(paths, scale=SCALE, maps=maps, start=0, samples=np.arange(6.0) + 2.0)
    for number, one in ((3, paths.others[0]), (4, paths.others[1])):
        np.testing.assert_allclose(maps.layer(f"path{number}.depth").ravel()[:6], one.phase_rad * METRES, rtol=1e-6)
    assert paths.chi_squared is not None
    np.testing.assert_allclose(maps.layer("chi_squared").ravel()[:6], paths.chi_squared, rtol=1e-6)
    assert maps.layer("effective_pixels").ravel()[:7].tolist() == [2.0, 3.0, 4.0, 5.0, 6.0, 7.0, -1.0]
    write_paths(paths, scale=SCALE, maps=maps, start=0)
    assert (maps.layer("effective_pixels").ravel()[:6] == 1.0).all()


def test_a_layer_that_nobody_computed_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="the resolver gave no chi_squared"):
        write_paths(resolved(), scale=SCALE, maps=blank(LayerChoice(chi_squared=True)), start=0)


def test_names_units_and_pages_of_the_layers() -> None:
    always = [
        "direct.depth",
        "mpi.depth",
        "direct.amplitude",
        "mpi.amplitude",
        "direct.sigma",
        "mpi.sigma",
        "confidence",
    ]
    assert list(LayerChoice().names) == always
    more = LayerChoice(paths=3, chi_squared=True, effective_pixels=True)
    asked = ["path3.depth", "path3.amplitude", "path3.sigma", "chi_squared", "effective_pixels"]
    assert list(more.names) == [*always, *asked]
    units = ["m", "m", "V", "V", "m", "m", "V", "m", "V", "m", "", ""]
    assert list(more.units.values()) == units
    assert layer_unit("status") == ""
    maps = empty_maps(2, 5, layers=more)
    assert maps.pages.shape == (13, 2, 5)
    assert maps.values.shape == (12, 2, 5)
    assert np.shares_memory(maps.layer("mpi.depth"), maps.pages[1])
    assert maps.status.shape == (2, 5)
    assert (maps.pages.dtype.name, maps.status.dtype.name) == ("float32", "uint32")
