"""The compiled search under a response returns numpy's bits by every instruction set, and refuses unfit buffers.

`scripts/sanitize` runs these tests with the address and undefined-behaviour sanitizers.
"""

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cadtof_cli.arrays import Float32
from cadtof_cli.pipeline.frame import prepare_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan, MapSettings
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.response.newton import Equations, searched
from cadtof_cli.resolver.response.table import ENTRIES, STAGES, ResponseBlock
from cadtof_cli.resolver.settings import ResolverSettings
from tests.resolver.compiled import bits_of, compiled_kernels
from tests.resolver.response.phasors import COUNT, NOISE, TRIANGLE, block, paths, recorded
from tests.support.calibrations import made_up_calibration
from tests.support.hard_pixels import HARD
from tests.support.kernels import by_kernel

pytestmark = pytest.mark.usefixtures("compiled")


def assert_same_bits(
    response: ResponseBlock, phasors: Any, start: Float32, *, steps: int, stage: int = -1
) -> NDArray[np.bool_]:
    with np.errstate(all="ignore"):
        equations = Equations.of(response, phasors, NOISE)
        expected = by_kernel(NUMPY, searched, equations, start, steps=steps, stage=stage)
    for kernel in compiled_kernels():
        found = by_kernel(kernel, searched, equations, start, steps=steps, stage=stage)
        np.testing.assert_array_equal(found.done, expected.done, err_msg=kernel)
        for one, other in ((found.values, expected.values), (found.misfit, expected.misfit)):
            np.testing.assert_array_equal(one, other, err_msg=kernel)
            sound = ~np.isnan(other)
            np.testing.assert_array_equal(one[sound].view(np.uint32), other[sound].view(np.uint32), err_msg=kernel)
    return expected.done


@pytest.mark.parametrize("phases", [False, True])
@pytest.mark.parametrize("stage", range(len(STAGES)))
@pytest.mark.parametrize("steps", [0, 1, 8])
def test_searches_end_at_the_same_bits(phases: bool, stage: int, steps: int) -> None:
    response = block(phases=phases)
    true = paths(1)
    near = true + np.random.default_rng(2).normal(0.0, 0.1, true.shape).astype(np.float32)
    done = assert_same_bits(response, recorded(true, response), near, steps=steps, stage=stage)
    if steps == 8 and stage == len(STAGES) - 1 and not phases:
        assert 0.2 < done.mean() < 1.0


@pytest.mark.parametrize("name", HARD)
def test_hard_pixels_end_at_the_same_bits(name: str) -> None:
    rng = np.random.default_rng(3)
    with np.errstate(all="ignore"):
        hard = np.stack(HARD[name](rng, COUNT))
        odd_starts = rng.choice(
            np.array([0.0, -0.0, 1.0, 1e-30, 5e5, 1e30, np.nan, np.inf, -1.0, 4.0], np.float32), (4, COUNT)
        )
        assert_same_bits(block(phases=False), hard, paths(5), steps=6)
        assert_same_bits(block(phases=True), hard, odd_starts, steps=6)


@pytest.mark.parametrize("count", [0, 1, 7, 31, 32, 33])
def test_a_pixel_ends_at_the_same_bits_in_a_block_of_any_size(count: int) -> None:
    response = block(phases=False)
    true = paths(1)
    phasors = recorded(true, response)
    some = slice(100, 100 + count)
    near = (true + np.float32(0.05))[:, some]
    assert_same_bits(response, phasors[:, some], near, steps=6)


def volts(name: str, size: tuple[int, int]) -> Any:
    with np.errstate(over="ignore", invalid="ignore"):
        p = HARD[name](np.random.default_rng(7), size[0] * size[1])
        planes = np.stack([[one.real, one.imag] for one in p]) * TRIANGLE.modulation.amplitude_v
    return planes.reshape(2, 2, *size)


@pytest.mark.parametrize("name", ["close_paths", "arbitrary", "faint", "special_values"])
@pytest.mark.parametrize("calibrated", [False, True])
def test_maps_of_a_triangle_have_the_same_bits(name: str, calibrated: bool) -> None:
    size = (12, 97)
    plan = FramePlan(metadata=TRIANGLE, settings=MapSettings(resolver=ResolverSettings(mpi_model="discrete")))
    calibration = made_up_calibration(TRIANGLE, size, ("response",)) if calibrated else None
    if calibration is not None:
        plan = replace(plan, calibration=CalibrationUse(Path("made up"), calibration.digest))
    stages = stages_of(volts(name, size), plan, calibration)
    pixels = prepare_frame(volts(name, size), stages)
    expected = bits_of(by_kernel(NUMPY, resolve_pixels, pixels, stages))
    for kernel in compiled_kernels():
        for cut in (0, 33):
            parts = [pixels[:cut], pixels[cut:]] if cut else [pixels]
            found = [bits_of(by_kernel(kernel, resolve_pixels, part, stages)) for part in parts]
            np.testing.assert_array_equal(np.concatenate(found, axis=-1), expected, err_msg=kernel)


# --- buffers ----------------------------------------------------------------------------------------------------------

PIXELS = 37

SIZES = {
    "constants": 7,
    "first": 4 * ENTRIES,
    "second": 4 * ENTRIES,
    "phases": 2 * PIXELS,
    "observed": 4 * PIXELS,
    "enough": PIXELS,
    "start": 4 * PIXELS,
    "values": 4 * PIXELS,
    "misfit": PIXELS,
    "done": PIXELS,
}


WRITTEN = {"values", "misfit", "done"}


def buffers() -> dict[str, Any]:
    return {name: np.ones(size, np.bool_ if name == "done" else np.float32) for name, size in SIZES.items()}


def run(compiled: ModuleType, given: dict[str, Any], *, steps: int = 6, level: str | None = None) -> None:
    compiled.search(level or compiled.levels()[0], steps, *given.values())


@pytest.mark.parametrize("name", SIZES)
def test_buffers_that_do_not_fit_are_refused(compiled: ModuleType, name: str) -> None:
    whole = buffers()[name]
    for change in (-1, 1):
        with pytest.raises(ValueError, match="expected"):
            run(compiled, buffers() | {name: np.ones(whole.size + change, whole.dtype)})
    for dtype in ("u1", "f8", ">f4", "i4", "c8"):
        with pytest.raises((TypeError, ValueError)):
            run(compiled, buffers() | {name: np.ones(whole.size, dtype)})
    for value in (3, "text", None) if name != "phases" else (3, "text"):
        with pytest.raises(TypeError):
            run(compiled, buffers() | {name: value})
    with pytest.raises((ValueError, BufferError)):
        run(compiled, buffers() | {name: np.repeat(whole, 2)[::2]})


def test_outputs_that_overlap_inputs_or_are_read_only_are_refused(compiled: ModuleType) -> None:
    given = buffers()
    memory = np.ones(8 * PIXELS, np.float32)
    given["start"], given["values"] = memory[: 4 * PIXELS], memory[PIXELS : 5 * PIXELS]
    with pytest.raises(ValueError, match="memory"):
        run(compiled, given)
    given = buffers()
    given["done"].flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        run(compiled, given)


@pytest.mark.parametrize("options", [{"steps": -1}, {"steps": 1001}, {"level": "mmx"}])
def test_options_out_of_range_are_refused(compiled: ModuleType, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="expected"):
        run(compiled, buffers(), **options)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), steps=st.integers(0, 20), phases=st.booleans())
def test_any_bits_end_the_search(compiled: ModuleType, seed: int, steps: int, phases: bool) -> None:
    rng, given = np.random.default_rng(seed), buffers()
    for name in ("constants", "first", "phases", "observed", "enough", "start"):
        given[name] = np.frombuffer(bytearray(rng.bytes(4 * SIZES[name])), np.float32)
    if not phases:
        given["phases"] = None
    read = {name: values.tobytes() for name, values in given.items() if values is not None and name not in WRITTEN}
    for level in compiled.levels():
        given["done"].view(np.uint8)[:] = 7
        run(compiled, given, steps=steps, level=level)
        assert set(given["done"].view(np.uint8)) <= {0, 1}
        assert read == {name: given[name].tobytes() for name in read}
