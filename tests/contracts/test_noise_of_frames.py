"""The noise of maps follows from the way a frame is stored, and from the number of frames in a mean."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.api.scenes import simulate_scene
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Voltage, Waveform
from cadtof_cli.phasors.frame_mean import FrameMean, frame_mean
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings, Return
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Exposure, expose_band, frame_voltages
from cadtof_cli.simulation.scene.scenes import Card, Wall
from tests.support.forward import AMPLITUDE_V, Light, depth_m

SHAPE = (40, 50)
COUNT_V = 0.002
"""A coarse step: its rounding error, 1/√12 of it or .58 mV, is larger than the noise at n_av 1e5, .43 mV."""

METADATA = CaptureMetadata(pixel=Pixel(integration_length=1e5))


def recorded_v(light: Light, *, n_av: float = 1e5, seed: int = 1) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    return AMPLITUDE_V * light.voltages(rng, n_av, SHAPE[0] * SHAPE[1]).reshape(2, 2, *SHAPE)


def test_sigma_of_counts_includes_their_rounding() -> None:
    metadata = replace(METADATA, voltage=Voltage(zero_counts=200.0, volts_per_count=COUNT_V))
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(order="1")))
    # frames with different delays spread the rounding errors evenly
    delays = np.linspace(4.0, 16.0, 400)
    errors, sigmas = [], []
    for index, delay in enumerate(delays[::20]):
        counts = np.rint(recorded_v(Light(2.0, direct_ns=delay), seed=index) / COUNT_V + 200.0).astype(np.uint16)
        maps = resolve_frame(counts, plan=plan).maps
        errors.append(maps.layer("direct.depth") - depth_m(delay))
        sigmas.append(maps.layer("direct.sigma"))
    scatter = float(np.sqrt(np.mean(np.square(errors))))
    assert np.median(sigmas) == pytest.approx(scatter, rel=0.06)
    exact = resolve_frame(
        recorded_v(Light(2.0)),
        plan=FramePlan(metadata=METADATA, settings=MapSettings(resolver=ResolverSettings(order="1"))),
    )
    assert np.median(sigmas) > 1.4 * np.median(exact.maps.layer("direct.sigma"))


@pytest.mark.parametrize("lengths", [(1e5, 1e4), (1e4, 1e5), (1e5, 1e5, 1e4)])
@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_sigma_and_order_test_are_true_if_each_harmonic_has_a_length_of_its_own(
    lengths: tuple[float, ...], waveform: Waveform
) -> None:
    """With the length of the first harmonic for all, up to 30 % of the pixels got a second path, and sigma was a third."""
    modulation = Modulation(periods_ns=tuple(40.0 / h for h in range(1, len(lengths) + 1)), waveform=waveform)
    metadata = CaptureMetadata(modulation=modulation, pixel=Pixel(integration_length=lengths))
    camera = Camera(width=100, height=80)
    for scene, order, paths in ((Wall(distance_m=2.0, asr=5.0), "auto", 1), (Card(separations_ns=(9.0, 20.0)), "2", 2)):
        shown = Exposure(scene=scene, camera=camera, metadata=replace(metadata, optics=camera.optics), seed=5)
        band = expose_band(shown, slice(0, 80))
        settings = MapSettings(resolver=ResolverSettings(mpi_model="discrete", order=order))
        plan = FramePlan(metadata=shown.metadata, settings=settings)
        maps = resolve_frame(frame_voltages(shown, band, 0), plan=plan).maps
        # the first rows of the card have no MPI
        chosen = np.s_[:] if paths == 1 else np.s_[30:]
        off = (maps.layer("direct.depth") - band.truth["direct.depth"])[chosen] / maps.layer("direct.sigma")[chosen]
        assert np.median(np.abs(off)) == pytest.approx(0.6745, rel=0.06)
        if paths == 1:
            assert np.mean((maps.status & StatusBit.TWO_PATHS) > 0) < 0.015


def test_one_length_for_unequal_harmonics_makes_sigma_wrong_and_an_estimate_makes_errors_larger() -> None:
    camera, lengths = Camera(width=160, height=120), (1e5, 2.5e4)
    metadata = CaptureMetadata(pixel=Pixel(integration_length=lengths), optics=camera.optics)
    shown = Exposure(scene=Wall(distance_m=2.0, asr=5.0), camera=camera, metadata=metadata, seed=5)
    band = expose_band(shown, slice(0, 120))
    volts, errors, within, two = frame_voltages(shown, band, 0), [], [], []
    for length in (lengths, 1e5, None):
        plan = FramePlan(metadata=replace(metadata, pixel=Pixel(integration_length=length)))
        maps = resolve_frame(volts, plan=plan).maps
        off = np.abs(maps.layer("direct.depth") - band.truth["direct.depth"])
        errors.append(np.median(off))
        within.append(np.mean(off < maps.layer("direct.sigma")))
        two.append(np.mean((maps.status & StatusBit.TWO_PATHS) > 0))
    assert within == pytest.approx([0.683, 0.4, 0.61], abs=0.03)
    assert two == pytest.approx([0.005, 0.04, 0.001], abs=0.012)
    assert errors[2] / errors[0] == pytest.approx(1.16, abs=0.06)


def test_if_rounding_hides_all_noise_and_the_length_is_unknown_sigma_is_that_of_rounding() -> None:
    """Neighbours hold the same counts. Estimated from their differences alone, sigma would be 10⁻⁴ of the error."""
    count_v = 0.01
    metadata = CaptureMetadata(voltage=Voltage(zero_counts=200.0, volts_per_count=count_v))
    plan = FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(order="1")))
    errors, sigmas = [], []
    for delay in np.linspace(4.0, 16.0, 60):
        left, right = (recorded_v(Light(2.0, direct_ns=each), n_av=1e6) for each in (delay, 20.0))
        volts = np.concatenate([left[..., :25], right[..., 25:]], axis=-1)
        maps = resolve_frame(np.rint(volts / count_v + 200.0).astype(np.uint16), plan=plan).maps
        errors.append((maps.layer("direct.depth") - depth_m(delay))[:, :25])
        sigmas.append(maps.layer("direct.sigma")[:, :25])
    assert np.median(sigmas) == pytest.approx(float(np.sqrt(np.mean(np.square(errors)))), rel=0.3)


@pytest.mark.parametrize("asr", [0.1, 1.0, 5.0])
@pytest.mark.parametrize(
    ("count_v", "frames"),
    [(0.0004, 1), (0.0006, 1), (0.00085, 1), (0.0015, 1), (0.004, 1), (0.0004, 9), (0.0006, 9), (0.00085, 9)],
)
def test_an_estimated_sigma_is_true_if_counts_are_as_coarse_as_the_noise(
    count_v: float, asr: float, frames: int
) -> None:
    """Differences of neighbours are a few half counts then, and so is their median.

    Sigma was .3 to 1.6 of the scatter before, and up to 35 % of these pixels without MPI got two paths.
    """
    metadata = CaptureMetadata(voltage=Voltage(zero_counts=2048.0, volts_per_count=count_v))
    plan = FramePlan(metadata=metadata, settings=MapSettings(average=frames))
    delays = np.linspace(4.0, 12.0, 60)[:, np.newaxis] + np.linspace(0.0, 2.0, 80)
    rng = np.random.default_rng(5)
    counts = np.zeros((2, 2, *delays.shape))
    for _ in range(frames):
        counts += np.rint(ramp_v(rng, delays, asr) / count_v + 2048.0) / frames
    whole = np.dtype(np.uint16)
    frame = FrameMean(counts, np.full(delays.shape, float(frames)), whole) if frames > 1 else counts.astype(whole)
    maps = resolve_frame(frame, plan=plan).maps
    one = (maps.status & StatusBit.ONE_PATH) > 0
    assert one.mean() > 0.975
    off = np.abs(maps.layer("direct.depth") - depth_m(1.0) * delays) / maps.layer("direct.sigma")
    assert 0.56 < (off[one] < 1.0).mean() < 0.8


@pytest.mark.parametrize("asr", [2.0, 5.0])
@pytest.mark.parametrize("count_v", [0.0004, 0.0021, 0.004])
def test_sigma_of_a_mean_of_frames_includes_the_rounding_that_is_the_same_in_all(count_v: float, asr: float) -> None:
    """With 4 mV per count, it is ten times the noise. Sigma was .3 of the scatter, with a third of false second paths."""
    metadata = replace(METADATA, voltage=Voltage(zero_counts=200.0, volts_per_count=count_v))
    plan = FramePlan(metadata=metadata, settings=MapSettings(average=16))
    delays = np.linspace(4.0, 12.0, 60)[:, np.newaxis] + np.linspace(0.0, 2.0, 80)
    rng = np.random.default_rng(6)
    counts = np.mean([np.rint(ramp_v(rng, delays, asr) / count_v + 200.0) for _ in range(16)], axis=0)
    maps = resolve_frame(FrameMean(counts, np.full(delays.shape, 16.0), np.dtype(np.uint16)), plan=plan).maps
    one = (maps.status & StatusBit.ONE_PATH) > 0
    assert one.mean() > 0.98
    off = np.abs(maps.layer("direct.depth") - depth_m(1.0) * delays) / maps.layer("direct.sigma")
    assert 0.56 < (off[one] < 1.0).mean() < 0.8


@pytest.mark.parametrize("asr", [0.1, 0.3, 1.0, 5.0])
def test_if_the_noise_is_the_cameras_own_an_estimated_sigma_of_one_path_is_at_most_a_fifth_too_small(
    asr: float,
) -> None:
    """The noise of a camera is white. That of photons is smaller across the phasor, where depth lies."""
    delays = np.linspace(4.0, 12.0, 60)[:, np.newaxis] + np.linspace(0.0, 2.0, 80)
    rng = np.random.default_rng(7)
    volts = ramp_v(rng, delays, asr)
    volts += rng.normal(0.0, 0.004, volts.shape)
    plan = FramePlan(metadata=CaptureMetadata(), settings=MapSettings(resolver=ResolverSettings(order="1")))
    maps = resolve_frame(volts, plan=plan).maps
    off = (maps.layer("direct.depth") - depth_m(1.0) * delays) / maps.layer("direct.sigma")
    assert 0.9 < 1.4826 * np.median(np.abs(off)) < 1.25


def ramp_v(
    rng: np.random.Generator, delays_ns: NDArray[np.float64], asr: float | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the voltages of one path at each of these delays, (2, 2, Y, X), at n_av 1e5."""
    share = 1.0 / (1.0 + asr)
    planes = []
    for h in (1, 2):
        near, twice = (
            share * np.exp(2j * np.pi * k * delays_ns / 40.0 - (2 * np.pi * k * 1.7 / 2.3548 / 40.0) ** 2 / 2)
            for k in (h, 2 * h)
        )
        turn = np.exp(2j * np.pi * h * delays_ns / 40.0)
        along, across = (
            np.sqrt((0.5 + sign * 0.5 * np.abs(twice) - (np.abs(near) ** 2 if sign > 0 else 0.0)) / (2e5 - 1.0))
            for sign in (1, -1)
        )
        noise = along * rng.normal(size=delays_ns.shape) + 1j * across * rng.normal(size=delays_ns.shape)
        volts = AMPLITUDE_V * (near + turn * noise)
        planes.append([volts.real, volts.imag])
    return np.array(planes)


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
@pytest.mark.parametrize("order", ["auto", "1", "2"])
def test_a_mean_of_frames_is_resolved_as_a_frame_of_as_many_times_the_length(waveform: Waveform, order: str) -> None:
    """A mean of 9 frames has the noise 1/(9·(2 n_av − 1)) in the order test, in the screening and in sigma."""
    longer = 0.5 * (9 * (2 * 1e4 - 1) + 1)
    left, right = recorded_v(Light(2.0), n_av=longer), recorded_v(Light(2.0, 0.1), n_av=longer, seed=2)
    # in the middle, MPI so weak that the order test finds it in a part of the pixels
    between = recorded_v(Light(2.0, 0.035), n_av=longer, seed=3)
    volts = np.concatenate([left[..., :15], between[..., 15:25], right[..., 25:]], axis=3)
    # at the top, no signal; then a signal that the noise of one frame would hide
    volts[:, :, :3] *= 0.01
    volts[:, :, 3:6] *= 0.025
    maps = {}
    for name, n_av, frame in (
        ("mean", 1e4, FrameMean(volts, np.full(SHAPE, 9.0), volts.dtype)),
        ("long", longer, volts),
    ):
        metadata = replace(METADATA, modulation=Modulation(waveform=waveform), pixel=Pixel(integration_length=n_av))
        plan = FramePlan(
            metadata=metadata,
            settings=MapSettings(resolver=ResolverSettings(mpi_model="discrete", order=order), average=9),
        )
        maps[name] = resolve_frame(frame, plan=plan).maps
    mean, long = maps["mean"], maps["long"]
    assert ((mean.status & StatusBit.POOLED) > 0).all()
    answer = np.uint32(StatusBit.ONE_PATH | StatusBit.TWO_PATHS | StatusBit.LOW_CONFIDENCE)
    assert ((mean.status & answer) == (long.status & answer)).mean() > 0.995
    assert ((long.status & StatusBit.LOW_CONFIDENCE) > 0).mean() > 0.05
    if (order, waveform) == ("auto", "sine"):
        assert 0.1 < ((long.status & StatusBit.TWO_PATHS) > 0)[6:, 15:25].mean() < 0.9
    names = ("direct.depth", "direct.sigma") if order == "1" else ("direct.depth", "direct.sigma", "mpi.sigma")
    for name in names:
        np.testing.assert_allclose(np.nanmedian(mean.layer(name) / long.layer(name)), 1.0, rtol=1e-4)
    np.testing.assert_array_equal(mean.layer("effective_pixels"), 9.0)


def test_an_estimated_integration_length_is_that_of_one_frame_of_a_mean() -> None:
    """The estimate comes from the mean, which has the noise of a frame of 9 times the length."""
    volts = recorded_v(Light(2.0), n_av=9e4)
    plan = FramePlan(metadata=CaptureMetadata(), settings=MapSettings(resolver=ResolverSettings(order="1"), average=9))
    resolved = resolve_frame(FrameMean(volts, np.full(SHAPE, 9.0), volts.dtype), plan=plan)
    assert resolved.noise.estimated
    assert resolved.noise.integration_length == pytest.approx(1e4, rel=0.1)
    scatter = (resolved.maps.layer("direct.depth") - depth_m(5.0)).std()
    assert np.median(resolved.maps.layer("direct.sigma")) == pytest.approx(scatter, rel=0.1)


@pytest.mark.parametrize("shape", [(60, 80), (1, 4800)])
@pytest.mark.parametrize("often", [0.2, 0.5])
def test_the_length_is_estimated_correctly_if_pixels_are_sound_in_different_numbers_of_frames(
    often: float, shape: tuple[int, int]
) -> None:
    """As where the sun saturates a part of the view in most frames. The error was up to a factor of 1.7."""
    delays = np.linspace(8.0, 12.0, 4800).reshape(shape)
    rng = np.random.default_rng(8)
    frames = [ramp_v(rng, delays, 3.0) for _ in range(16)]
    for frame in frames[1:]:
        frame.reshape(2, 2, -1)[:, :, int(often * delays.size) :] = np.nan
    plan = FramePlan(metadata=CaptureMetadata(), settings=MapSettings(resolver=ResolverSettings(order="1"), average=16))
    resolved = resolve_frame(frame_mean(frames, saturated_counts=None), plan=plan)
    assert resolved.noise.integration_length == pytest.approx(1e5, rel=0.12)


@pytest.mark.parametrize(
    ("frames", "known", "low", "high", "second"),
    [(1, True, 1.15, 1.3, 0.1), (8, True, 1.8, 2.2, 0.35), (1, False, 1.35, 1.55, 0.2)],
)
def test_sigma_of_pooled_counts_leaves_out_the_rounding_that_neighbours_share(
    frames: int, known: bool, low: float, high: float, second: float
) -> None:
    """docs/physics.md says so. A count of 2.2 mV is five times the noise, as with 8 bits."""
    delays = 13.3 + 0.0133 * np.arange(160) + 0.0067 * np.arange(120)[:, np.newaxis]
    rng = np.random.default_rng(9)
    counts = [np.rint(ramp_v(rng, delays, 2.0) / 2.2e-3 + 128.0).astype(np.uint16) for _ in range(frames)]
    metadata = replace(
        METADATA if known else CaptureMetadata(), voltage=Voltage(zero_counts=128.0, volts_per_count=2.2e-3)
    )
    settings = MapSettings(resolver=ResolverSettings(mpi_model="discrete"), pool=5, average=frames)
    frame = frame_mean(counts, saturated_counts=None) if frames > 1 else counts[0]
    maps = resolve_frame(frame, plan=FramePlan(metadata=metadata, settings=settings)).maps
    off = (maps.layer("direct.depth") - depth_m(1.0) * delays) / maps.layer("direct.sigma")
    assert low < np.sqrt(np.mean(np.square(off))) < high
    assert 0.01 < ((maps.status & StatusBit.TWO_PATHS) > 0).mean() < second


@pytest.mark.parametrize(("strength", "answered", "over"), [(2.0, 0.35, 1.25), (3.0, 0.82, 1.07), (4.0, 0.99, 1.02)])
def test_errors_of_faint_pixels_are_more_than_sigma(strength: float, answered: float, over: float) -> None:
    """Only those have an answer that noise has made brighter. docs/physics.md gives these numbers."""
    n_av = 1e4
    light = Light(2.0 * np.sqrt(n_av) / strength - 1.0)
    volts = AMPLITUDE_V * light.voltages(np.random.default_rng(10), n_av, 40_000).reshape(2, 2, 200, 200)
    plan = FramePlan(
        metadata=replace(METADATA, pixel=Pixel(integration_length=n_av)),
        settings=MapSettings(resolver=ResolverSettings(mpi_model="discrete")),
    )
    maps = resolve_frame(volts, plan=plan).maps
    depth, turn = maps.layer("direct.depth"), depth_m(40.0)
    known = np.isfinite(depth)
    assert known.mean() == pytest.approx(answered, abs=0.02)
    off = (depth - depth_m(5.0) + turn / 2) % turn - turn / 2
    assert np.median(np.abs(off / maps.layer("direct.sigma"))[known]) / 0.6745 == pytest.approx(over, abs=0.04)


@pytest.mark.parametrize(("returns", "low", "high"), [("first", 5.0, 9.0), ("strongest", 0.97, 1.07)])
def test_false_second_paths_in_faint_light_are_first_returns_unless_the_strongest_is_asked_for(
    returns: Return, low: float, high: float
) -> None:
    """docs/limits/false_alarm.md says so. The noise of a channel is a twentieth of the amplitude."""
    light = Light(2.0 * np.sqrt(1e5) / 20.0 - 1.0, direct_ns=20.0)
    volts = AMPLITUDE_V * light.voltages(np.random.default_rng(12), 1e5, 90_000).reshape(2, 2, 300, 300)
    settings = MapSettings(resolver=ResolverSettings(mpi_model="discrete", returns=returns))
    maps = resolve_frame(volts, plan=FramePlan(metadata=METADATA, settings=settings)).maps
    sigma = np.median(maps.layer("direct.sigma"))
    off = maps.layer("direct.depth") - depth_m(20.0)
    assert low < np.sqrt(np.mean(np.square(off))) / sigma < high
    assert np.median(np.abs(off)) / sigma == pytest.approx(0.6745, rel=0.03)


@pytest.mark.parametrize(("left", "right"), [(0.1, 5.0), (0.0, 2.0), (0.5, 5.0)])
def test_an_estimated_sigma_is_true_if_a_part_of_the_view_has_far_less_ambient_light(left: float, right: float) -> None:
    """Its noise is smaller. Errors were up to 2.3 × sigma."""
    delays = np.linspace(8.0, 12.0, 120)[:, np.newaxis] + np.linspace(0.0, 1.0, 80)
    rng = np.random.default_rng(13)
    volts = np.concatenate([ramp_v(rng, delays, left), ramp_v(rng, delays, right)], axis=-1)
    plan = FramePlan(metadata=CaptureMetadata(), settings=MapSettings(resolver=ResolverSettings(order="1")))
    maps = resolve_frame(volts, plan=plan).maps
    off = (maps.layer("direct.depth") - depth_m(1.0) * np.hstack([delays, delays])) / maps.layer("direct.sigma")
    assert 1.4826 * np.median(np.abs(off)) == pytest.approx(1.0, abs=0.16)


def test_an_estimate_takes_light_that_differs_from_pixel_to_pixel_for_noise() -> None:
    """docs/physics.md says so: 10 % of ambient light make sigma eight times too large."""
    delays = np.linspace(8.0, 12.0, 120)[:, np.newaxis] + np.linspace(0.0, 1.0, 160)
    rng = np.random.default_rng(14)
    volts = ramp_v(rng, delays, 3.0 * np.exp(rng.normal(0.0, 0.1, delays.shape)))
    plan = FramePlan(metadata=CaptureMetadata(), settings=MapSettings(resolver=ResolverSettings(order="1")))
    maps = resolve_frame(volts, plan=plan).maps
    off = (maps.layer("direct.depth") - depth_m(1.0) * delays) / maps.layer("direct.sigma")
    assert 1.4826 * np.median(np.abs(off)) == pytest.approx(1.0 / 8.0, rel=0.15)


@pytest.mark.parametrize(
    ("waveform", "asr", "within"),
    [("sine", 0.0, 0.25), ("sine", 0.03, 0.1), ("sine", 0.3, 0.1), ("triangle", 0.3, 0.1), ("sine", 5.0, 0.1)],
)
def test_the_length_is_estimated_correctly_with_little_ambient_light_too(
    waveform: Waveform, asr: float, within: float
) -> None:
    """The variance without ambient light is that of the pulse's length, less than a twentieth of that with much."""
    wall = simulate_scene(
        "wall", integration_length=1e4, modulation={"waveform": waveform}, camera={"width": 160, "height": 120}, asr=asr
    )
    (frame,) = wall.frames
    plan = FramePlan(
        metadata=replace(frame.metadata, pixel=Pixel()), settings=MapSettings(resolver=ResolverSettings(order="1"))
    )
    assert resolve_frame(frame.stored, plan=plan).noise.integration_length == pytest.approx(1e4, rel=within)


def test_a_mean_of_noise_alone_still_has_an_integration_length() -> None:
    """Noise as large as the modulation means that nothing was averaged: n_av is 1 for the mean.

    A ninth of that would be no integration length.
    """
    volts = np.random.default_rng(1).normal(0.0, AMPLITUDE_V, (2, 2, *SHAPE))
    plan = FramePlan(metadata=CaptureMetadata(), settings=MapSettings(average=9))
    resolved = resolve_frame(FrameMean(volts, np.full(SHAPE, 9.0), volts.dtype), plan=plan)
    assert 0.5 < resolved.noise.integration_length < 1.0


def test_order_1_gives_the_most_likely_path_of_light_of_two() -> None:
    """It has the phase x with the largest w1·Re(p1·exp(−ix)) + w2·Re(p2·exp(−2ix)), even if one path fits badly."""
    lights = [Light(0.5, 0.8, 5.0, second) for second in np.linspace(7.0, 18.0, 16)]
    means = np.array([[light.moment(h) for light in lights] for h in (1, 2)])
    volts = AMPLITUDE_V * np.stack([means.real, means.imag], axis=1).reshape(2, 2, 4, 4)
    plan = FramePlan(
        metadata=METADATA, settings=MapSettings(resolver=ResolverSettings(order="1", mpi_model="discrete"))
    )
    found_m = resolve_frame(volts, plan=plan).maps.layer("direct.depth").ravel()
    pulse = np.array([float(abs(Light(0.0).moment(h))) for h in (1, 2)])
    p, weights = means / pulse[:, np.newaxis], pulse**2
    phase = np.linspace(0.0, 2.0 * np.pi, 200_001)[:, np.newaxis]
    gain = sum(weights[row] * (p[row] * np.exp(-1j * (row + 1) * phase)).real for row in range(2))
    best_m = phase[gain.argmax(axis=0), 0] * depth_m(40.0) / (2.0 * np.pi)
    np.testing.assert_allclose(found_m, best_m, atol=2e-4)


@pytest.mark.parametrize("separation_ns", [1.8, 2.1, 2.4])
def test_two_paths_are_ill_conditioned_where_a_sigma_exceeds_half_their_separation(separation_ns: float) -> None:
    """The separation counts as the sine of half of it, as a phase. All numbers come from the maps themselves."""
    plan = FramePlan(
        metadata=METADATA, settings=MapSettings(resolver=ResolverSettings(order="2", mpi_model="discrete"))
    )
    maps = resolve_frame(recorded_v(Light(0.5, 0.4, 5.0, 5.0 + separation_ns)), plan=plan).maps
    rad_per_m = 2.0 * np.pi / depth_m(40.0)
    apart = rad_per_m * np.abs(maps.layer("mpi.depth") - maps.layer("direct.depth"))
    sigma = rad_per_m * np.fmax(maps.layer("direct.sigma"), maps.layer("mpi.sigma"))
    ratio = sigma / (0.5 * np.sin(0.5 * apart))
    known = np.isfinite(ratio) & (np.abs(ratio - 1.0) > 1e-3)
    assert known.mean() > 0.9
    assert ((ratio > 0.7) & (ratio < 2.0))[known].mean() > 0.2
    np.testing.assert_array_equal(((maps.status & StatusBit.ILL_CONDITIONED) > 0)[known], (ratio > 1.0)[known])


@pytest.mark.parametrize(("mpi", "direct_ns"), [(0.45, 34.0), (0.55, 6.0)])
def test_a_path_more_than_half_a_turn_ahead_is_an_echo_below_half_the_amplitude(mpi: float, direct_ns: float) -> None:
    """Light that comes 12 ns after 34 ns appears at 6 ns, 28 ns ahead of it."""
    plan = FramePlan(
        metadata=replace(METADATA, pixel=Pixel(integration_length=1e7)),
        settings=MapSettings(resolver=ResolverSettings(order="2", mpi_model="discrete")),
    )
    depth = resolve_frame(recorded_v(Light(2.0, mpi, 34.0, 46.0), n_av=1e7), plan=plan).maps.layer("direct.depth")
    assert np.nanmedian(np.abs(depth - depth_m(direct_ns))) < 0.01


def test_a_second_path_is_found_as_often_where_delays_wrap() -> None:
    """The second path comes 4 ns after the direct path, with a twentieth of its light.

    The direct path is in the middle, just before the end, or just after the beginning of the unambiguous range.
    """
    plan = FramePlan(metadata=METADATA, settings=MapSettings(resolver=ResolverSettings(mpi_model="discrete")))
    shares = []
    for direct_ns in (5.0, 39.9, 0.05):
        maps = resolve_frame(recorded_v(Light(2.0, 0.05, direct_ns, direct_ns + 4.0)), plan=plan).maps
        shares.append(float(((maps.status & StatusBit.TWO_PATHS) > 0).mean()))
    assert 0.05 < shares[0] < 0.25
    assert shares == pytest.approx([shares[0]] * 3, abs=0.05)
