"""Pixels that are answered through a tail have the same bits in numpy and in every compiled kernel."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Optics, Pixel, Voltage
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.pipeline.frame import prepare_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.pipeline.stages import FramePixels, frame_stages
from cadtof_cli.resolver.diffuse.pixels import diffuse_pixels
from cadtof_cli.resolver.diffuse.records import DiffuseModel, DiffusePixels
from cadtof_cli.resolver.kernels import MOST_HARMONICS, NUMPY, available_kernels
from cadtof_cli.resolver.settings import ORDERS, RETURNS, ResolverSettings, Return
from tests.resolver.compiled import bits_of, compiled_kernels
from tests.support.diffuse_answers import model_of
from tests.support.diffuse_frames import OMEGA, F, Tail, Z, corner_range, phasors_of
from tests.support.hard_pixels import HARD
from tests.support.kernels import by_kernel

pytestmark = pytest.mark.usefixtures("compiled")

SIZE = (37, 97)

COUNT = SIZE[0] * SIZE[1]

TAIL = Tail(0.3, 3.0, 8.0)


def room(harmonics: tuple[int, ...] = (1, 2), *, separate: bool = False, **options: Any) -> tuple[Z, DiffuseModel]:
    """Return phasors of a corner with a tail, (H, n), and its model; with `separate`, some patches have two paths."""
    mpi = {h: np.full(SIZE, TAIL.phasor(h)) for h in harmonics}
    if separate:
        for h in harmonics:
            mpi[h][8:20, 8:24] = 0.5 * np.exp(1j * h * OMEGA * 18.0)
    phasors = phasors_of(corner_range(*SIZE), mpi, harmonics=harmonics)
    model = model_of(phasors, harmonics=harmonics, **options)
    assert isinstance(model, DiffuseModel)
    return phasors.reshape(len(harmonics), -1), model


def assert_same_answers(found: DiffusePixels, expected: DiffusePixels, what: str = "") -> None:
    for field in fields(DiffusePixels):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        np.testing.assert_array_equal(one, other, err_msg=f"{field.name} {what}")
        if one.dtype == np.float32:
            known = ~np.isnan(other)
            np.testing.assert_array_equal(one[known].view(np.uint32), other[known].view(np.uint32), err_msg=field.name)


def assert_same_bits(
    phasors: Z, model: DiffuseModel, first: int = 0, usable: Any = None, samples: F | None = None
) -> DiffusePixels:
    """Answer pixels by numpy and by every compiled kernel, compare every bit, and return the answers."""
    use = np.ones(phasors.shape[1], bool) if usable is None else usable
    with np.errstate(all="ignore"):
        expected = by_kernel(NUMPY, diffuse_pixels, phasors, model=model, first=first, usable=use, samples=samples)
    for kernel in compiled_kernels():
        found = by_kernel(kernel, diffuse_pixels, phasors, model=model, first=first, usable=use, samples=samples)
        assert_same_answers(found, expected, kernel)
    return expected


@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 3), (1, 2, 4), (1, 2, 3, 5, 7)])
@pytest.mark.parametrize("separate", [False, True])
def test_answers_of_a_room_have_the_same_bits(harmonics: tuple[int, ...], separate: bool) -> None:
    phasors, model = room(harmonics, separate=separate)
    answers = assert_same_bits(phasors, model)
    assert answers.answered.mean() > 0.5
    assert answers.answered.all() != separate


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 3)])
def test_hard_pixels_have_the_same_bits(name: str, harmonics: tuple[int, ...]) -> None:
    _, model = room(harmonics)
    rng = np.random.default_rng(5)
    phasors = np.concatenate([HARD[name](rng, COUNT), HARD[name](rng, COUNT)])[: len(harmonics)]
    usable = rng.random(COUNT) < 0.8
    assert_same_bits(phasors, model, usable=usable)
    with np.errstate(all="ignore"):
        assert_same_bits(np.asarray(1e3 * phasors, np.complex128), model)


def test_means_of_pixels_and_curved_fields_have_the_same_bits() -> None:
    rng = np.random.default_rng(6)
    samples, offset = rng.integers(1, 26, COUNT).astype(np.float64), rng.normal(0.0, 0.05, SIZE)
    phasors, model = room((1, 2, 3), samples=float(np.median(samples)), range_offset_m=offset)
    answers = assert_same_bits(phasors, model, samples=samples)
    without = assert_same_bits(phasors, replace(model, range_offset_m=None), samples=samples)
    assert (answers.direct_phase_rad != without.direct_phase_rad).any()


@pytest.mark.parametrize("cut", [1, 7, 31, 32, 33, 97, 1000])
def test_a_pixel_has_the_same_bits_wherever_a_part_begins_and_ends(cut: int) -> None:
    phasors, model = room((1, 2, 3), separate=True)
    whole = assert_same_bits(phasors, model)
    for pixels in (slice(0, cut), slice(cut, cut + 95), slice(cut + 95, COUNT)):
        part = assert_same_bits(phasors[:, pixels], model, pixels.start)
        for field in fields(DiffusePixels):
            np.testing.assert_array_equal(getattr(part, field.name), getattr(whole, field.name)[pixels])


@pytest.mark.parametrize("size", [(8, 8), (240, 20), (7, 300), (130, 33)])
def test_frames_of_any_shape_have_the_same_bits(size: tuple[int, int]) -> None:
    phasors = phasors_of(corner_range(*size), {h: TAIL.phasor(h) for h in (1, 2)})
    model = model_of(phasors)
    if isinstance(model, DiffuseModel):
        assert_same_bits(phasors.reshape(2, -1), model)
    else:
        assert size == (8, 8)


def test_more_harmonics_than_the_kernel_takes_are_left_to_numpy() -> None:
    assert_same_bits(*room(tuple(range(1, MOST_HARMONICS + 2))))


# --- whole frames, from stored values to maps -------------------------------------------------------------------------

METADATA = CaptureMetadata(pixel=Pixel(integration_length=1e5), optics=Optics(focal_length_px=60.0))


def recorded(harmonics: tuple[int, ...] = (1, 2)) -> Any:
    """Return voltages of a corner with a tail, separate paths and pixels without an answer, in V, (H, 2, Y, X)."""
    phasors, _ = room(harmonics, separate=True)
    hard = HARD["special_values"](np.random.default_rng(2), 60)
    volts = np.stack([phasors.real, phasors.imag], axis=1) * METADATA.modulation.amplitude_v
    with np.errstate(over="ignore"):
        for row, p in enumerate(hard):
            volts[row, :, 500:560] = [p.real, p.imag]
    volts[:, :, 900:950] = 1e-9
    volts[:, :, 2000:2100] *= 60.0
    return volts.reshape(len(harmonics), 2, *SIZE)


def plan_of(metadata: CaptureMetadata = METADATA, **options: Any) -> FramePlan:
    of_maps = {name: options.pop(name) for name in ("depth", "pool", "average") if name in options}
    resolver = ResolverSettings(**{"mpi_model": "diffuse", **options})
    return FramePlan(metadata=metadata, settings=MapSettings(resolver=resolver, **of_maps))


def resolved_bits(pixels: FramePixels, plan: FramePlan, kernel: str) -> Any:
    stages = frame_stages(plan, None, pixels.dtype, pixels.size)
    return bits_of(by_kernel(kernel, resolve_pixels, pixels, stages))


def assert_same_maps(stored: Any, plan: FramePlan) -> Any:
    pixels = prepare_frame(stored, stages_of(stored, plan))
    assert pixels.tail is not None
    expected = resolved_bits(pixels, plan, NUMPY)
    for kernel in compiled_kernels():
        np.testing.assert_array_equal(resolved_bits(pixels, plan, kernel), expected, err_msg=kernel)
    return expected


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("returns", RETURNS)
def test_maps_of_a_room_have_the_same_bits(order: str, returns: Return) -> None:
    pixels = prepare_frame(recorded(), stages_of(recorded(), plan_of()))
    assert pixels.tail is not None
    # a frame that is forced to have a tail has no separate patches, so some are set here
    separate = np.zeros_like(pixels.tail.separate)
    separate[2:4, 3:6] = True
    plan = plan_of(order=order, returns=returns, mpi_model="auto")
    for model in (pixels.tail, replace(pixels.tail, separate=separate)):
        marked_pixels = replace(pixels, tail=model)
        expected = resolved_bits(marked_pixels, plan, NUMPY)
        for kernel in compiled_kernels():
            np.testing.assert_array_equal(resolved_bits(marked_pixels, plan, kernel), expected, err_msg=kernel)
        assert {0, 2048} <= set(np.unique(expected[-1] & 2048).tolist())


@pytest.mark.parametrize(
    "options",
    [{"depth": "z"}, {"min_return_ratio": 0.7}, {"false_alarm": 0.5}, {"min_confidence": 0.0}, {"pool": 3}],
)
def test_options_have_the_same_bits(options: dict[str, Any]) -> None:
    assert_same_maps(np.clip(recorded(), -1e3, 1e3), plan_of(**options))


def test_counts_and_means_of_frames_have_the_same_bits() -> None:
    counts = replace(
        METADATA, voltage=Voltage(zero_counts=8192.0, volts_per_count=6e-5, saturated_counts=(0.0, 16383.0))
    )
    stored = np.clip(np.rint(np.clip(np.nan_to_num(recorded()), -1.0, 1.0) / 6e-5 + 8192.0), 0, 16383).astype(np.uint16)
    assert_same_maps(stored, plan_of(counts))
    samples = np.random.default_rng(3).integers(1, 9, SIZE).astype(np.float64)
    assert_same_maps(FrameMean(stored.astype(np.float64), samples, stored.dtype), plan_of(counts, average=8))


@pytest.mark.parametrize("count", [3, MOST_HARMONICS + 1])
def test_more_harmonics_have_the_same_bits(count: int) -> None:
    harmonics = tuple(range(1, count + 1))
    periods = replace(METADATA.modulation, periods_ns=tuple(40.0 / h for h in harmonics))
    assert_same_maps(recorded(harmonics), plan_of(replace(METADATA, modulation=periods)))


@pytest.mark.parametrize("cut", [1, 7, 31, 33, 97, 1000])
def test_parts_of_a_frame_have_the_same_bits(cut: int) -> None:
    plan = plan_of()
    pixels = prepare_frame(recorded(), stages_of(recorded(), plan))
    for kernel in available_kernels():
        whole = resolved_bits(pixels, plan, kernel)
        joined = [
            resolved_bits(part, plan, kernel) for part in (pixels[:cut], pixels[cut : cut + 95], pixels[cut + 95 :])
        ]
        np.testing.assert_array_equal(np.concatenate(joined, axis=-1), whole)
