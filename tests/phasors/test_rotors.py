"""Moduli and directions of phasors; the phasor 0 has no direction."""

import numpy as np
import pytest

from cadtof_cli.phasors.rotors import powers, unit_rotor
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


def test_powers_are_those_of_a_complex_number() -> None:
    z = np.exp(1j * np.linspace(0.0, 6.0, 50)) * np.linspace(0.5, 1.5, 50)
    for exponents in ((1, 2, 3, 4, 5, 6), (1, 3, 7), (2,)):
        for h, (re, im) in zip(exponents, powers((z.real, z.imag), exponents), strict=True):
            np.testing.assert_allclose(re + 1j * im, z**h, rtol=1e-13)
