"""The first look at a frame has the same bits in numpy and in every compiled kernel, which refuses unfit buffers."""

from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Voltage
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold, noise_model
from cadtof_cli.phasors.voltages import PhasorMap, phasors_from_stored, saturated_pixels
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.pipeline.stages import frame_stages, frame_traits
from cadtof_cli.resolver.diffuse import light
from cadtof_cli.resolver.diffuse.grid import PatchGrid, assumed_view, patch_grid, sampled_pixels
from cadtof_cli.resolver.diffuse.light import (
    Look,
    PatchLight,
    compiled_light,
    patch_means,
    sample_places,
    sampled_light,
)
from cadtof_cli.resolver.kernels import MOST_HARMONICS, NUMPY
from cadtof_cli.resolver.resolve import screened
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.kernel import saturation
from tests.resolver.compiled import compiled_kernels
from tests.support.diffuse_patches import traits_of
from tests.support.kernels import by_kernel

pytestmark = pytest.mark.usefixtures("compiled")

SIZES = [(1, 1), (72, 1), (3, 200), (5, 90), (37, 53), (120, 161), (250, 330)]

LIMITS = (0.0, 16383.0)


def noise_of(harmonics: tuple[int, ...]) -> NoiseModel:
    modulation = Modulation(periods_ns=tuple(40.0 / h for h in harmonics))
    metadata = CaptureMetadata(modulation=modulation, pixel=Pixel(integration_length=1e4))
    return noise_model(metadata, integration_length=1e4, quantised=False)


def stored_of(size: tuple[int, int], harmonics: int, dtype: Any, seed: int = 1) -> Any:
    """Return counts around 8192; some are saturated, some without light. Floats include NaN, ∞ and very large values."""
    rng, pixels = np.random.default_rng(seed), size[0] * size[1]
    counts = 8192.0 + rng.normal(0.0, 1500.0, (harmonics, 2, pixels))
    counts[:, :, rng.random(pixels) < 0.1] = 8192.0
    counts[:, :, rng.random(pixels) < 0.05] = 16383.0
    if np.dtype(dtype).kind == "f":
        rows = rng.integers(0, harmonics, pixels // 20)
        counts[rows, 0, rng.integers(0, pixels, rows.size)] = rng.choice(
            [np.nan, np.inf, -np.inf, 1e9, 1e30], rows.size
        )
        return counts.astype(dtype)
    return np.clip(np.rint(counts), 0, 16383).astype(dtype)


def phasor_map(harmonics: int, pixels: int | None) -> PhasorMap:
    """Return one affine map for all pixels, or a different one for each of `pixels` pixels."""
    rng, shape = np.random.default_rng(7), (harmonics, 2, pixels or 1)
    own = 6e-5 / 0.27 * rng.uniform(0.9, 1.1, shape)
    if pixels is None:
        return PhasorMap(own, constant=-8192.0 * own)
    return PhasorMap(own, 0.01 * own * rng.normal(size=shape), -8192.0 * own + 0.001 * rng.normal(size=shape))


def by_numpy(stored: Any, look: Look, noise: NoiseModel, settings: ResolverSettings, grid: PatchGrid) -> PatchLight:
    """Return the light of the patches by the separate stages of numpy, one after the other."""
    phasors = phasors_from_stored(stored, look.phasor_map)
    status = saturated_pixels(stored, LIMITS).astype(np.uint32)
    if look.hot is not None:
        status |= look.hot
    with np.errstate(all="ignore"):
        powers = [p.real**2 + p.imag**2 for p in phasors]
        modulus = np.sqrt(powers[0])
        found, _ = screened(modulus, powers, status, settings=settings, noise=noise)
    size = (grid.height, grid.width)
    rows, columns = sampled_pixels(*size)
    sampled = phasors.reshape(-1, *size)[:, rows, columns]
    return sampled_light(sampled, (found == 0).reshape(size)[rows, columns], grid, harmonics=look.noise.harmonics)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.float32, np.float64])
@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 4)])
@pytest.mark.parametrize("per_pixel", [False, True])
@pytest.mark.parametrize("false_alarm", [0.01, 1e-30])
def test_the_first_look_has_the_same_bits(
    size: tuple[int, int], dtype: Any, harmonics: tuple[int, ...], per_pixel: bool, false_alarm: float
) -> None:
    rng, pixels = np.random.default_rng(2), size[0] * size[1]
    stored, grid = stored_of(size, len(harmonics), dtype), patch_grid(*size, assumed_view(*size))
    settings, noise = ResolverSettings(false_alarm=false_alarm), noise_of(harmonics)
    if per_pixel:
        noise = replace(noise, samples=rng.integers(1, 9, pixels).astype(np.float64))
    hot = rng.random(pixels) < 0.1 if per_pixel else None
    each = phasor_map(len(harmonics), pixels if per_pixel else None)
    power = chi_squared_threshold(false_alarm, pairs=len(harmonics))
    look = Look(each, saturation(LIMITS, stored.dtype), power, noise, hot)
    expected = by_numpy(stored, look, noise, settings, grid)
    assert pixels == 1 or 0.1 < expected.seen.mean() < 0.95
    for kernel in compiled_kernels():
        found = by_kernel(kernel, compiled_light, stored, look, grid)
        for name in ("seen", "phase_rad", "weighted"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        chosen = rng.random(found.seen.shape) < 0.7
        found_means, expected_means = (
            by_kernel(one, patch_means, expected, chosen, traits_of(harmonics, 1e-4)) for one in (kernel, NUMPY)
        )
        for name in ("ratios", "amplitude", "pixels", "phase_rad"):
            np.testing.assert_array_equal(getattr(found_means, name), getattr(expected_means, name))


def test_the_first_look_with_indices_of_a_32_bit_system_has_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    stored, grid, noise = stored_of((37, 53), 2, np.uint16), patch_grid(37, 53, assumed_view(37, 53)), noise_of((1, 2))
    power = chi_squared_threshold(0.01, pairs=2)
    look = Look(phasor_map(2, None), saturation(LIMITS, stored.dtype), power, noise, None)
    expected = compiled_light(stored, look, grid)
    monkeypatch.setattr(light, "sample_places", lambda grid: sample_places(grid).astype(np.int32))
    np.testing.assert_array_equal(compiled_light(stored, look, grid).weighted, expected.weighted)


def test_phasors_and_unusual_types_are_left_to_numpy() -> None:
    voltage = Voltage(zero_counts=100.0, volts_per_count=1e-3)
    stages = frame_stages(FramePlan(metadata=CaptureMetadata(voltage=voltage)), None, np.dtype(np.uint16), (12, 20))

    def looks(dtype: Any) -> bool:
        return frame_traits(stages, noise_of((1, 2)), (12, 20), np.dtype(dtype)).look is not None

    assert looks(np.uint16)
    assert looks(float)
    assert not looks(complex)
    assert not looks(np.uint8)


@pytest.mark.parametrize("harmonics", [MOST_HARMONICS, MOST_HARMONICS + 1])
def test_means_of_as_many_harmonics_as_the_kernel_takes_and_of_more_have_the_same_bits(harmonics: int) -> None:
    rng, numbers = np.random.default_rng(3), tuple(range(1, harmonics + 1))
    seen = rng.random((9, 2, 3)) < 0.8
    weighted = rng.uniform(0.1, 1.0, (1 + 2 * harmonics, *seen.shape)).astype(np.float32)
    light = PatchLight(seen, weighted[0], weighted)
    expected = by_kernel(NUMPY, patch_means, light, seen, traits_of(numbers, 1e-4))
    for kernel in compiled_kernels():
        found = by_kernel(kernel, patch_means, light, seen, traits_of(numbers, 1e-4))
        for name in ("ratios", "amplitude", "pixels", "phase_rad"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


# --- buffers that do not fit ------------------------------------------------------------------------------------------

PIXELS, SAMPLES = 40, 36

BUFFERS: dict[str, tuple[Any, tuple[int, ...]]] = {
    "constants": (float, (3,)),
    "numbers": (np.int64, (2,)),
    "per variance": (float, (2,)),
    "places": (np.int64, (SAMPLES,)),
    "stored": (np.uint16, (2, 2, PIXELS)),
    "own": (float, (2, 2, PIXELS)),
    "other": (float, (2, 2, PIXELS)),
    "constant": (float, (2, 2, PIXELS)),
    "hot": (bool, (PIXELS,)),
    "samples": (float, (PIXELS,)),
    "weighted": (np.float32, (5, SAMPLES)),
    "phases": (np.float32, (SAMPLES,)),
    "seen": (bool, (SAMPLES,)),
}


def buffers() -> dict[str, Any]:
    given: dict[str, Any] = {name: np.ones(shape, dtype) for name, (dtype, shape) in BUFFERS.items()}
    given["constants"][:] = (np.nan, np.nan, 0.0)
    given["numbers"][1] = 2
    given["hot"][:] = False
    for name in ("own", "other", "constant"):
        given[name][:] = 0.25
    return given


def look(compiled: ModuleType, given: dict[str, Any], level: str | None = None) -> None:
    compiled.look_at_samples(level or compiled.levels()[0], *given.values())


def test_buffers_that_fit_are_filled_by_every_instruction_set(compiled: ModuleType) -> None:
    for level in compiled.levels():
        for without in ((), ("other", "constant", "hot", "samples")):
            given = buffers() | dict.fromkeys(without)
            look(compiled, given, level)
            assert given["seen"].all()
            assert np.isfinite(given["weighted"]).all()


@pytest.mark.parametrize("name", BUFFERS)
def test_a_buffer_of_another_size_or_type_is_refused(compiled: ModuleType, name: str) -> None:
    dtype, _ = BUFFERS[name]
    count = buffers()[name].size
    for unfit in (np.ones(count + 1, dtype), np.ones(count - 1, dtype), np.ones(count, np.complex64), "text", 3):
        with pytest.raises((TypeError, ValueError, BufferError)):
            look(compiled, buffers() | {name: unfit})


@pytest.mark.parametrize("name", ["weighted", "phases", "seen"])
def test_outputs_that_overlap_inputs_or_are_read_only_are_refused(compiled: ModuleType, name: str) -> None:
    given = buffers()
    given[name].setflags(write=False)
    with pytest.raises((ValueError, BufferError)):
        look(compiled, given)
    given = buffers()
    memory = np.zeros(PIXELS * 8, np.uint8)
    given["samples"] = memory.view(float)
    given[name] = memory[: given[name].nbytes].view(given[name].dtype) if name != "weighted" else given[name]
    if name == "weighted":
        given["own"] = np.ones(160)
        given[name] = given["own"].view(np.float32)[: 5 * SAMPLES]
    with pytest.raises(ValueError, match="lies in the memory"):
        look(compiled, given)


@pytest.mark.parametrize(
    ("name", "index", "value"),
    [
        ("places", 3, -2),
        ("places", 3, PIXELS),
        ("places", 0, 2**62),
        ("numbers", 0, 2),
        ("numbers", 1, 1),
        ("numbers", 1, 2**40),
    ],
)
def test_places_and_harmonics_outside_the_frame_are_refused(
    compiled: ModuleType, name: str, index: int, value: int
) -> None:
    given = buffers()
    given[name][index] = value
    with pytest.raises(ValueError, match="expected those of a frame"):
        look(compiled, given)
    with pytest.raises(ValueError, match="level"):
        look(compiled, buffers(), "mmx")
    with pytest.raises(ValueError, match="harmonics"):
        look(compiled, buffers() | {"numbers": np.ones(1, np.int64)})


def test_sums_of_buffers_that_do_not_fit_are_refused(compiled: ModuleType) -> None:
    level = compiled.levels()[0]
    sound = [np.ones((5, 4, 33), np.float32), np.ones((4, 33), bool), np.zeros((6, 33))]
    compiled.sum_patches(level, *sound)
    assert (sound[2] == 4.0).all()
    for place in range(3):
        for unfit in (np.ones(sound[place].size + 1, sound[place].dtype), np.ones(sound[place].shape, np.int8), None):
            with pytest.raises((TypeError, ValueError)):
                compiled.sum_patches(level, *sound[:place], unfit, *sound[place + 1 :])
    with pytest.raises(ValueError, match="planes"):
        compiled.sum_patches(level, np.ones((40, 4, 33), np.float32), sound[1], np.zeros((41, 33)))
    with pytest.raises(ValueError, match="level"):
        compiled.sum_patches("mmx", *sound)
    sums = np.ones((4, 7))
    compiled.sum_patches(level, np.ones((3, 0, 7), np.float32), np.ones((0, 7), bool), sums)
    assert not sums.any()
