"""Nets in rooms: pixels get two paths only if the farther path ends on a wall that neighbouring patches see."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Optics, Pixel, Pulse
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.pipeline.frame import ResolvedFrame, resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.diffuse.nets import freed_paths
from cadtof_cli.resolver.diffuse.records import Tails
from cadtof_cli.resolver.settings import MpiModel, ResolverSettings
from tests.support.blocks import blocks_of
from tests.support.diffuse_answers import B
from tests.support.diffuse_frames import M_PER_RAD, OMEGA, F, Tail, Z, hung_before, phasors_of, wall_range

HEIGHT, WIDTH, FOCAL = 96, 128, 120.0

TWO_PATHS, DIFFUSE = 16, 2048

WALL = wall_range(HEIGHT, WIDTH, FOCAL, 3.2, (0.2, 0.0))

FWHM_NS = 1.7

TAIL = Tail(0.25, 3.0, 9.0)

UNEVEN: F = (WALL / WALL.mean()) ** 2 + 0.2 * np.sin(np.arange(WIDTH) / 9.0) * np.cos(np.arange(HEIGHT) / 11.0)[:, None]
"""Factor on the tail over the view: there is more of it where there is little direct light, and it is not even."""


def net_before_wall(delay_ns: float, share: float, *, harmonics: int = 2) -> tuple[Z, F, B]:
    """Return phasors of a wall with a tail and a net before its middle; the ranges; and where the net is."""
    numbers = tuple(range(1, harmonics + 1))
    frame = phasors_of(WALL, {h: TAIL.phasor(h) for h in numbers}, harmonics=numbers)
    net = WALL - delay_ns * OMEGA * M_PER_RAD
    phasors, covered = hung_before(frame, net, {h: 0.7 * TAIL.phasor(h) for h in numbers}, share=share)
    return phasors, np.where(covered, net, WALL), covered


def resolved(phasors: Z, model: MpiModel = "auto", *, triangle: bool = False) -> ResolvedFrame:
    """Return the maps of phasors as `cadtof resolve` makes them."""
    metadata = CaptureMetadata(
        modulation=Modulation(
            periods_ns=tuple(40.0 / h for h in range(1, len(phasors) + 1)),
            amplitude_v=1.0,
            waveform="triangle" if triangle else "sine",
        ),
        pixel=Pixel(integration_length=1e5),
        pulse=Pulse(fwhm_ns=FWHM_NS if triangle else 0.0),
        optics=Optics(focal_length_px=FOCAL),
    )
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(mpi_model=model)))
    return resolve_frame(np.stack([phasors.real, phasors.imag], axis=1), plan=plan)


def error_cm(found: ResolvedFrame, range_m: F) -> F:
    return np.asarray(100 * np.abs(found.maps.layer(DIRECT_DEPTH) - range_m))


@pytest.mark.parametrize("harmonics", [2, 3])
@pytest.mark.parametrize(("delay_ns", "share"), [(7.0, 0.6), (9.0, 0.5), (9.0, 0.6), (12.0, 0.65)])
def test_a_net_before_a_wall_is_resolved_as_two_paths(delay_ns: float, share: float, harmonics: int) -> None:
    phasors, range_m, covered = net_before_wall(delay_ns, share, harmonics=harmonics)
    found, discrete = resolved(phasors), resolved(phasors, "discrete")
    assert found.mpi is not None
    assert found.mpi.taken == "diffuse"
    assert found.mpi.net_patches > 0
    error = error_cm(found, range_m)
    assert np.median(error[covered]) < 3.0
    assert np.median(error[covered]) < 0.8 * np.median(error_cm(discrete, range_m)[covered])
    assert np.median(error[~covered]) < 1.0
    assert ((found.maps.status & TWO_PATHS) > 0)[covered].mean() > 0.9
    assert ((found.maps.status & DIFFUSE) > 0)[~covered].mean() > 0.98
    assert (error <= 200 * found.maps.layer(DIRECT_SIGMA))[covered].mean() > 0.8
    behind = found.maps.layer("mpi.depth")[covered]
    assert np.median(np.abs(behind - WALL[covered])) < 0.1


def test_a_net_close_to_its_wall_is_not_found_but_has_larger_sigmas() -> None:
    """No tail fits this net. χ² is large in patches side by side, so their sigma grows."""
    phasors, range_m, covered = net_before_wall(5.0, 0.7)
    found = resolved(phasors)
    assert found.mpi is not None
    assert found.mpi.net_patches == 0
    error, sigma_cm = error_cm(found, range_m), 100 * found.maps.layer(DIRECT_SIGMA)
    assert np.median(error[covered]) > 4.0
    assert (error <= 2 * sigma_cm)[covered].mean() > 0.9
    assert np.median(sigma_cm[~covered]) < 4.0


def recorded_by_a_triangle(phasors: Z, *, harmonics: int) -> Z:
    """Return what triangle waves of some periods record of light with the phasors m_1, m_2, ….

    This is (8/π²)·Σ m_kh/k² over k = 1, −3, 5, −7.
    """

    def term(k: int, h: int) -> Z:
        left = np.exp(-0.5 * (k * h * OMEGA * FWHM_NS / 2.354820045) ** 2)
        phasor = phasors[abs(k) * h - 1]
        return np.asarray(left / k**2 * (phasor if k > 0 else phasor.conj()))

    return np.asarray([8 / np.pi**2 * sum(term(k, h) for k in (1, -3, 5, -7)) for h in range(1, harmonics + 1)])


@pytest.mark.parametrize(("harmonics", "most_cm"), [(2, 4.0), (3, 3.0)])
def test_a_net_is_found_with_triangle_modulation_too(harmonics: int, most_cm: float) -> None:
    phasors, range_m, covered = net_before_wall(9.0, 0.6, harmonics=7 * harmonics)
    recorded = recorded_by_a_triangle(phasors, harmonics=harmonics)
    found = resolved(recorded, triangle=True)
    assert found.mpi is not None
    assert found.mpi.net_patches > 0
    error = error_cm(found, range_m)
    assert np.median(error[covered]) < most_cm
    discrete = resolved(recorded, "discrete", triangle=True)
    assert np.median(error[covered]) < 0.5 * np.median(error_cm(discrete, range_m)[covered])
    assert np.median(error[~covered]) < 1.5
    assert ((found.maps.status & TWO_PATHS) > 0)[covered].mean() > 0.9
    with blocks_of(997):
        cut = resolved(recorded, triangle=True)
    np.testing.assert_array_equal(cut.maps.values, found.maps.values)


def test_without_a_net_no_patch_is_seen_through() -> None:
    phasors = phasors_of(WALL, {h: np.asarray(UNEVEN * TAIL.phasor(h), np.complex128) for h in (1, 2)})
    found = resolved(phasors)
    assert found.mpi is not None
    assert found.mpi.net_patches == 0
    assert ((found.maps.status & DIFFUSE) > 0).all()


@pytest.mark.parametrize("harmonics", [2, 3])
def test_amplitudes_of_direct_and_mpi_light_are_those_of_the_wall_and_the_tail(harmonics: int) -> None:
    """Direct light has a quarter of the modulation amplitude; MPI has |tail phasor| times as much."""
    numbers = tuple(range(1, harmonics + 1))
    found = resolved(
        phasors_of(WALL, {h: np.asarray(UNEVEN * TAIL.phasor(h), np.complex128) for h in numbers}, harmonics=numbers)
    ).maps
    assert np.median(found.layer("direct.amplitude")) == pytest.approx(0.25, rel=0.1)
    assert np.median(found.layer("mpi.amplitude")) == pytest.approx(0.25 * abs(TAIL.phasor(1)), rel=0.3)
    direct = found.layer("direct.amplitude") * np.exp(1j * found.layer(DIRECT_DEPTH) / M_PER_RAD)
    mpi = found.layer("mpi.amplitude") * np.exp(1j * found.layer("mpi.depth") / M_PER_RAD)
    np.testing.assert_allclose(np.abs(direct + mpi), found.layer("confidence"), rtol=1e-4)


def test_a_surface_whose_second_path_ends_before_the_wall_is_no_net() -> None:
    """The second path comes from something beside the view. It is as strong as behind a net, but ends before the wall."""
    _, range_m, covered = net_before_wall(9.0, 0.6)
    strong = {
        h: np.where(covered, (1 + TAIL.phasor(h)) * (1 + 0.6 * np.exp(1j * h * OMEGA * 6.0)) - 1, TAIL.phasor(h))
        for h in (1, 2)
    }
    found = resolved(phasors_of(range_m, strong))
    assert found.mpi is not None
    assert found.mpi.net_patches == 0


def test_behind_a_net_the_wall_must_keep_enough_of_its_light() -> None:
    """The second path ends on the wall, but has less than a tenth of the light that the wall sends where it is seen."""
    phasors, _, covered = net_before_wall(9.0, 0.6)
    found = resolved(np.where(covered, 0.15 * phasors, phasors))
    assert found.mpi is not None
    assert found.mpi.net_patches == 0


def test_a_frame_that_is_forced_to_have_a_tail_has_no_net() -> None:
    found = resolved(net_before_wall(9.0, 0.6)[0], "diffuse")
    assert ((found.maps.status & DIFFUSE) > 0).all()


@pytest.mark.parametrize("block_pixels", [97, 5000])
def test_blocks_of_any_size_have_the_same_bits(block_pixels: int) -> None:
    phasors = net_before_wall(9.0, 0.6)[0]
    whole = resolved(phasors)
    with blocks_of(block_pixels):
        cut = resolved(phasors)
    np.testing.assert_array_equal(cut.maps.values, whole.maps.values)
    np.testing.assert_array_equal(cut.maps.status, whole.maps.status)


def test_pixels_of_nan_have_no_answer_and_hardly_change_the_others() -> None:
    phasors, range_m, covered = net_before_wall(9.0, 0.6)
    lost = np.random.default_rng(1).random(covered.shape) < 0.1
    phasors[:, lost] = np.nan
    found = resolved(phasors)
    depth = found.maps.layer(DIRECT_DEPTH)
    np.testing.assert_array_equal(np.isnan(depth), lost)
    assert np.median(error_cm(found, range_m)[covered & ~lost]) < 3.0


def test_confidence_is_the_magnitude_of_the_recorded_first_phasor() -> None:
    phasors = net_before_wall(9.0, 0.6)[0]
    np.testing.assert_allclose(resolved(phasors).maps.layer("confidence"), np.abs(phasors[0]), rtol=1e-6)


@settings(max_examples=50)
@given(
    near=st.floats(0.0, 6.0),
    delay_ns=st.floats(6.0, 17.0),
    share=st.floats(0.3, 0.8),
    strength=st.floats(0.0, 0.3),
    ratio=st.floats(0.5, 1.0),
)
def test_two_paths_with_a_tail_each_are_found(
    near: float, delay_ns: float, share: float, strength: float, ratio: float
) -> None:
    """The nearer surface gets more direct light, so that its tail is weaker in proportion."""
    later, numbers = delay_ns * OMEGA, (1, 2, 3)
    first, second = (np.array([1 + Tail(s, 3.0, 9.0).phasor(h) for h in numbers]) for s in (ratio * strength, strength))
    h = np.array(numbers)
    phasors = share * np.exp(1j * h * near) * first + (1 - share) * np.exp(1j * h * (near + later)) * second
    found = freed_paths(phasors[:, None], Tails(first, second, numbers))
    difference = np.exp(1j * (found.near_rad[0] - near))
    assert abs(np.angle(difference)) * M_PER_RAD < 0.05
    assert found.later_rad[0] == pytest.approx(later, abs=0.1)
    assert found.near_share[0] == pytest.approx(share, abs=0.1)
