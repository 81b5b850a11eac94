"""The steps of the patch fit have the same bits in numpy and in every compiled kernel, which refuses unfit buffers."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cadtof_cli.resolver.diffuse.patch_fit import fitted_patches
from cadtof_cli.resolver.diffuse.patch_steps import CompiledSteps, PatchSteps
from cadtof_cli.resolver.diffuse.prior import MEAN
from cadtof_cli.resolver.diffuse.radiosity import Interreflections
from cadtof_cli.resolver.diffuse.tail import TailModel
from cadtof_cli.resolver.kernels import MOST_HARMONICS, NUMPY, is_compiled_for
from tests.resolver.compiled import compiled_kernels
from tests.support.diffuse_frames import OMEGA, F
from tests.support.kernels import by_kernel

pytestmark = pytest.mark.usefixtures("compiled")

HARMONICS = [(1, 2), (1, 2, 3), (1, 2, 4), (1, 2, 3, 5, 7)]


def light_of(harmonics: tuple[int, ...], patches: int, seed: int) -> Interreflections:
    rng = np.random.default_rng(seed)
    size = (len(harmonics), patches)
    seen, beyond, later = (rng.exponential(0.3, size) * np.exp(1j * rng.uniform(0.0, 3.0, size)) for _ in range(3))
    return Interreflections(seen, beyond, later, np.ones(patches), np.zeros(patches))


def covariances(rng: np.random.Generator, size: int, patches: int) -> F:
    root = 0.03 * rng.normal(size=(patches, size, size))
    return np.moveaxis(root @ root.swapaxes(1, 2) + 1e-5 * np.eye(size), 0, -1).copy()


def assert_same(found: Any, expected: Any, what: str) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.view(np.uint64), np.ascontiguousarray(other).view(np.uint64), err_msg=what)


@pytest.mark.parametrize("harmonics", HARMONICS)
@pytest.mark.parametrize("patches", [1, 2, 31, 32, 33, 301])
def test_a_fit_has_the_same_bits(harmonics: tuple[int, ...], patches: int) -> None:
    rng = np.random.default_rng(patches)
    light, count = light_of(harmonics, patches, patches), 2 * len(harmonics) - 2
    data = np.concatenate([rng.normal(-0.2, 0.1, (count // 2, patches)), rng.normal(-0.3, 3.0, (count // 2, patches))])
    error, pattern = covariances(rng, count + 2, patches), 0.3 * rng.normal(size=(6, patches))

    def fit() -> tuple[F, ...]:
        model = TailModel(light, harmonics, OMEGA)
        found = fitted_patches(data, error, model, pattern, known_optics=True)
        return (
            found.room,
            found.state,
            found.expected,
            found.posterior,
            found.covariance,
            found.jacobian,
        )

    expected = by_kernel(NUMPY, fit)
    assert all(np.isfinite(one).all() for one in expected)
    for kernel in compiled_kernels():
        assert_same(by_kernel(kernel, fit), expected, kernel)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32), large=st.sampled_from([1.0, 1e3, 1e150]), special=st.booleans())
def test_steps_of_any_numbers_have_the_same_bits(seed: int, large: float, special: bool) -> None:
    """This holds even for numbers that no room has. NaN and infinity may become NaN."""
    rng, patches, count = np.random.default_rng(seed), 40, 4

    def numbers(*size: int) -> F:
        values = large * rng.normal(size=size)
        if special:
            values[rng.random(size) < 0.02] = rng.choice([np.nan, np.inf, 0.0, -0.0, 5e-324])
        return values

    fixed = (numbers(count, patches), numbers(count + 2, count + 2, patches), np.abs(numbers(6)), numbers(6, patches))
    values, jacobian, state = numbers(count + 2, patches), numbers(6, count + 2, patches), numbers(6, patches)
    room, spread, linear = numbers(6), numbers(6, 6), numbers(count, patches)

    def steps(one: PatchSteps) -> tuple[F, ...]:
        evidence, moved = one.evidence(values, jacobian, state), one.moved(state, linear, jacobian, room, spread)
        return (*evidence, moved, *one.posterior(values, jacobian, state, room, spread))

    with np.errstate(all="ignore"):
        expected = steps(PatchSteps(*fixed))
        for kernel in compiled_kernels():
            for found, other in zip(by_kernel(kernel, steps, CompiledSteps(*fixed)), expected, strict=True):
                np.testing.assert_array_equal(found, other)


def test_more_harmonics_than_the_kernel_takes_are_left_to_numpy() -> None:
    kernel = compiled_kernels()[0]
    assert by_kernel(kernel, is_compiled_for, MOST_HARMONICS)
    assert not by_kernel(kernel, is_compiled_for, MOST_HARMONICS + 1)
    assert not by_kernel(NUMPY, is_compiled_for, 2)


# --- buffers that do not fit ------------------------------------------------------------------------------------------

N, H = 37, 2
SLOPES: dict[str, tuple[int, ...]] = {
    "numbers": (H,),
    "rad per ns": (H,),
    "onset": (H,),
    "state": (5, N),
    "cosines": (H, N),
    "sines": (H, N),
    "seen": (H, N),
    "beyond": (H, N),
    "later": (H, N),
    "total": (3, H, N),
    "slopes": (6, 2 * H, N),
}
STEPS: dict[str, tuple[int, ...]] = {
    "data": (2, N),
    "error": (4, 4, N),
    "within": (6,),
    "pattern": (6, N),
    "values": (4, N),
    "slopes": (6, 4, N),
    "state": (6, N),
    "linear data": (2, N),
    "room": (6,),
    "spread": (6, 6),
}
ANSWERS: dict[int, dict[str, tuple[int, ...]]] = {
    0: {"answer": (2, 7, N), "second answer": (2, N)},
    1: {"answer": (6, N)},
    2: {"answer": (4, N), "second answer": (4, N), "third answer": (4, 4, N)},
}
NEEDED = {
    0: ("values", "second answer"),
    1: ("linear data", "room", "spread"),
    2: ("values", "room", "spread", "third answer"),
}


def slopes_given() -> dict[str, Any]:
    light = {"seen", "beyond", "later"}
    return {name: np.ones(shape, np.complex128 if name in light else np.float64) for name, shape in SLOPES.items()}


def steps_given(step: int) -> dict[str, Any]:
    given: dict[str, Any] = {name: np.ones(shape) for name, shape in STEPS.items()}
    return given | {
        name: np.full(ANSWERS[step].get(name, 0), -7.0) if name in ANSWERS[step] else None for name in ANSWERS[2]
    }


def call(compiled: ModuleType, step: int | None, given: dict[str, Any], level: str | None = None) -> None:
    name = level or compiled.levels()[0]
    if step is None:
        compiled.tail_slopes(name, *given.values())
    else:
        compiled.step_patches(name, step, *given.values())


def given_of(step: int | None) -> dict[str, Any]:
    return slopes_given() if step is None else steps_given(step)


CALLS = [None, *ANSWERS]


@pytest.mark.parametrize("step", CALLS)
def test_buffers_that_fit_are_filled_by_every_instruction_set(compiled: ModuleType, step: int | None) -> None:
    for level in compiled.levels():
        given = given_of(step)
        call(compiled, step, given, level)
        assert all((array != -7.0).all() for name, array in given.items() if "answer" in name and array is not None)


@pytest.mark.parametrize("step", CALLS)
@pytest.mark.parametrize("change", [-1, 1])
def test_a_buffer_of_the_wrong_size_is_refused(compiled: ModuleType, step: int | None, change: int) -> None:
    for name, array in given_of(step).items():
        if array is None:
            continue
        given = given_of(step)
        given[name] = np.ones(array.size + change, array.dtype)
        with pytest.raises(ValueError, match="expected"):
            call(compiled, step, given)


@pytest.mark.parametrize("step", CALLS)
@pytest.mark.parametrize("dtype", ["u1", "i8", "f4", "c8", ">f8", "S8"])
def test_a_buffer_of_another_type_is_refused(compiled: ModuleType, step: int | None, dtype: str) -> None:
    for name, array in given_of(step).items():
        if array is None:
            continue
        given = given_of(step)
        given[name] = np.zeros(array.shape, dtype)
        with pytest.raises((TypeError, ValueError, BufferError)):
            call(compiled, step, given)


@pytest.mark.parametrize("step", CALLS)
def test_values_that_are_no_buffers_read_only_outputs_and_overlapping_inputs_are_refused(
    compiled: ModuleType, step: int | None
) -> None:
    written = ("total", "slopes") if step is None else tuple(ANSWERS[step])
    for name in given_of(step):
        given = given_of(step)
        given[name] = "text"
        with pytest.raises((TypeError, ValueError)):
            call(compiled, step, given)
    for name in written:
        given = given_of(step)
        given[name].setflags(write=False)
        with pytest.raises((ValueError, BufferError)):
            call(compiled, step, given)
        given = given_of(step)
        given["state"] = given[name].ravel()[: given["state"].size]
        with pytest.raises(ValueError, match=r"expected|lies in the memory"):
            call(compiled, step, given)


@pytest.mark.parametrize("step", ANSWERS)
def test_a_missing_buffer_that_a_step_needs_is_refused(compiled: ModuleType, step: int) -> None:
    for name in NEEDED[step]:
        given = steps_given(step)
        given[name] = None
        with pytest.raises(ValueError, match="expected"):
            call(compiled, step, given)


def test_unknown_levels_steps_and_harmonics_are_refused(compiled: ModuleType) -> None:
    for step in CALLS:
        with pytest.raises(ValueError, match="level"):
            call(compiled, step, given_of(step), "mmx")
    for step in (-1, 3):
        with pytest.raises(ValueError, match="step"):
            compiled.step_patches(compiled.levels()[0], step, *steps_given(0).values())
    given = slopes_given() | {"numbers": np.ones(1)}
    with pytest.raises(ValueError, match="harmonics"):
        call(compiled, None, given)


def test_a_fit_of_no_patches_returns_empty_arrays() -> None:
    """A fit without any patches returns empty arrays."""
    steps = CompiledSteps(np.empty((2, 0)), np.empty((4, 4, 0)), np.ones(6), np.empty((6, 0)))
    given = np.empty((4, 0)), np.empty((6, 4, 0)), MEAN[:, None][:, :0]
    white, linear = by_kernel(compiled_kernels()[0], steps.evidence, *given)
    assert white.shape == (2, 7, 0)
    assert linear.size == 0
