"""Records of the prediction: parts of a model, ranges from phases, and the pixels of separate patches."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse.choice import DiffuseChoice, Reason
from cadtof_cli.resolver.diffuse.records import DiffuseModel, DiffusePixels
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings, range_from_phase
from tests.support.diffuse_answers import model_of
from tests.support.diffuse_frames import C_M_PER_NS, Tail, phasors_of, wall_range


def settings(period_ns: float = 40.0) -> DiffuseSettings:
    return DiffuseSettings(period_ns=period_ns, harmonics=(1, 2))


def test_phases_become_metres_by_the_period() -> None:
    """A full turn of the fundamental is c·T1/2 of range, and c·T1 of the way that the light goes."""
    chosen = settings(period_ns=50.0)
    assert chosen.m_per_rad * 2 * np.pi == pytest.approx(C_M_PER_NS * 25.0)
    assert 2 * np.pi / chosen.rad_per_m == pytest.approx(C_M_PER_NS * 50.0)
    assert 2 * np.pi / chosen.rad_per_ns == pytest.approx(50.0)


@pytest.mark.parametrize(("period_ns", "slowness"), [(20.0, 1.0), (40.0, 1.0), (60.0, 1.5), (100.0, 2.5)])
def test_slowness_is_1_up_to_40_ns_and_grows_with_the_period_above(period_ns: float, slowness: float) -> None:
    assert settings(period_ns=period_ns).slowness == slowness


def test_ranges_are_those_of_the_phase_within_a_turn() -> None:
    phase = np.linspace(-7.0, 13.0, 41)
    found = range_from_phase(phase, settings())
    turn_m = C_M_PER_NS * 20.0
    assert ((found >= 0.0) & (found < turn_m)).all()
    turns = (found - phase * turn_m / (2 * np.pi)) / turn_m
    assert_allclose(turns, np.rint(turns), atol=1e-9)


def test_direct_light_and_mpi_light_are_rows_of_the_answers() -> None:
    rows = np.arange(7.0, dtype=np.float32)[:, None] + np.zeros(6, np.float32)
    pixels = DiffusePixels(np.ones(6, bool), *rows)
    for number, values in enumerate((*pixels.direct, *pixels.mpi, pixels.chi_squared)):
        assert_allclose(values, np.full(6, number))
    amplitude, phase, sigma = pixels.direct
    assert amplitude is pixels.direct_amplitude
    assert phase is pixels.direct_phase_rad
    assert sigma is pixels.direct_sigma_rad
    assert all(
        a is b
        for a, b in zip(pixels.mpi, (pixels.mpi_amplitude, pixels.mpi_phase_rad, pixels.mpi_sigma_rad), strict=True)
    )


@pytest.mark.parametrize("reason", ["no MPI to be seen", "separate paths", "no tail fits", "few patches with light"])
def test_only_a_frame_with_a_tail_gets_the_diffuse_model(reason: Reason) -> None:
    assert DiffuseChoice("tail", 70, 0.0).taken == "diffuse"
    assert DiffuseChoice(reason, 70, 0.0).taken == "discrete"


def test_separate_pixels_and_offsets_of_a_part_are_those_of_its_pixels() -> None:
    tail = {h: Tail().phasor(h) for h in (1, 2)}
    offset = np.arange(48.0 * 64.0).reshape(48, 64) * 1e-5
    found = model_of(phasors_of(wall_range(), tail), range_offset_m=offset)
    assert isinstance(found, DiffuseModel)
    found.separate[:] = False
    found.separate[2, 3] = True
    part = slice(9 * 64 + 10, 13 * 64 + 20)
    expected = np.zeros((48, 64), bool)
    expected[8:12, 12:16] = True
    assert found.is_separate(part).tolist() == expected.ravel()[part].tolist()
    assert_allclose(found.range_offset(part), offset.ravel()[part])
    without_offset = model_of(phasors_of(wall_range(), tail))
    assert isinstance(without_offset, DiffuseModel)
    assert without_offset.range_offset(part) == 0.0
