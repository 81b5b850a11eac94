"""Pooling of frames of known light reduces noise, keeps edges sharp, and never uses unusable pixels."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.pooling import PooledPhasors, SharedNoise, pooled_phasors, pooling_seconds, shared_noise
from cadtof_cli.resolver.paths import ResolvedPaths
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.mixtures import C, F, Mixture, noise_of

B = NDArray[np.bool_]

HARMONICS = (1, 2)
N_AV = 1e5
HEIGHT, WIDTH = 30, 40
M_PER_RAD = 0.299792458 * 40.0 / (4 * np.pi)

ROUNDING = 5e-7
"""Relative rounding error of sums of some float32 values."""


def frame(*bands: Mixture, seed: int = 1) -> C:
    """Return noisy phasors, (2, Y, X), of upright bands of equal width, one for each mixture."""
    rng = np.random.default_rng(seed)
    width = WIDTH // len(bands)
    parts = [band.phasors(HARMONICS, n_av=N_AV, size=HEIGHT * width, rng=rng) for band in bands]
    return np.concatenate([part.reshape(2, HEIGHT, width) for part in parts], axis=2)


def pool(phasors: C, *, window: int = 5, usable: bool | np.ndarray = True, samples: F | None = None) -> PooledPhasors:
    shape = phasors.shape[1:]
    return pooled_phasors(
        phasors,
        usable=np.broadcast_to(np.asarray(usable), shape),
        samples=np.ones(shape) if samples is None else samples,
        noise=noise_of(HARMONICS, n_av=N_AV),
        window=window,
    )


def resolve(pooled: PooledPhasors) -> ResolvedPaths:
    return resolve_paths(
        pooled.phasors.reshape(2, -1),
        status=np.zeros(HEIGHT * WIDTH, np.uint32),
        settings=ResolverSettings(),
        noise=replace(noise_of(HARMONICS, n_av=N_AV), samples=pooled.samples.ravel()),
    )


@pytest.mark.parametrize("window", [3, 5])
def test_pooling_uniform_light_reduces_its_noise_by_the_number_of_pixels(window: int) -> None:
    light = Mixture((1.0, 0.3), (5.0, 16.0), asr=2.0)
    phasors = frame(light)
    before = phasors.copy()
    pooled = pool(phasors, window=window)
    np.testing.assert_array_equal(phasors, before)
    inside = (slice(window, -window), slice(window, -window))
    assert pooled.samples[inside].mean() == pytest.approx(window**2, rel=0.02)
    assert pooled.samples[0, 0] == 1.0
    assert pooled.samples[0, WIDTH // 2] <= window
    found = resolve(pooled)
    depth = found.paths[0].phase_rad.reshape(HEIGHT, WIDTH)[inside]
    alone = light.bound_ns(HARMONICS, N_AV)[0] * 2 * np.pi / 40.0
    assert depth.std() < 1.25 * alone / window
    assert np.median(found.paths[0].sigma_rad) == pytest.approx(alone / window, rel=0.1)
    assert ((found.status & StatusBit.POOLED) > 0).reshape(HEIGHT, WIDTH)[inside].all()


def test_a_step_of_30_cm_stays_sharp() -> None:
    near = Mixture((1.0, 0.3), (8.0, 16.0), asr=2.0)
    far = Mixture((1.0, 0.3), (8.0 + 2 * 0.3 / 0.299792458, 18.0), asr=2.0)
    depth = M_PER_RAD * resolve(pool(frame(near, far))).paths[0].phase_rad.reshape(HEIGHT, WIDTH)
    truth = M_PER_RAD * np.where(np.arange(WIDTH) < WIDTH // 2, near.phases[0], far.phases[0])
    edge = slice(WIDTH // 2 - 3, WIDTH // 2 + 3)
    assert np.abs(depth - truth)[:, edge].max() < 0.03


def test_unusable_pixels_neither_change_others_nor_are_changed() -> None:
    light = Mixture((1.0, 0.3), (5.0, 16.0), asr=2.0)
    phasors = frame(light)
    usable = np.random.default_rng(2).uniform(size=(HEIGHT, WIDTH)) > 0.2
    clean = pool(phasors, usable=usable)
    for poison in (np.nan, np.inf, 1e6, light.phasor(1)):
        spoilt = phasors.copy()
        spoilt[:, ~usable] = poison
        pooled = pool(spoilt, usable=usable)
        np.testing.assert_array_equal(pooled.phasors[:, usable], clean.phasors[:, usable])
        np.testing.assert_array_equal(pooled.samples, clean.samples)
        np.testing.assert_array_equal(pooled.phasors[:, ~usable], spoilt[:, ~usable])
    np.testing.assert_array_equal(clean.samples[~usable], 1.0)


@pytest.mark.parametrize("huge", [1e17, 1e36, 1e150, 1e308])
def test_a_pixel_of_any_size_takes_no_answer_from_its_neighbours(huge: float) -> None:
    """Memory that was never written may hold any float; float32 cannot hold all of them, or their squares."""
    phasors = np.full((2, 9, 9), 0.2 + 0.1j)
    phasors[0, 4, 4] = complex(huge, huge)
    pooled = pool(phasors, window=5)
    phasors[0, 4, 4] = np.nan
    expected = pool(phasors, window=5, usable=np.isfinite(phasors).all(axis=0))
    others = np.isfinite(phasors).all(axis=0)
    assert (pooled.phasors[:, others] == expected.phasors[:, others]).all()
    assert (pooled.samples == expected.samples).all()


def test_pixels_unlike_their_neighbours_stay_alone() -> None:
    phasors = frame(Mixture((1.0,), (5.0,), asr=2.0))
    phasors[:, 10, 10] = Mixture((1.0,), (15.0,), asr=2.0).exact(HARMONICS)[:, 0]
    pooled = pool(phasors)
    assert pooled.samples[10, 10] == 1.0
    np.testing.assert_allclose(pooled.phasors[:, 10, 10], phasors[:, 10, 10], rtol=ROUNDING)


def test_pixels_that_are_means_already_count_with_their_number_of_samples() -> None:
    phasors = frame(Mixture((1.0, 0.3), (5.0, 16.0), asr=2.0))
    once, fourfold = pool(phasors), pool(phasors, samples=np.full((HEIGHT, WIDTH), 4.0))
    assert fourfold.samples.max() > 60.0
    assert fourfold.samples.mean() < 4.0 * once.samples.mean()  # half the noise is assumed, so fewer pixels are alike


def rows_of_three(samples: list[float], *, count: int = 30_000, seed: int = 4) -> tuple[C, B, F]:
    """Return many rows of three pixels with the same light: noisy phasors, (2, 2·count, 3), `usable` and `samples`.

    The three pixels are means of the given numbers of recorded pixels. Every second row is unusable, so that no pixel
    has neighbours above or below.
    """
    rng = np.random.default_rng(seed)
    given = np.tile([samples, [1.0, 1.0, 1.0]], (count, 1))
    spread = np.sqrt([harmonic.dark_variance for harmonic in noise_of(HARMONICS, n_av=N_AV).each])
    shape = (2, *given.shape)
    noise: C = (rng.normal(size=shape) + 1j * rng.normal(size=shape)) * spread[:, np.newaxis, np.newaxis]
    usable = np.tile([[True] * 3, [False] * 3], (count, 1))
    return 0.2 + noise / np.sqrt(given), usable, given


@pytest.mark.parametrize(
    "samples", [[1.0, 1.0, 1.0], [4.0, 4.0, 4.0], [1.0, 100.0, 1.0], [1.0, 100.0, 4.0], [2.0, 1.0, 50.0]]
)
def test_of_pairs_with_the_same_light_noise_keeps_out_a_thousandth(samples: list[float]) -> None:
    """The mean of the pair is compared with the pixel between them by the noise of all three.

    This noise depends on the number of recorded pixels that each is a mean of.
    """
    phasors, usable, given = rows_of_three(samples)
    pooled = pool(phasors, window=3, usable=usable, samples=given)
    found = pooled.samples[::2]
    np.testing.assert_array_equal(found[:, [0, 2]], given[::2, [0, 2]])
    alone = found[:, 1] == samples[1]
    assert alone.mean() == pytest.approx(1e-3, abs=4 * np.sqrt(1e-3 / len(found)))
    # both of a pair count with the smaller number of pixels, so that a slope cancels
    fewer = min(samples[0], samples[2])
    assert (found[~alone, 1] == samples[1] + 2 * fewer).all()
    expected = (phasors[:, ::2] * [fewer, samples[1], fewer]).sum(axis=2) / (samples[1] + 2 * fewer)
    np.testing.assert_allclose(pooled.phasors[:, ::2, 1][:, ~alone], expected[:, ~alone], rtol=ROUNDING)


def slanted(slope: float, *, seed: int) -> tuple[C, F, float]:
    """Return noisy phasors, (2, Y, X), of one path whose phase grows across the frame; that phase, and its noise, in rad.

    `slope` is the change of the phase per pixel, over its noise.
    """
    noise, rng = noise_of(HARMONICS, n_av=N_AV), np.random.default_rng(seed)
    sigma_rad = float(np.sqrt(noise.each[0].dark_variance)) / 0.2
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    phase_rad = slope * sigma_rad * (x - 0.4 * y)
    spread = np.sqrt([harmonic.dark_variance for harmonic in noise.each])[:, np.newaxis, np.newaxis]
    shape = (2, HEIGHT, WIDTH)
    scatter: C = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    return 0.2 * np.exp(1j * np.stack([phase_rad, 2 * phase_rad])) + spread * scatter, phase_rad, sigma_rad


@pytest.mark.parametrize(("slope", "window"), [(0.5, 3), (0.5, 5), (0.5, 7), (0.8, 5), (1.0, 3), (1.5, 3)])
def test_a_slanted_surface_is_pooled_like_one_that_faces_the_camera(slope: float, window: int) -> None:
    """Only noise is left, although neighbours differ by much more than their noise."""
    phasors, phase_rad, sigma_rad = slanted(slope, seed=window)
    pooled = pool(phasors, window=window)
    inside = (slice(window, -window), slice(window, -window))
    assert pooled.samples[inside].mean() == pytest.approx(window**2, rel=0.03)
    error = np.angle(pooled.phasors[0] * np.exp(-1j * phase_rad))[inside]
    assert np.sqrt((error**2).mean()) == pytest.approx(sigma_rad / window, rel=0.15)


@pytest.mark.parametrize("slope", [3.0, 6.0, 12.0, 16.0])
def test_pooling_a_steep_slope_does_not_shorten_its_phasors(slope: float) -> None:
    """Means of phasors with different phases are shorter, most at the second harmonic, which would look like MPI.

    Pooling may shorten them by at most a tenth of the noise.
    """
    phasors, _, sigma_rad = slanted(slope, seed=2)
    pooled = pool(phasors, window=7)
    inside = (slice(7, -7), slice(7, -7))
    assert 1.0 < pooled.samples[inside].mean() < 40.0
    shortening = 1.0 - np.abs(pooled.phasors[:, *inside]).mean(axis=(1, 2)) / 0.2
    assert (shortening < 0.11 * sigma_rad).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (3, 2)])
def test_a_frame_smaller_than_the_window_is_pooled_over_the_pixels_that_it_has(shape: tuple[int, int]) -> None:
    phasors = np.broadcast_to(Mixture((1.0,), (5.0,)).exact(HARMONICS)[:, :, np.newaxis], (2, *shape))
    pooled = pool(phasors)
    np.testing.assert_allclose(pooled.phasors, phasors, rtol=ROUNDING)
    # only neighbours that have another neighbour on the opposite side count
    assert pooled.samples.max() == np.prod([min(extent - (extent + 1) % 2, 5) for extent in shape])


@pytest.mark.parametrize(("window", "steps"), [(3, 8), (5, 24), (9, 80)])
def test_the_expected_time_grows_with_the_number_of_neighbours(
    window: int, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is a step per neighbour, over the pixels that have this neighbour. A 3 × 3 window has eight; they take 8 s."""
    clock = iter([100.0, 108.0])
    monkeypatch.setattr("cadtof_cli.phasors.pooling.time.perf_counter", lambda: next(clock))
    found = pooling_seconds((200, 400), noise_of((1, 2), n_av=1e5), window=window)
    reach = window // 2
    moved = np.abs(np.arange(-reach, reach + 1))
    pixels = np.outer(200 - moved, 400 - moved).sum() / (200 * 400) - 1.0
    assert found == pytest.approx(pixels, rel=0.02)
    assert found == pytest.approx(steps, rel=0.1)


def test_no_time_is_needed_for_no_pixels_or_no_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """This is known without pooling any pixel."""
    noise = noise_of((1, 2), n_av=1e5)
    monkeypatch.setattr("cadtof_cli.phasors.pooling.pooled_phasors", None)
    assert pooling_seconds((200, 400), noise, window=1) == 0.0
    assert pooling_seconds((0, 400), noise, window=3) == 0.0


@pytest.mark.parametrize(("farther", "pooled"), [(0.57, True), (0.59, False)])
def test_the_second_pass_compares_a_pair_with_the_mean_of_the_first_pass(farther: float, pooled: bool) -> None:
    """In a row of five pixels, the outer pair is too far from the middle pixel, but near the mean of the inner three.

    The squared distance of the pair's mean may be 1 + 1/2 units from the pixel, and 1/3 + 1/2 units from the mean of
    three. The unit is the largest misfit that noise explains.
    """
    noise = noise_of(HARMONICS, n_av=N_AV)
    sigma = np.sqrt(noise.each[0].dark_variance) * np.sqrt(stats.chi2.isf(1e-3, 4))
    row: C = np.full((2, 1, 5), 0.2 + 0.1j)
    row[0, 0] += sigma * np.array([-farther, 0.0, 1.0, 0.0, -farther])
    found = pool(row, window=5)
    assert found.samples[0, 2] == (5.0 if pooled else 3.0)
    assert found.phasors[0, 0, 2] == pytest.approx(row[0, 0].mean() if pooled else row[0, 0, 1:4].mean())


def pooled_by_definition(phasors: C, usable: B, samples: F, window: int) -> tuple[C, F]:
    """Pool pixel by pixel, straight from the definition.

    A pair counts if its mean differs by no more than noise: first from the pixel, then from the mean of the first pass.
    """
    variance = np.array([harmonic.dark_variance for harmonic in noise_of(HARMONICS, n_av=N_AV).each])
    most, reach = stats.chi2.isf(1e-3, 4), range(-(window // 2), window // 2 + 1)
    mean, count = phasors.copy(), samples.copy()
    frame = {(int(y), int(x)) for y, x in np.argwhere(usable)}
    for y, x in frame:
        pairs = [((y + dy, x + dx), (y - dy, x - dx)) for dy in reach for dx in reach if (dy, dx) > (0, 0)]
        reference, of_reference = phasors[:, y, x], samples[y, x]
        for _ in range(2):
            total, counted = phasors[:, y, x] * samples[y, x], samples[y, x]
            for one, other in pairs:
                if not {one, other} <= frame:
                    continue
                both = phasors[:, *one] + phasors[:, *other]
                missed = (np.abs(0.5 * both - reference) ** 2 / variance).sum()
                if missed <= most * (0.25 / samples[one] + 0.25 / samples[other] + 1.0 / of_reference):
                    weight = min(samples[one], samples[other])
                    total, counted = total + weight * both, counted + 2.0 * weight
            reference, of_reference = total / counted, counted
        mean[:, y, x], count[y, x] = reference, of_reference
    return mean, count


@pytest.mark.parametrize("window", [3, 5])
def test_a_frame_is_pooled_by_definition_in_blocks_of_any_number_of_rows(
    window: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The frame has edges, slopes, bad pixels and means. Blocks of one row up to all rows give the same bits."""
    phasors = frame(Mixture((1.0, 0.3), (5.0, 16.0), asr=2.0), Mixture((1.0,), (5.3,), asr=3.0), seed=8)
    phasors *= np.exp(2e-3j * np.arange(HEIGHT))[:, np.newaxis]
    rng = np.random.default_rng(9)
    usable, samples = rng.random((HEIGHT, WIDTH)) > 0.1, rng.choice([1.0, 2.0, 4.0], (HEIGHT, WIDTH))
    mean, count = pooled_by_definition(phasors, usable, samples, window)
    assert 1.5 < np.median(count) < 2.0 * window**2
    whole = pool(phasors, window=window, usable=usable, samples=samples)
    np.testing.assert_array_equal(whole.samples, count)
    np.testing.assert_allclose(whole.phasors, mean, rtol=ROUNDING)
    for pixels in (1, 100, 101, 700):
        monkeypatch.setattr("cadtof_cli.phasors.pooling.BLOCK_PIXELS", pixels)
        pooled = pool(phasors, window=window, usable=usable, samples=samples)
        np.testing.assert_array_equal(pooled.phasors, whole.phasors)
        np.testing.assert_array_equal(pooled.samples, whole.samples)


def test_the_expected_time_is_measured_on_some_pixels_of_the_size_and_harmonics_of_the_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The clock stands for a machine that takes 1 µs per pixel and neighbour."""
    clock = [100.0]

    def pooling(phasors: C, *, usable: B, samples: F, noise: NoiseModel, window: int) -> PooledPhasors:
        assert usable.all()
        assert len(noise.each) == len(phasors)
        clock[0] += 1e-6 * phasors[0].size * (window**2 - 1)
        return PooledPhasors(phasors, samples)

    monkeypatch.setattr("cadtof_cli.phasors.pooling.pooled_phasors", pooling)
    monkeypatch.setattr("cadtof_cli.phasors.pooling.time.perf_counter", lambda: clock[0])
    found = pooling_seconds((200, 400), noise_of((1, 2, 3), n_av=1e5), window=3)
    assert found == pytest.approx(200 * 400 * 8e-6, rel=0.02)


@pytest.mark.parametrize(
    ("window", "stride", "count"), [(3, 2, 8), (5, 2, 8), (9, 2, 8), (5, 1, 5), (5, 5, 8), (7, 4, 3), (9, 1, 3)]
)
def test_shared_noise_is_the_variance_and_correlation_of_means_over_pooled_white_noise(
    window: int, stride: int, count: int
) -> None:
    """White noise is averaged over windows, and these means over two squares side by side.

    Their variance and correlation are as predicted.
    """
    rng = np.random.default_rng(window)
    size = ((count - 1) * stride + window, (2 * count - 1) * stride + window)
    recorded = rng.standard_normal((4000, *size))
    windows = np.lib.stride_tricks.sliding_window_view(recorded, (window, window), axis=(1, 2))
    pooled = windows[:, ::stride, ::stride].mean(axis=(-2, -1))
    left, right = (pooled[:, :, half].mean(axis=(1, 2)) for half in (slice(count), slice(count, None)))
    found = shared_noise(window, samples=window**2, stride=stride, count=count)
    assert 0.5 * (left.var() + right.var()) * (window * count) ** 2 == pytest.approx(found.pixels, rel=0.06)
    assert np.corrcoef(left, right)[0, 1] == pytest.approx(found.neighbours, abs=0.06)


def test_pixels_that_are_not_pooled_share_no_noise() -> None:
    assert shared_noise(1, samples=1.0, stride=2, count=8) == SharedNoise(1.0, 0.0)
    assert shared_noise(5, samples=1.0, stride=2, count=8).pixels == 1.0
