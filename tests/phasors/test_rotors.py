"""Moduli and directions of phasors; the phasor 0 has no direction."""

import numpy as np
import pytest

from cadtof_cli.phasors.rotors import unit_rotor
from tests.support.mixtures import C

HARD = np.array([0j, -0j, 1 + 0j, 1j, -1 + 0j, 3e-150 - 4e-150j, -4e150 + 3e150j])


@pytest.mark.parametrize("z", [HARD, np.array([0.28 - 0.96j])])
def test_a_rotor_has_length_1_and_the_direction_of_its_phasor(z: C) -> None:
    """The rotor of the phasor 0 is 1."""
    modulus, (cos, sin) = unit_rotor(z.real, z.imag)
    np.testing.assert_allclose(modulus, np.abs(z), rtol=1e-9)
    np.testing.assert_allclose(np.hypot(cos, sin), 1.0, rtol=1e-9)
    np.testing.assert_allclose(modulus * (cos + 1j * sin), z, rtol=1e-9)
    assert (cos[z == 0] == 1.0).all()
