"""The response that targets determine, and terms that they cannot determine; the truth samples the waveform itself."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.calibration.fit.response import TargetMean, fit_response
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.capture.metadata import CaptureMetadata, Optics, Waveform
from cadtof_cli.errors import SettingsError
from tests.support.campaign import PIXELS, camera
from tests.support.defects import DefectiveCamera, Defects

FRAMES = 10

PULSE = {h: np.exp(-((h * 2 * np.pi * 1.7 / 2.354820045 / 40.0) ** 2) / 2) for h in (1, 2)}
"""Share of each harmonic that a pulse of 1.7 ns leaves."""


def target(sensor: DefectiveCamera, distance_m: float, *, seed: int) -> TargetMean:
    """Return the mean frame of a wall, from counts of the camera."""
    return mean_of(sensor, sensor.wall_range_m(distance_m), distance_m, seed=seed)


def mean_of(sensor: DefectiveCamera, ranges_m: Float, distance_m: float, *, seed: int) -> TargetMean:
    """Return the mean frame of a wall at that distance, whose light goes these lengths to and fro."""
    ranges = ranges_m[np.newaxis]
    frames = np.stack(sensor.frames(ranges, np.full_like(ranges, 1.0 / 3.0), count=FRAMES, seed=seed))
    volts = (frames.astype(np.float64) - 8192.0) * 6.0e-5
    mean = volts.mean(axis=0)
    noise = np.sqrt(volts.var(axis=0, ddof=1).mean(axis=(1, 2, 3)) / FRAMES)
    return TargetMean(mean[:, 0] + 1j * mean[:, 1], noise, distance_m)


@pytest.mark.parametrize("distances_m", [(1.5,), (0.8, 2.0, 3.5, 5.0), (0.5, 0.8, 1.2)])
def test_errors_of_few_dark_frames_are_counted_once(distances_m: tuple[float, ...]) -> None:
    """All targets share them. If they were taken for noise of each target, ± would be too large by 2 or too small by 1.5."""
    rng, shape = np.random.default_rng(3), (2, *PIXELS)
    own_v, offset_noise_v = 1e-4, 3e-4

    def noise(standard_deviation: float) -> Complex:
        noises = rng.normal(scale=standard_deviation, size=(2, *shape))
        return np.asarray(noises[0] + 1j * noises[1])

    offset = noise(offset_noise_v)
    targets = []
    for distance in distances_m:
        turn = 2.0 * np.pi * distance / 5.99584916
        light = 0.1 * np.exp(1j * np.array([turn, 2.0 * turn]))[:, np.newaxis, np.newaxis]
        noise_v = np.full(2, np.hypot(own_v, offset_noise_v))
        targets.append(TargetMean(light + noise(own_v) - offset, noise_v, distance, offset_noise_v))
    found = fit_response(targets, metadata=CaptureMetadata(), origin=origin_of(targets))
    np.testing.assert_allclose(found.phase_rad.std(axis=(1, 2)), found.quality.phase_stderr_rad, rtol=0.06)
    np.testing.assert_allclose(found.gain[1].std(), found.quality.gain_stderr[1], rtol=0.06)


def origin_of(
    targets: Sequence[TargetMean], pixels: tuple[int, int] = PIXELS, *, waveform: Waveform = "sine"
) -> Origin:
    return Origin(
        captures=tuple(f"target_{one.distance_m}m" for one in targets),
        frames=FRAMES * len(targets),
        pixels=pixels,
        periods_ns=(40.0, 20.0),
        waveform=waveform,
    )


def response_of(
    defects: Defects,
    distances_m: tuple[float, ...],
    *,
    waveform: Waveform = "sine",
    optics: Optics | None = None,
    n_av: float = 1e5,
    seed: int = 0,
) -> ResponseCalibration:
    sensor = camera(defects, waveform=waveform, n_av=n_av)
    targets = [target(sensor, d, seed=seed + index) for index, d in enumerate(distances_m)]
    origin = origin_of(targets, waveform=waveform)
    metadata = sensor.metadata
    if optics is not None:
        metadata = replace(metadata, optics=optics)
    return fit_response(targets, metadata=metadata, origin=origin)


def coefficients_m(found: ResponseCalibration) -> tuple[float, float]:
    return found.curvature.k2_m, found.curvature.k4_m


def stderr_m(found: ResponseCalibration) -> tuple[float, float]:
    return found.curvature.k2_stderr_m, found.curvature.k4_stderr_m


def orders(found: ResponseCalibration) -> set[int]:
    return {k for one in found.responses for k, _ in one.terms}


def test_a_perfect_camera_needs_only_the_main_term() -> None:
    found = response_of(Defects(), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert orders(found) == {1}
    assert found.quality.residual == pytest.approx(1.0, abs=0.05)
    assert found.phase_rad.std(axis=(1, 2)) == pytest.approx(found.quality.phase_stderr_rad, rel=0.2)
    assert found.gain.std(axis=(1, 2)) == pytest.approx(found.quality.gain_stderr, rel=0.2)
    assert coefficients_m(found) == (0.0, 0.0)


@pytest.mark.parametrize("seed", [0, 100])
def test_terms_that_noise_alone_makes_are_not_taken(seed: int) -> None:
    """At n_av 300 noise makes terms of one to three standard errors, which are 2e-4. Such terms would matter."""
    found = response_of(Defects(), (0.5, 1.0, 1.7, 2.4, 3.0), n_av=300.0, seed=seed)
    assert orders(found) == {1}
    assert sum("not used, because it is not needed" in text for text in found.quality.findings) == 5


@pytest.mark.parametrize(("sc2_gain", "taken"), [(1.0012, False), (1.0037, True)])
def test_a_term_is_taken_if_it_exceeds_six_standard_errors(sc2_gain: float, taken: bool) -> None:
    """The imbalances are .6e-3 and 1.85e-3; the standard error is .2e-3."""
    found = response_of(Defects(sc2_gain=sc2_gain), (0.5, 1.0, 1.7, 2.4, 3.0), n_av=300.0, seed=300)
    assert (-1 in orders(found)) == taken


def test_an_ideal_triangle_needs_no_terms_besides_its_series() -> None:
    found = response_of(Defects(), (0.5, 1.0, 1.7, 2.4, 3.0), waveform="triangle")
    assert all(
        "not used, because it is not needed" in text for text in found.quality.findings if text.startswith("k =")
    )


def test_one_distance_gives_only_the_main_term_and_reports_it() -> None:
    found = response_of(Defects(sc2_gain=1.05, phase_rad=(0.0, 0.3)), (1.0,))
    assert orders(found) == {1}
    assert any(
        text.startswith("warning: one distance: only k = 1 and the maps are determined. If SC1 and SC2 differ")
        for text in found.quality.findings
    )


def test_two_close_distances_do_not_separate_an_offset_from_a_phase() -> None:
    found = response_of(Defects(sc2_gain=1.05), (1.0, 1.05))
    assert any("cannot be determined" in text for text in found.quality.findings)


def test_the_imbalance_is_found_from_five_distances() -> None:
    found = response_of(Defects(sc2_gain=1.05, phase_rad=(0.0, 0.3), gain=(1.0, 0.8)), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert orders(found) == {1, -1}
    for one in found.responses:
        assert abs(one.mirror / np.conj(one.main) + 0.05 / 2.05) < 2e-4
    assert np.angle(found.responses[1].main) == pytest.approx(0.3, abs=2e-3)


def test_field_curvature_is_removed_from_the_phase_maps() -> None:
    found = response_of(Defects(petzval_m=(0.06, -0.02)), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert coefficients_m(found) == pytest.approx((0.06, -0.02), abs=1e-3)
    assert found.phase_rad.std(axis=(1, 2)) == pytest.approx(found.quality.phase_stderr_rad, rel=0.2)
    k2, k4 = coefficients_m(found)
    (finding,) = (text for text in found.quality.findings if "was removed from the phase maps" in text)
    assert finding.startswith(f"field curvature k2 = {k2:.4f} m, k4 = {k4:.4f} m ")


def test_distances_that_do_not_fit_each_other_are_told_and_make_no_terms() -> None:
    sensor, wrong = camera(Defects(sc2_gain=1.05)), (0.4985, 1.0005, 1.702, 2.3985, 3.0005)
    targets = [target(sensor, d, seed=index) for index, d in enumerate((0.5, 1.0, 1.7, 2.4, 3.0))]
    targets = [replace(one, distance_m=d) for one, d in zip(targets, wrong, strict=True)]
    found = fit_response(targets, metadata=sensor.metadata, origin=origin_of(targets))
    assert orders(found) == {1, -1}
    (text,) = (text for text in found.quality.findings if "do not fit each other" in text)
    shown = [float(one) for one in re.findall(r"([0-9.]+) m\b", text)]
    assert shown == pytest.approx([0.5, 1.0, 1.7, 2.4, 3.0], abs=3e-4)
    assert text.startswith("the given distances do not fit each other: one is 2.")


def test_without_optics_every_pixel_gets_the_stated_distance_and_this_is_reported() -> None:
    found = response_of(Defects(), (1.0,), optics=Optics())
    assert any(
        "no focal length given, so the target's distance is used as the range" in text
        for text in found.quality.findings
    )
    assert (coefficients_m(found), stderr_m(found)) == ((0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize(
    ("optics", "cause"),
    [
        (Optics(), "at most: no focal length is given, so every pixel of a target counts as equally far"),
        (
            Optics(focal_length_px=40.0),
            r"or the optical axis does not meet the middle of the array \(principal_point_px\)",
        ),
    ],
)
def test_targets_that_differ_by_unknown_optics_are_refused_with_that_cause(optics: Optics, cause: str) -> None:
    """The focal length is 70 px."""
    with pytest.raises(SettingsError, match=cause):
        response_of(Defects(), (0.5, 2.0, 3.5), optics=optics)


@pytest.mark.parametrize(("offset_v", "warned"), [(0.0002, False), (0.0005, True), (0.004, True)])
def test_offsets_that_were_not_removed_are_warned_of(offset_v: float, warned: bool) -> None:
    """The residuals are 1.3, 2.5 and 18 times the noise."""
    found = response_of(Defects(offset_v=offset_v), (0.5, 1.0, 1.7, 2.4, 3.0))
    assert any(text.startswith("warning: the residual is ") for text in found.quality.findings) == warned


@pytest.mark.parametrize(("drift_v", "warned"), [(0.0, False), (0.0001, False), (0.002, True)])
def test_offsets_of_all_pixels_that_drifted_are_warned_of(drift_v: float, warned: bool) -> None:
    """They become terms of the response, with a residual of 1."""
    sensor = camera(Defects())
    targets = [target(sensor, distance, seed=5) for distance in (0.5, 1.0, 1.7, 2.4, 3.0)]
    drifted = [replace(one, volts=one.volts + (1.0 + 1.0j) * drift_v) for one in targets]
    found = fit_response(drifted, metadata=sensor.metadata, origin=origin_of(targets))
    assert any(text.startswith("warning: k = 0 is ") for text in found.quality.findings) == warned
    assert found.quality.residual < 1.1


def test_offsets_that_move_ranges_by_centimetres_are_refused() -> None:
    with pytest.raises(SettingsError, match="or the dark calibration is missing in the folder"):
        response_of(Defects(offset_v=0.02), (0.5, 1.0, 1.7, 2.4, 3.0))


def test_offsets_without_light_are_refused() -> None:
    """They have random phases, which became the phases of the pixels."""
    phase = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, (2, *PIXELS))
    offsets = TargetMean(0.01 * np.exp(1j * phase), np.full(2, 1e-4), 1.0)
    origin = Origin(captures=("laser off",), frames=1, pixels=PIXELS, periods_ns=(40.0, 20.0), waveform="sine")
    with pytest.raises(SettingsError, match=r"have only 0\.0. in common .*Was the laser on\?"):
        fit_response([offsets], metadata=camera(Defects()).metadata, origin=origin)


def test_a_target_without_a_signal_is_refused() -> None:
    sensor = camera(Defects())
    nothing = TargetMean(np.full((2, *PIXELS), np.nan, np.complex128), np.full(2, 1e-4), 1.0)
    origin = Origin(captures=("dark room",), frames=1, pixels=PIXELS, periods_ns=(40.0, 20.0), waveform="sine")
    with pytest.raises(SettingsError, match=r"found 0\.0% of the pixels with a signal from every target"):
        fit_response([nothing], metadata=sensor.metadata, origin=origin)


def pixels_without_light(count: int) -> np.ndarray:
    return np.random.default_rng(3).permutation(12 * 16)[:count]


def noiseless(
    *,
    pixel_phases: np.ndarray | None = None,
    gain: float = 1.0,
    dim: int = 0,
    saturated: int = 0,
    distances_m: tuple[float, ...] = (0.7, 1.4, 2.4),
    term: tuple[int, complex] = (1, 0j),
    off_m: tuple[int, np.ndarray] | None = None,
) -> ResponseCalibration:
    """Return the response fitted to targets without noise that fill 12 × 16 pixels.

    `pixel_phases` are the phases that pixels add at the fundamental, and `term` is a further order k with its value.
    `dim` of the pixels see no light, and `saturated` of them saturate at the first target. `off_m` is a target and how
    much farther than stated each pixel sees it.
    """
    shape = (12, 16)
    metadata = CaptureMetadata(optics=Optics(focal_length_px=14.0))
    y, x = np.mgrid[: shape[0], : shape[1]]
    stretch = np.sqrt(1 + ((x - 7.5) / 14.0) ** 2 + ((y - 5.5) / 14.0) ** 2)
    targets = []
    for index, d in enumerate(distances_m):
        wrong = off_m[1] if off_m is not None and off_m[0] == index else 0.0
        delay = 2 * np.pi / 40.0 * 2 / 0.299792458 * (d * stretch + wrong)
        planes = []
        for h in (1, 2):
            added = 0.0 if pixel_phases is None else h * pixel_phases
            theta = h * delay + added
            wave = np.exp(1j * theta) + term[1] * np.exp(1j * term[0] * theta)
            planes.append(0.09 / (1 + index) * gain ** (h - 1) * PULSE[h] * wave)
        volts = np.stack(planes)
        volts.reshape(2, -1)[:, pixels_without_light(dim)] = 1e-5
        if index == 0:
            volts.reshape(2, -1)[:, pixels_without_light(saturated)] = np.nan
        targets.append(TargetMean(volts, np.full(2, 1e-5), d))
    captures = tuple(f"target {index}" for index in range(len(targets)))
    origin = Origin(captures=captures, frames=30, pixels=shape, periods_ns=(40.0, 20.0), waveform="sine")
    return fit_response(targets, metadata=metadata, origin=origin)


def test_targets_without_noise_give_gain_and_pulse_response_exactly() -> None:
    found = noiseless(gain=0.8)
    assert found.responses[0].main == pytest.approx(PULSE[1], rel=1e-6)
    assert found.responses[1].main == pytest.approx(0.8 * PULSE[2], rel=1e-6)
    np.testing.assert_allclose(found.gain, 1.0, rtol=1e-6)
    np.testing.assert_allclose(found.phase_rad, 0.0, atol=1e-6)
    assert found.quality.distances_m == (0.7, 1.4, 2.4)
    assert coefficients_m(found) == (0.0, 0.0)
    assert not any("could not be used" in text for text in found.quality.findings)
    assert any("the targets are assumed to face the camera" in text for text in found.quality.findings)


def test_delays_of_pixels_go_into_the_maps_and_their_mean_into_the_response() -> None:
    pixel_phases = np.random.default_rng(2).normal(0.2, 0.1, (12, 16))
    found = noiseless(pixel_phases=pixel_phases)
    for row, h in enumerate((1, 2)):
        total = found.phase_rad[row] + np.angle(found.responses[row].main)
        k2, k4 = coefficients_m(found)
        assert (k2, k4) == (0.0, 0.0)
        np.testing.assert_allclose(total, h * pixel_phases, atol=1e-5)
        assert abs(np.angle(np.exp(1j * found.phase_rad[row]).mean())) < 1e-5


def test_curvature_that_the_pixels_own_delays_hide_is_within_its_standard_error() -> None:
    """It stays in the phase maps, so walls corrected by them show none of it. `calibrate petzval` needs its error."""
    y, x = np.mgrid[:12, :16]
    rho2 = ((x - 7.5) ** 2 + (y - 5.5) ** 2) / (8.0**2 + 6.0**2)
    own_m = np.random.default_rng(5).normal(0.0, 0.05, (12, 16))
    found = noiseless(pixel_phases=RAD_PER_M * (own_m + 0.06 * rho2))
    assert coefficients_m(found) == (0.0, 0.0)
    assert 0.02 < stderr_m(found)[0] < 0.2


@pytest.mark.parametrize("curvature_m", [(0.05, 0.0), (-0.05, 0.0), (0.0, 0.04), (0.0, -0.04), (-0.06, 0.02)])
@pytest.mark.parametrize("lean_m", [0.0, 0.05])
def test_field_curvature_of_either_sign_is_found_among_delays_of_the_pixels(
    curvature_m: tuple[float, float], lean_m: float
) -> None:
    """It is found even if the wall leans, so that one side of the array sees it nearer than the other."""
    y, x = np.mgrid[:12, :16]
    rho2 = ((x - 7.5) ** 2 + (y - 5.5) ** 2) / (8.0**2 + 6.0**2)
    own_m = np.random.default_rng(5).normal(0.0, 2e-4, (12, 16)) + lean_m * (x / 16.0 - y / 20.0)
    found = noiseless(pixel_phases=RAD_PER_M * (own_m + curvature_m[0] * rho2 + curvature_m[1] * rho2**2))
    errors_m = np.abs(np.array(coefficients_m(found)) - curvature_m)
    assert (errors_m < 4.0 * np.array(stderr_m(found))).all()
    assert (np.array(stderr_m(found)) < 5e-4).all()


def test_pixels_that_saturate_at_one_target_are_measured_with_the_others() -> None:
    """Such pixels got the mean phase of the array, and with it a range that was wrong by many sigma."""
    y, x = np.mgrid[:12, :16]
    rho2 = ((x - 7.5) ** 2 + (y - 5.5) ** 2) / (8.0**2 + 6.0**2)
    own = np.random.default_rng(2).normal(0.2, 0.002, (12, 16))
    found = noiseless(pixel_phases=own + RAD_PER_M * 0.05 * rho2, gain=0.8, saturated=40)
    k2, k4 = coefficients_m(found)
    assert k2 != 0.0
    for row, h in enumerate((1, 2)):
        total = found.phase_rad[row] + np.angle(found.responses[row].main)
        total = total + h * RAD_PER_M * (k2 * rho2 + k4 * rho2**2)
        np.testing.assert_allclose(total, h * (own + RAD_PER_M * 0.05 * rho2), atol=1e-5)
    np.testing.assert_allclose(found.gain, 1.0, rtol=1e-5)
    assert any(text.startswith("40 pixels are saturated, not finite or") for text in found.quality.findings)
    assert not any("could not be used" in text for text in found.quality.findings)


@pytest.mark.parametrize(("dim", "refused"), [(182, False), (183, True)])
def test_a_twentieth_of_the_pixels_must_have_a_signal_from_every_target(dim: int, refused: bool) -> None:
    """There are 192 pixels. Those without a signal get the mean phase and gain."""
    if refused:
        with pytest.raises(SettingsError, match="with a signal from every target, expected 5% or more"):
            noiseless(dim=dim)
        return
    found = noiseless(dim=dim)
    assert (found.phase_rad.reshape(2, -1)[:, pixels_without_light(dim)] == 0.0).all()
    assert (found.gain.reshape(2, -1)[:, pixels_without_light(dim)] == 1.0).all()
    assert any(f"{dim} pixels could not be used" in text for text in found.quality.findings)


@pytest.mark.parametrize(("gap_m", "distinct"), [(0.009, False), (0.012, True)])
def test_distances_a_centimetre_apart_count_as_two(gap_m: float, distinct: bool) -> None:
    found = noiseless(distances_m=(1.0, 1.0 + gap_m))
    assert any(text.startswith("warning: one distance") for text in found.quality.findings) != distinct


@pytest.mark.parametrize("k", [-1, 0, -3, 5, 3])
def test_a_term_of_every_candidate_order_is_found(k: int) -> None:
    value = 0.02 - 0.01j
    found = noiseless(distances_m=(0.4, 0.9, 1.5, 2.2, 2.9, 3.6, 4.4), term=(k, value))
    for one in found.responses:
        assert dict(one.terms)[k] / one.main == pytest.approx(value, abs=1e-4)
        assert all(abs(g / one.main) < 1e-4 for order, g in one.terms if order not in {1, k})
    assert any(text.startswith(f"k = {k:+d}: used, 0.02236 ± ") for text in found.quality.findings)


RAD_PER_M = 2 * np.pi / 40.0 * 2 / 0.299792458

ACROSS, DOWN = np.broadcast_arrays((np.arange(16) - 7.5) / 16, ((np.arange(12) - 5.5) / 16)[:, np.newaxis])
"""Positions in the array, in units of its longer side."""

CHEQUERED = np.where((np.arange(16) // 2 + (np.arange(12) // 2)[:, np.newaxis]) % 2, 1.0, -1.0)
"""Blocks of 2 × 2 pixels with alternating signs: the smallest shape that the fit looks for."""


@pytest.mark.parametrize(
    ("right_m", "down_m", "refused"), [(0.095, 0.0, False), (0.0, -0.105, True), (0.08, 0.07, True)]
)
def test_targets_that_lean_by_more_than_ten_centimetres_are_refused(
    right_m: float, down_m: float, refused: bool
) -> None:
    """The lean is the difference of range over the longer side of the array, which all targets have in common."""
    pixel_phases = RAD_PER_M * (right_m * ACROSS + down_m * DOWN)
    if refused:
        lean = round(1000 * float(np.hypot(right_m, down_m)))
        with pytest.raises(
            SettingsError, match=f"sees the targets {lean} mm nearer than the other, expected 100 mm at most"
        ):
            noiseless(pixel_phases=pixel_phases)
    else:
        assert noiseless(pixel_phases=pixel_phases).phase_rad.std() > 0.01


@pytest.mark.parametrize(("size_m", "refused"), [(0.029, False), (0.032, True)])
def test_targets_with_a_shape_of_more_than_three_centimetres_are_refused(size_m: float, refused: bool) -> None:
    pixel_phases = RAD_PER_M * size_m * CHEQUERED
    if refused:
        with pytest.raises(SettingsError, match="deviate from a flat wall by 32 mm, expected 30 mm at most"):
            noiseless(pixel_phases=pixel_phases)
    else:
        assert noiseless(pixel_phases=pixel_phases).phase_rad.std() > 0.01


@pytest.mark.parametrize(("departure_m", "refused"), [(0.0095, False), (0.0106, True)])
@pytest.mark.parametrize("target", [0, 2])
def test_a_target_that_differs_from_the_others_by_more_than_a_centimetre_is_refused(
    target: int, departure_m: float, refused: bool
) -> None:
    """The mean over the targets, weighted by their powers 1, 1/4 and 1/9, counts as phases of the pixels.

    The rest of the departure stays with the target.
    """
    powers = np.array([1.0, 1 / 4, 1 / 9])
    mean = powers[target] / powers.sum()
    off_m = departure_m / max(mean if target == 0 else 0.0, 1.0 - mean) * CHEQUERED
    if refused:
        worst = 0 if target == 0 and mean < 0.5 else target
        with pytest.raises(
            SettingsError,
            match=rf"^target {worst if target else '[12]'}: .* by 11 mm \(RMS over the array\), expected 10 mm at most",
        ):
            noiseless(off_m=(target, off_m))
    else:
        noiseless(off_m=(target, off_m))


def test_a_lamp_beside_the_camera_is_not_taken_for_a_delay_of_the_pixels() -> None:
    """10 cm to the side make 3 cm of way from one side of the array to the other; the way is computed here in space."""
    offset, sensor = np.array([0.1, 0.0, 0.02]), camera(Defects())
    optics = sensor.metadata.optics
    column, row = optics.principal_point(PIXELS)
    y, x = np.mgrid[: PIXELS[0], : PIXELS[1]]
    on_axis = np.stack([(x - column) / optics.focal_length_px, (y - row) / optics.focal_length_px, np.ones(PIXELS)])
    targets = []
    for seed, distance_m in enumerate((0.5, 1.0, 1.7, 2.4, 3.0)):
        point = distance_m * on_axis
        half_way = 0.5 * (np.linalg.norm(point, axis=0) + np.linalg.norm(point - offset[:, None, None], axis=0))
        targets.append(mean_of(sensor, half_way, distance_m, seed=seed))
    metadata = replace(sensor.metadata, optics=replace(optics, lamp_offset_m=(0.1, 0.0, 0.02)))
    found = fit_response(targets, metadata=metadata, origin=origin_of(targets))
    assert found.lamp_offset_m == (0.1, 0.0, 0.02)
    assert orders(found) == {1}
    assert found.phase_rad.std(axis=(1, 2)) == pytest.approx(found.quality.phase_stderr_rad, rel=0.2)


@pytest.mark.parametrize("size", [(1, 320), (320, 1), (4, 320)])
def test_a_line_of_pixels_is_calibrated_like_an_array(size: tuple[int, int]) -> None:
    """Pixels differ by 5 cm. So their phases rise across four rows by chance, but never by much."""
    sensor = replace(camera(Defects(pixel_phase_rad=0.05)), pixels=size)
    optics = Optics(focal_length_px=280.0)
    sensor = replace(sensor, metadata=replace(sensor.metadata, optics=optics))
    targets = [target(sensor, d, seed=index) for index, d in enumerate((0.5, 1.0, 1.7, 2.4, 3.0))]
    found = fit_response(targets, metadata=sensor.metadata, origin=origin_of(targets, size))
    true = sensor.drawn().phase_rad
    for row in (0, 1):
        off = found.phase_rad[row] - true[row]
        assert off.std() < 2.0 * found.quality.phase_stderr_rad[row]
