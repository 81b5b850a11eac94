"""Predictions for frames of known light: walls, tails, two paths, and all kinds of bad pixels."""

from typing import Any

import numpy as np
import pytest

from cadtof_cli import resolve, simulate_scene
from cadtof_cli.arrays import Float32
from cadtof_cli.resolver.diffuse import predict, smoothness
from cadtof_cli.resolver.diffuse.choice import DiffuseChoice, RoomNumbers
from cadtof_cli.resolver.diffuse.patches import first_planes
from cadtof_cli.resolver.diffuse.pixels import diffuse_pixels
from cadtof_cli.resolver.diffuse.planes import PatchPlanes
from cadtof_cli.resolver.diffuse.records import DiffuseModel
from cadtof_cli.resolver.diffuse.second_paths import two_path_lag
from cadtof_cli.resolver.status import StatusBit
from tests.support.diffuse_answers import answers, model_of, predicted
from tests.support.diffuse_frames import (
    M_PER_RAD,
    OMEGA,
    T1_NS,
    F,
    Tail,
    Z,
    corner_range,
    phasors_of,
    range_error_m,
    slopes,
    variance,
    wall_range,
)

DECAYS = [Tail(0.15, 3.0, 6.0), Tail(0.3, 3.0, 10.0), Tail(0.5, 5.0, 8.0)]


def median_error(found: F | Float32, range_m: F) -> float:
    return float(np.median(np.abs(range_error_m(found, range_m))))


def tail_of(tail: Tail, harmonics: tuple[int, ...] = (1, 2)) -> dict[int, complex]:
    return {h: tail.phasor(h) for h in harmonics}


@pytest.mark.parametrize("tail", DECAYS)
@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 3), (1, 2, 4)])
def test_the_tail_of_a_wall_is_removed(tail: Tail, harmonics: tuple[int, ...]) -> None:
    wall = wall_range()
    p = phasors_of(wall, tail_of(tail, harmonics), harmonics=harmonics)
    found = model_of(p, harmonics=harmonics)
    assert isinstance(found, DiffuseModel)
    pixels = predicted(p, found)
    first = median_error(np.angle(p[0]).ravel(), wall)
    assert median_error(pixels.direct_phase_rad, wall) < 0.25 * first
    seen = np.abs(range_error_m(pixels.direct_phase_rad, wall)) < 2 * pixels.direct_sigma_rad * M_PER_RAD
    assert seen.mean() > 0.8


@pytest.mark.parametrize(("harmonics", "name"), [((1, 2), "remaining_sigma_rad"), ((1, 2, 3), "coarse_planes")])
def test_the_slowness_of_the_modulation_reaches_the_functions_that_need_it(
    harmonics: tuple[int, ...], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same phasors at 2.5 times the period belong to a room 2.5 times as large.

    The numbers of the prior and of the bias were chosen for rooms at 40 ns, so `slowness` must reach them.
    """
    p = phasors_of(wall_range(), tail_of(DECAYS[1], harmonics), harmonics=harmonics)
    slownesses = []

    def recording(*arguments: object, slowness: float, **named: object) -> object:
        slownesses.append(slowness)
        return original(*arguments, slowness=slowness, **named)

    original = getattr(predict, name)
    monkeypatch.setattr(predict, name, recording)
    for period_ns in (0.5 * T1_NS, T1_NS, 2.5 * T1_NS):
        assert isinstance(model_of(p, harmonics=harmonics, period_ns=period_ns), DiffuseModel)
    assert slownesses == [1.0, 1.0, 2.5]


@pytest.mark.parametrize("tail", DECAYS)
def test_direct_and_mpi_light_add_up_to_the_recorded_phasor(tail: Tail) -> None:
    p = phasors_of(wall_range(), tail_of(tail))
    pixels = answers(p)
    direct = pixels.direct_amplitude * np.exp(1j * pixels.direct_phase_rad)
    mpi = pixels.mpi_amplitude * np.exp(1j * pixels.mpi_phase_rad)
    np.testing.assert_allclose(direct + mpi, p[0].ravel(), atol=1e-6)
    assert (pixels.mpi_phase_rad >= pixels.direct_phase_rad).all()


def test_the_mpi_light_is_that_of_the_tail() -> None:
    tail = Tail(0.4, 3.0, 9.0)
    wall = wall_range()
    pixels = answers(phasors_of(wall, tail_of(tail)))
    assert np.median(pixels.mpi_amplitude) / 0.25 == pytest.approx(abs(tail.phasor(1)), rel=0.25)
    behind = pixels.mpi_phase_rad - pixels.direct_phase_rad
    error = np.abs(behind - np.angle(tail.phasor(1)))
    assert np.median(error) < 0.25
    assert (error < 2 * pixels.mpi_sigma_rad).mean() > 0.8


@pytest.mark.parametrize("n_av", [2e3, 1e4, 1e5, 1e6])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.5, 0.2)])
def test_a_wall_without_mpi_keeps_its_depth(n_av: float, tilt: tuple[float, float]) -> None:
    wall = wall_range(96, 128, 120.0, 3.0, tilt)
    p = phasors_of(wall, n_av=n_av)
    first, second = (np.angle(p[h - 1] * np.exp(-1j * h * wall / M_PER_RAD)) for h in (1, 2))
    one_path = median_error((wall / M_PER_RAD + (first + 2 * second) / 5).ravel(), wall)
    pixels = answers(p, focal_px=120.0, n_av=n_av, model="diffuse")
    assert median_error(pixels.direct_phase_rad, wall) < 1.05 * one_path


@pytest.mark.parametrize(("n_av", "amplitude"), [(3e2, 0.16), (2e3, 0.08), (2e3, 0.25), (1e5, 0.25), (1e6, 0.25)])
def test_without_visible_mpi_no_tail_is_predicted(n_av: float, amplitude: float) -> None:
    wall = wall_range(144, 192, 180.0, tilt=(0.3, 0.1))
    found = model_of(phasors_of(wall, n_av=n_av, amplitude=amplitude), n_av=n_av, focal_px=180.0)
    assert isinstance(found, DiffuseChoice)
    assert (found.taken, found.reason) == ("discrete", "no MPI to be seen")


@pytest.mark.parametrize("delay_ns", [16.0, 20.0])
def test_a_second_surface_far_behind_is_left_to_two_paths(delay_ns: float) -> None:
    second = {h: 0.5 * np.exp(1j * h * OMEGA * delay_ns) for h in (1, 2)}
    found = model_of(phasors_of(wall_range(), second))
    assert isinstance(found, DiffuseChoice)
    assert found.taken == "discrete"
    assert found.separate_share > 0.9


def test_a_weak_first_surface_is_left_to_two_paths_unless_a_tail_is_asked_for() -> None:
    strong = {h: 3.0 * np.exp(1j * h * OMEGA * 10.0) for h in (1, 2)}
    p = phasors_of(wall_range(distance_m=1.0), strong, amplitude=0.06)
    assert isinstance(model_of(p), DiffuseChoice)
    assert isinstance(model_of(p, model="diffuse"), DiffuseModel)
    assert isinstance(model_of(p, model="discrete"), DiffuseChoice)


@pytest.mark.parametrize(("third", "reason"), [(0.0, "separate paths"), (0.2, "no tail fits")])
@pytest.mark.parametrize("delay_ns", [8.0, 11.0])
def test_with_three_harmonics_strong_further_paths_are_not_taken_for_a_tail(
    delay_ns: float, third: float, reason: str
) -> None:
    """Two paths predict the third harmonic. Three paths do not follow this prediction, but no tail fits them either."""
    mpi = {
        h: 0.6 * np.exp(1j * h * OMEGA * delay_ns) + third * np.exp(1j * h * OMEGA * (delay_ns + 3.0))
        for h in (1, 2, 3)
    }
    p = phasors_of(wall_range(96, 128, 120.0), mpi, harmonics=(1, 2, 3))
    found = model_of(p, focal_px=120.0, second_paths=True)
    assert isinstance(found, DiffuseChoice)
    assert found.reason == reason


def weak_paths(
    share: float, harmonics: tuple[int, ...], more: float, n_av: float, *, uneven_ns: float = 0.0
) -> DiffuseChoice | DiffuseModel:
    """Return the model of a frame whose second path has this share of the light, 3 to 20 ns late from left to right.

    The share grows downwards by the factor exp(more). `uneven_ns` makes the delays uneven.
    """
    delay_ns, down = np.linspace(3.0, 20.0, 192), np.linspace(0.0, more, 144)[:, None]
    delay_ns = delay_ns + uneven_ns * np.sin(7.0 * down)
    second: dict[int, Z] = {h: np.asarray(share * np.exp(down + 1j * h * OMEGA * delay_ns)) for h in harmonics}
    p = phasors_of(wall_range(144, 192, 180.0, 0.8), second, harmonics=harmonics, n_av=n_av)
    return model_of(p, focal_px=180.0, n_av=n_av, second_paths=True)


@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 3)])
@pytest.mark.parametrize(("share", "n_av"), [(0.01, 1e5), (0.02, 1e5), (0.02, 1e4), (0.1, 2e3), (0.1, 1e6), (0.3, 1e4)])
def test_second_paths_of_one_share_are_not_taken_for_a_tail(
    share: float, harmonics: tuple[int, ...], n_av: float
) -> None:
    """A single patch could be that of a tail: the second path lowers |H_2| and makes it lag."""
    found = weak_paths(share, harmonics, 0.0, n_av)
    assert isinstance(found, DiffuseChoice)
    assert (found.taken, found.reason) == ("discrete", "separate paths")


def test_second_paths_of_different_shares_and_delays_are_not_taken_for_a_tail(monkeypatch: pytest.MonkeyPatch) -> None:
    """Even delays show them; if delays are uneven, two paths smooth the surface; otherwise no tail fits all patches."""
    for uneven_ns, smooth, reason in (
        (0.0, False, "separate paths"),
        (1.5, True, "separate paths"),
        (1.5, False, "no tail fits"),
    ):
        monkeypatch.setattr(smoothness, "are_smoothed_by_two_paths", lambda *_, smooth=smooth, **__: smooth)
        found = weak_paths(0.05, (1, 2), 1.4, 1e5, uneven_ns=uneven_ns)
        assert isinstance(found, DiffuseChoice)
        assert (found.taken, found.reason) == ("discrete", reason)


def test_second_paths_that_change_smoothly_do_not_vary_as_a_tail_would(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bent surface before second paths whose share and delay have waves of their own: some tail fits each patch."""
    x, y = slopes(96, 128, 110.0)
    wall = 1.8 * (1.0 + 0.1 * np.sin(5.0 * x + 2.0 * y)) * np.sqrt(1 + x * x + y * y)
    share, delay_ns = 0.1 * np.exp(0.6 * np.sin(6.0 * y - 3.0 * x + 1.0)), 10.0 + 1.5 * np.sin(7.0 * x + 4.0 * y)
    p = phasors_of(wall, {h: np.asarray(share * np.exp(1j * h * OMEGA * delay_ns)) for h in (1, 2)})
    found = model_of(p, focal_px=110.0, second_paths=True)
    assert isinstance(found, DiffuseChoice)
    assert (found.taken, found.reason) == ("discrete", "no tail fits")
    monkeypatch.setattr(predict, "varies_like_the_tail", lambda *_: True)
    assert isinstance(model_of(p, focal_px=110.0, second_paths=True), DiffuseModel)


@pytest.mark.parametrize(("harmonics", "taken"), [((1, 2), False), ((1, 2, 3), True), ((1, 2, 3, 4), True)])
def test_a_tail_that_two_paths_do_not_explain_may_vary_in_any_way(
    harmonics: tuple[int, ...], taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a narrow view, MPI hardly varies over the view, and in any way. Further harmonics tell that it is a tail."""
    monkeypatch.setattr(predict, "varies_like_the_tail", lambda *_: False)
    p = phasors_of(wall_range(focal_px=180.0), tail_of(Tail(0.5, 3.0, 10.0), harmonics), harmonics=harmonics)
    found = model_of(p, focal_px=180.0, harmonics=harmonics)
    assert isinstance(found, DiffuseModel) is taken
    assert isinstance(found, DiffuseModel) or found.reason == "no tail fits"


def test_the_boxes_on_a_shelf_are_no_sign_of_two_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """Boxes that face the camera, up to .35 m before a wall, in light that reaches all of them alike. The planes of the
    patches are tilted by the steps between boxes, and alone foretell much MPI where there is little."""
    height, width, focal_px, side = 96, 128, 300.0, 7
    x, y = slopes(height, width, focal_px)
    row, column = np.mgrid[:height, :width] // side
    before_m = 0.35 * np.random.default_rng(0).random((row.max() + 1, column.max() + 1))
    ray = np.sqrt(1 + x * x + y * y)
    range_m = (2.5 - before_m[row, column]) * ray
    share = 0.12 * range_m**2 * ray
    p = phasors_of(range_m, {h: np.asarray(share * Tail(1.0, 4.4, 12.0).phasor(h)) for h in (1, 2)})
    assert isinstance(model_of(p, focal_px=focal_px), DiffuseModel)
    # the second look is no excuse for light that changes from box to box as no room's does
    patchy = 0.1 * range_m**2 * ray * (1.0 + 0.8 * np.sin(column))
    p_patchy = phasors_of(range_m, {h: np.asarray(patchy * np.exp(1j * h)) for h in (1, 2)})
    assert getattr(model_of(p_patchy, focal_px=focal_px), "reason", None) == "no tail fits"

    def never_over_steps(*given: Any, over_steps: bool = False) -> PatchPlanes:
        return first_planes(*given)

    monkeypatch.setattr(predict, "first_planes", never_over_steps)
    found = model_of(p, focal_px=focal_px)
    assert isinstance(found, DiffuseChoice)
    assert found.reason == "no tail fits"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[F]:
    """The signal-to-noise ratios of all patches, each time that the order of the MPI is asked."""
    ratios: list[F] = []

    def record(*given: F) -> bool:
        ratios.append(given[-2])
        return True

    monkeypatch.setattr(predict, "varies_like_the_tail", record)
    return ratios


def test_the_order_of_the_mpi_is_asked_with_the_noise_of_a_pixel(asked: list[F]) -> None:
    model_of(phasors_of(corner_range(), tail_of(Tail(0.3, 3.0, 8.0)), n_av=1e4), n_av=1e4)
    (snr,) = asked
    np.testing.assert_allclose(snr, 0.25 * abs(1 + Tail(0.3, 3.0, 8.0).phasor(1)) / np.sqrt(variance(1e4)), rtol=0.03)


@pytest.mark.parametrize(("waveform", "times"), [("sine", 1), ("triangle", 0)])
def test_the_order_of_the_mpi_is_not_asked_if_the_waveform_is_no_sine(
    waveform: str, times: int, asked: list[F]
) -> None:
    """The first phasors are then freed of other terms as if there were two paths."""
    (frame,) = simulate_scene(
        "corner", camera={"width": 64, "height": 48}, modulation={"waveform": waveform}, integration_length=1e5
    ).frames
    assert (resolve(frame).status & StatusBit.DIFFUSE_MPI).any()
    assert len(asked) == times


def test_half_of_the_tail_that_other_terms_see_counts_as_the_error_of_the_direct_phase() -> None:
    """A response whose terms see the multiples 3 and 9 with 10 % and 2 % gets larger sigmas than a sine."""
    tail, shares = Tail(0.3, 3.0, 8.0), np.array([0.1, 0.02])
    p = phasors_of(wall_range(), tail_of(tail))
    sine, other = model_of(p), model_of(p, terms=((3, 0.1), (9, 0.02)))
    assert isinstance(sine, DiffuseModel)
    assert isinstance(other, DiffuseModel)
    assert other.terms is not None
    seen = np.abs(other.terms.planes[2:4] + 1j * other.terms.planes[4:6] - 1.0)
    assert np.median(seen[0]) == pytest.approx(abs(tail.phasor(3)), rel=0.4)
    added = other.coarse.planes[-2] - sine.coarse.planes[-2]
    np.testing.assert_allclose(added, ((0.5 * shares[:, None, None] * seen) ** 2).sum(axis=0), rtol=1e-3)


def test_only_pixels_of_separate_patches_are_left_to_two_paths() -> None:
    tail = Tail(0.3, 3.0, 8.0)
    mpi = {h: np.full((48, 64), tail.phasor(h)) for h in (1, 2)}
    for h in (1, 2):
        mpi[h][8:20, 8:24] = 0.5 * np.exp(1j * h * OMEGA * 18.0)
    p = phasors_of(wall_range(), mpi)
    found = model_of(p)
    assert isinstance(found, DiffuseModel)
    answered = predicted(p, found).answered.reshape(48, 64)
    assert not answered[8:20, 8:24].any()
    assert answered[24:].all()
    assert 0 < found.choice.separate_share < 0.15


@pytest.mark.parametrize("size", [(37, 53), (48, 64)])
@pytest.mark.parametrize("step", [1, 17, 64, 1000])
def test_blocks_of_any_size_give_the_same_bits(size: tuple[int, int], step: int) -> None:
    height, width = size
    wall = corner_range(height, width)
    p = phasors_of(wall, tail_of(Tail(0.3, 3.0, 8.0)))
    p[:, 5, 7], p[0, 9, 11] = np.nan, np.inf
    found = model_of(p)
    assert isinstance(found, DiffuseModel)
    whole, parts = predicted(p, found), predicted(p, found, step=step)
    for name, values in vars(whole).items():
        np.testing.assert_array_equal(values, getattr(parts, name), err_msg=name)


def test_bad_pixels_have_no_answer_and_harm_no_other() -> None:
    wall = wall_range()
    p = phasors_of(wall, tail_of(Tail(0.3, 3.0, 8.0)))
    clean = answers(p)
    usable = np.ones(wall.shape, bool)
    usable[10:20, 30:44] = False
    spoilt = p.copy()
    spoilt[:, ~usable] = 40.0 * np.exp(1j)
    spoilt[:, :, 50] = np.nan
    spoilt[1, 4, 4] = np.inf
    spoilt[:, 6, 6] = 0.0
    given = spoilt.copy()
    found = model_of(spoilt, usable=usable)
    assert isinstance(found, DiffuseModel)
    pixels = predicted(spoilt, found, usable=usable)
    np.testing.assert_array_equal(spoilt, given)
    bad = ~usable
    bad[:, 50] = bad[4, 4] = bad[6, 6] = True
    np.testing.assert_array_equal(pixels.answered, ~bad.ravel())
    for name, values in vars(pixels).items():
        if name != "answered":
            np.testing.assert_array_equal(np.isnan(values), bad.ravel(), err_msg=name)
    moved = np.abs(pixels.direct_phase_rad - clean.direct_phase_rad)[~bad.ravel()] * M_PER_RAD
    assert np.median(moved) < 0.002


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (2, 2), (7, 5), (11, 90)])
def test_small_frames_are_answered_or_left_to_the_discrete_model(size: tuple[int, int]) -> None:
    wall = wall_range(*size)
    p = phasors_of(wall, tail_of(Tail(0.3, 3.0, 8.0)))
    found = model_of(p)
    if isinstance(found, DiffuseModel):
        assert predicted(p, found).answered.all()
    else:
        assert found.taken == "discrete"


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, 1e-300])
def test_frames_without_light_are_left_to_the_discrete_model(value: float) -> None:
    found = model_of(np.full((2, 30, 40), value, complex))
    assert isinstance(found, DiffuseChoice)
    assert found.patches == 0


def test_frames_of_noise_alone_are_left_to_the_discrete_model() -> None:
    rng = np.random.default_rng(1)
    p = np.sqrt(variance(1e5)) * (rng.normal(size=(2, 60, 80)) + 1j * rng.normal(size=(2, 60, 80)))
    assert isinstance(model_of(p), DiffuseChoice)


def test_means_of_pixels_have_smaller_sigmas_if_noise_is_most_of_the_error() -> None:
    sigma_rad = []
    for samples in (1.0, 25.0):
        p = phasors_of(wall_range(), n_av=5e2 * samples)
        model = model_of(p, n_av=5e2, samples=samples, model="diffuse")
        assert isinstance(model, DiffuseModel)
        flat, of_pixel = p.reshape(2, -1), np.full(p[0].size, samples)
        answers = diffuse_pixels(flat, model=model, first=0, usable=of_pixel > 0, samples=of_pixel)
        sigma_rad.append(np.median(answers.direct_sigma_rad))
    assert sigma_rad[1] < 0.6 * sigma_rad[0]


def test_ranges_are_corrected_before_the_geometry_is_built() -> None:
    wall = corner_range()
    x, y = slopes(48, 64, 60.0)
    curved = 0.6 * (x * x + y * y)
    tail = tail_of(Tail(0.3, 3.0, 8.0))
    uncorrected, corrected = (
        model_of(phasors_of(wall, tail, seed=3)),
        model_of(phasors_of(wall - curved, tail, seed=3), range_offset_m=curved),
    )
    assert isinstance(uncorrected, DiffuseModel)
    assert isinstance(corrected, DiffuseModel)
    np.testing.assert_allclose(corrected.upsampler.range_m, uncorrected.upsampler.range_m, rtol=0.01)


def test_unknown_optics_are_assumed() -> None:
    wall = wall_range(focal_px=55.0)
    p = phasors_of(wall, tail_of(Tail(0.3, 3.0, 8.0)))
    pixels = answers(p, focal_px=None)
    assert median_error(pixels.direct_phase_rad, wall) < 0.3 * median_error(np.angle(p[0]).ravel(), wall)


def test_targets_beyond_the_unambiguous_range_wrap() -> None:
    wall = wall_range(distance_m=7.5)
    pixels = answers(phasors_of(wall, tail_of(Tail(0.2, 3.0, 8.0))))
    assert median_error(pixels.direct_phase_rad, wall) < 0.05
    assert ((pixels.direct_phase_rad >= 0) & (pixels.direct_phase_rad < 2 * np.pi)).all()


def test_the_numbers_of_the_room_are_reported() -> None:
    found = model_of(phasors_of(wall_range(), tail_of(Tail(0.4, 4.0, 8.0))))
    assert isinstance(found, DiffuseModel)
    room = found.choice.room
    assert room is not None
    assert found.choice.taken == "diffuse"
    strength = room.unseen[0] * room.decay_ns[0] / 12.0
    assert strength == pytest.approx(0.4, rel=0.5)
    assert room.decay_ns[0] == pytest.approx(8.0, rel=0.5)


def uneven_tails(seed: int = 4) -> tuple[F, Z]:
    """Return ranges and phasors of a corner with hardly any noise and another strength of tail for every 8 × 8 pixels."""
    rng, wall = np.random.default_rng(seed), corner_range()
    scale = np.repeat(np.repeat(rng.uniform(0.7, 1.4, (6, 8)), 8, axis=0), 8, axis=1)
    return wall, phasors_of(wall, {h: np.asarray(scale * Tail(0.3, 3.0, 8.0).phasor(h)) for h in (1, 2)}, n_av=1e6)


def test_the_numbers_of_the_room_are_median_and_scatter_over_its_patches() -> None:
    _, p = uneven_tails()
    found = model_of(p, n_av=1e6, model="diffuse")
    assert isinstance(found, DiffuseModel)
    room = found.choice.room
    assert room is not None
    medians = [room.albedo, room.beside, room.later, room.unseen, room.decay_ns]
    for median, scatter in medians:
        assert 0.02 * median < scatter < median
    assert 2.0 < room.start_ns[0] < 8.0
    assert 0.0 < room.start_ns[1] < 2.5
    assert found.choice.patches == 12 * 16


def test_the_scatter_of_the_numbers_of_a_room_is_the_standard_deviation_of_a_gaussian_state() -> None:
    """One patch in six lies below the mean by more than the standard deviation, and one above it."""
    rng = np.random.default_rng(3)
    state = np.array([-0.4, 0.0, 0.1, -2.5, 2.4, 1.0])[:, None] + 0.1 * rng.standard_normal((6, 4000))
    room = RoomNumbers.of(state)
    for median, scatter in (room.albedo, room.unseen, room.decay_ns):
        assert scatter == pytest.approx(0.1 * median, rel=0.05)
    assert room.start_ns == pytest.approx((1.0, 0.1), rel=0.05)


def test_the_variance_of_separate_pixels_is_the_squared_difference_of_tail_and_two_paths() -> None:
    """On a wall with one tail, the lags of the tail and of two paths differ by a number whose square is the variance."""
    tail = Tail(0.4, 3.0, 9.0)
    found = model_of(phasors_of(wall_range(), tail_of(tail), n_av=1e7), n_av=1e7)
    assert isinstance(found, DiffuseModel)
    first, second = (1.0 + tail.phasor(h) for h in (1, 2))
    by_two = float(two_path_lag(np.array([second * abs(first) / first**2]))[0])
    by_tail = float(np.median(found.coarse.planes[found.coarse.data + 1]))
    assert found.separate_variance == pytest.approx((by_tail - by_two) ** 2, rel=0.35)


def test_a_frame_with_few_lit_patches_is_not_predicted() -> None:
    wall = wall_range()
    usable = np.zeros(wall.shape, bool)
    usable[:, :20] = True
    found = model_of(phasors_of(wall, tail_of(Tail())), usable=usable)
    assert isinstance(found, DiffuseChoice)
    assert (found.reason, found.patches) == ("few patches with light", 12 * 5)
    usable[:, :24] = True
    assert isinstance(model_of(phasors_of(wall, tail_of(Tail())), usable=usable), DiffuseModel)


def test_patches_of_random_phases_have_no_surfaces() -> None:
    """With random phases, every patch is lit but none has a plane: there is no room, even if a tail is asked for."""
    rng = np.random.default_rng(3)
    wall = rng.uniform(0.3, 5.7, (48, 64))
    found = model_of(phasors_of(wall, tail_of(Tail(0.4))), model="diffuse")
    assert isinstance(found, DiffuseChoice)
    assert (found.reason, found.patches) == ("few patches with light", 12 * 16)


def test_patches_behind_the_camera_count_as_five_centimetres_away() -> None:
    """A correction puts a part of the view behind the camera. Its patches count as surfaces 5 cm before the camera."""
    wall, offset_m = wall_range(), np.zeros((48, 64))
    offset_m[16:28, 24:36] = -4.0
    found = model_of(phasors_of(wall, tail_of(Tail(0.3, 3.0, 8.0))), range_offset_m=offset_m)
    assert isinstance(found, DiffuseModel)
    side = found.upsampler.grid.side
    range_m = found.upsampler.range_m[1:-1, side:-side:side]
    near = np.zeros(range_m.shape, bool)
    near[4:7, 6:9] = True
    np.testing.assert_allclose(range_m[near], 0.05, rtol=1e-3)
    assert (range_m[~near] > 2.5).all()


def test_a_forced_tail_without_light_at_the_third_harmonic_has_a_sigma_of_the_size_of_its_error() -> None:
    """No tail has light at the second harmonic and none at the third."""
    wall = wall_range()
    p = phasors_of(wall, tail_of(Tail(0.3, 3.0, 8.0), (1, 2, 3)), harmonics=(1, 2, 3))
    p[2] = 0.0
    assert isinstance(model_of(p), DiffuseChoice)
    found = model_of(p, model="diffuse")
    assert isinstance(found, DiffuseModel)
    pixels = predicted(p, found)
    assert pixels.answered.all()
    assert median_error(pixels.direct_phase_rad, wall) < np.median(pixels.direct_sigma_rad) * M_PER_RAD


@pytest.mark.parametrize(("lit", "patches"), [(6, 0), (7, 300)])
def test_a_patch_counts_by_the_share_of_its_own_samples(lit: int, patches: int) -> None:
    """In 120 × 160 pixels a patch has 64 samples. It counts from a tenth of these on."""
    usable = np.zeros((15, 8, 20, 8), bool)
    usable[:, 0, :, :lit] = True
    p = phasors_of(wall_range(120, 160, 150.0), tail_of(Tail(0.3, 3.0, 8.0)))
    found = model_of(p, usable=usable.reshape(120, 160), focal_px=150.0)
    assert isinstance(found, DiffuseChoice)
    assert (found.reason, found.patches) == ("few patches with light", patches)
