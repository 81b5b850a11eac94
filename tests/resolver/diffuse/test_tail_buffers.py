"""The extension module refuses a tail whose buffers do not fit: it raises an error that names the fault; it never crashes.

`scripts/sanitize` runs these tests with the address and undefined-behaviour sanitizers.
"""

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

HEIGHT, WIDTH, SIDE = 9, 37, 4
PIXELS = HEIGHT * WIDTH
ROWS, COLUMNS = 3 + 2, (10 + 2) * SIDE

TAIL = (
    "sizes",
    "constants",
    "harmonics",
    "variances",
    "planes",
    "ranges",
    "down",
    "right",
    "above",
    "separate",
    "offset",
)

SIZES = {
    "first": 0,
    "height": HEIGHT,
    "width": WIDTH,
    "side": SIDE,
    "left": 2,
    "rows": ROWS,
    "columns": COLUMNS,
    "harmonics": 2,
}

PLANES = {2: 14, 3: 27}
"""Number of planes over the patches (means, covariances, variances), by the number of harmonics."""


def sizes_of(compiled: ModuleType, **sizes: int) -> Any:
    all_sizes = SIZES | sizes
    return np.array([all_sizes[name] for name in compiled.tail_sizes()], np.int64)


def tail_of(compiled: ModuleType, harmonics: int = 2) -> dict[str, Any]:
    """Return buffers of a tail that fit."""
    above = (2 * np.arange(HEIGHT) + 1 + SIDE) // (2 * SIDE)
    buffers = (
        sizes_of(compiled, harmonics=harmonics),
        np.ones(len(compiled.tail_constants())),
        np.arange(1, harmonics + 1, dtype=np.int64),
        np.full(harmonics, 1e-6),
        np.ones((PLANES[harmonics], ROWS, COLUMNS), np.float32),
        np.ones((ROWS, COLUMNS), np.float32),
        np.full(HEIGHT, 0.5, np.float32),
        np.full(WIDTH, 0.5, np.float32),
        above.astype(np.int64),
        np.zeros((3, 10), np.bool_),
        np.zeros((HEIGHT, WIDTH)),
    )
    return dict(zip(TAIL, buffers, strict=True))


def pixels_of(harmonics: int = 2, pixels: int = PIXELS) -> dict[str, Any]:
    """Return the other buffers of `answer_tail`."""
    return {
        "phasors": np.full((harmonics, pixels), 0.1 + 0.1j),
        "usable": np.ones(pixels, np.bool_),
        "samples": np.ones(pixels),
        "answered": np.zeros(pixels, np.bool_),
        "answers": np.full((7, pixels), -7.0, np.float32),
    }


def answer(compiled: ModuleType, tail: Any, pixels: dict[str, Any], **options: Any) -> None:
    given = tail.values() if isinstance(tail, dict) else tail
    compiled.answer_tail(options.get("level", compiled.levels()[0]), *pixels.values(), *given)


def resolve(compiled: ModuleType, tail: Any) -> None:
    """Resolve a frame of voltages with this tail."""
    layers, status = np.zeros((7, PIXELS), np.float32), np.zeros(PIXELS, np.uint32)
    stored, constants = np.full((4, PIXELS), 0.1), np.ones(len(compiled.constant_names()))
    given = tail.values() if isinstance(tail, dict) else tail
    compiled.resolve(compiled.levels()[0], 0, 0, -1, constants, stored, *(None,) * 6, layers, status, *given)


@pytest.mark.parametrize("harmonics", PLANES)
def test_buffers_that_fit_are_filled_by_every_instruction_set(compiled: ModuleType, harmonics: int) -> None:
    for level in compiled.levels():
        pixels = pixels_of(harmonics)
        answer(compiled, tail_of(compiled, harmonics), pixels, level=level)
        assert pixels["answered"].all()
        assert np.isfinite(pixels["answers"]).all()
    resolve(compiled, tail_of(compiled))


@pytest.mark.parametrize("name", TAIL)
@pytest.mark.parametrize("change", [-1, 1])
def test_a_buffer_of_the_wrong_size_is_refused(compiled: ModuleType, name: str, change: int) -> None:
    tail = tail_of(compiled)
    tail[name] = np.ones(tail[name].size + change, tail[name].dtype)
    with pytest.raises(ValueError, match="expected"):
        answer(compiled, tail, pixels_of())
    with pytest.raises(ValueError, match="expected"):
        resolve(compiled, tail)


@pytest.mark.parametrize("name", TAIL)
@pytest.mark.parametrize("dtype", ["u1", "i4", "u8", "f2", "c16", "S3", ">f8", ">f4", ">i8"])
def test_a_buffer_of_another_type_is_refused(compiled: ModuleType, name: str, dtype: str) -> None:
    tail = tail_of(compiled)
    tail[name] = np.zeros(tail[name].shape, dtype)
    with pytest.raises((TypeError, ValueError, BufferError)):
        answer(compiled, tail, pixels_of())


@pytest.mark.parametrize("name", [name for name in TAIL if name not in {"separate", "offset"}])
@pytest.mark.parametrize("value", [None, 3, "text"])
def test_a_value_that_is_no_buffer_is_refused(compiled: ModuleType, name: str, value: object) -> None:
    with pytest.raises(TypeError):
        answer(compiled, tail_of(compiled) | {name: value}, pixels_of())


@pytest.mark.parametrize(
    "sizes",
    [
        {"first": -1},
        {"first": 1},
        {"first": 2**62},
        {"height": HEIGHT - 1},
        {"height": HEIGHT + 4},
        {"height": 0},
        {"width": WIDTH + 1},
        {"width": -WIDTH},
        {"width": 2**40},
        {"side": 0},
        {"side": -1},
        {"side": 2},
        {"left": -1},
        {"left": 8},
        {"left": 2**63 - 1},
        {"rows": 2},
        {"rows": ROWS - 1},
        {"rows": 2**31},
        {"columns": COLUMNS - 8},
        {"columns": 2**62},
        {"harmonics": 1},
        {"harmonics": 3},
        {"harmonics": 9},
        {"harmonics": -(2**63)},
    ],
)
def test_sizes_that_do_not_fit_are_refused(compiled: ModuleType, sizes: dict[str, int]) -> None:
    tail = tail_of(compiled) | {"sizes": sizes_of(compiled, **sizes)}
    with pytest.raises(ValueError, match="expected"):
        answer(compiled, tail, pixels_of())
    with pytest.raises(ValueError, match="expected"):
        resolve(compiled, tail)


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("above", 0, -1),
        ("above", 8, ROWS - 1),
        ("above", 3, 2**62),
        ("harmonics", 0, 2),
        ("harmonics", 1, 1),
        ("harmonics", 1, 2**40),
        ("harmonics", 1, -2),
    ],
)
def test_indices_and_harmonics_out_of_range_are_refused(
    compiled: ModuleType, name: str, place: int, value: int
) -> None:
    tail = tail_of(compiled)
    tail[name][place] = value
    with pytest.raises(ValueError, match="expected"):
        answer(compiled, tail, pixels_of())


def test_two_paths_need_the_tail_of_two_harmonics(compiled: ModuleType) -> None:
    with pytest.raises(ValueError, match="harmonics"):
        resolve(compiled, tail_of(compiled, 3))
    fourth = tail_of(compiled)
    fourth["harmonics"][1] = 4
    answer(compiled, fourth, pixels_of())
    with pytest.raises(ValueError, match="harmonics"):
        resolve(compiled, fourth)


@pytest.mark.parametrize("tail", [(), (None,) * 11, (3,), tuple(range(11)), (None,) * 12])
def test_arguments_that_are_no_tail_are_refused(compiled: ModuleType, tail: tuple[object, ...]) -> None:
    with pytest.raises(TypeError):
        answer(compiled, tail, pixels_of())
    if len(tail) > 11 or any(one is not None for one in tail):
        with pytest.raises(TypeError):
            resolve(compiled, tail)


@pytest.mark.parametrize("name", [name for name in TAIL if name not in {"separate", "offset"}])
def test_a_part_of_a_tail_is_refused(compiled: ModuleType, name: str) -> None:
    with pytest.raises(ValueError, match="expected those of a frame"):
        resolve(compiled, tail_of(compiled) | {name: None})
    with pytest.raises(ValueError, match="expected those of a frame"):
        resolve(compiled, dict.fromkeys(TAIL) | {name: tail_of(compiled)[name]})


@pytest.mark.parametrize("name", ["phasors", "usable", "samples", "answered", "answers"])
def test_pixels_that_do_not_fit_are_refused(compiled: ModuleType, name: str) -> None:
    for shape, dtype in (((PIXELS + 1,), None), ((), None), (None, "i2")):
        pixels = pixels_of()
        whole = pixels[name]
        pixels[name] = np.zeros(whole.shape if shape is None else shape, dtype or whole.dtype)
        with pytest.raises((TypeError, ValueError)):
            answer(compiled, tail_of(compiled), pixels)
    if name != "samples":
        with pytest.raises(TypeError):
            answer(compiled, tail_of(compiled), pixels_of() | {name: None})


def test_outputs_that_overlap_inputs_or_are_read_only_are_refused(compiled: ModuleType) -> None:
    tail, pixels = tail_of(compiled), pixels_of()
    memory = np.zeros(7 * PIXELS + tail["planes"].size, np.float32)
    pixels["answers"], tail["planes"] = memory[: 7 * PIXELS], memory[7 * PIXELS - 1 : -1]
    with pytest.raises(ValueError, match="memory"):
        answer(compiled, tail, pixels)
    pixels = pixels_of()
    pixels["answered"] = pixels["usable"]
    with pytest.raises(ValueError, match="memory"):
        answer(compiled, tail_of(compiled), pixels)
    pixels = pixels_of()
    pixels["answers"].flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        answer(compiled, tail_of(compiled), pixels)


def test_an_unknown_level_is_refused(compiled: ModuleType) -> None:
    with pytest.raises(ValueError, match="expected"):
        answer(compiled, tail_of(compiled), pixels_of(), level="mmx")


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
def test_any_bits_in_buffers_that_fit_are_an_answer(compiled: ModuleType, data: st.DataObject, seed: int) -> None:
    """Sizes, the numbers of the harmonics and the rows of patches keep their valid values."""
    rng, harmonics = np.random.default_rng(seed), data.draw(st.sampled_from(list(PLANES)))
    tail, pixels = tail_of(compiled, harmonics), pixels_of(harmonics)
    for buffers, kept in ((tail, {"sizes", "harmonics", "above", "separate"}), (pixels, {"usable", "answered"})):
        for name in sorted(set(buffers) - kept):
            whole = buffers[name]
            buffers[name] = np.frombuffer(bytearray(rng.bytes(whole.nbytes)), whole.dtype).reshape(whole.shape)
    tail["separate"] = data.draw(st.sampled_from([None, rng.random((3, 10)) < 0.5]))
    before = [None if one is None else one.tobytes() for one in tail.values()]
    answer(compiled, tail, pixels)
    if harmonics == 2:
        resolve(compiled, tail)
    assert [None if one is None else one.tobytes() for one in tail.values()] == before
    assert set(pixels["answered"].tobytes()) <= {0, 1}


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    sizes=st.dictionaries(
        st.sampled_from(list(SIZES)), st.integers(-1, 50) | st.integers(-(2**63), 2**63 - 1), max_size=3
    ),
    pixels=st.integers(0, 60),
)
def test_any_sizes_are_an_answer_or_an_error(compiled: ModuleType, sizes: dict[str, int], pixels: int) -> None:
    given = pixels_of(2, pixels)
    tail = tail_of(compiled) | {"sizes": sizes_of(compiled, **sizes)}
    all_sizes = SIZES | sizes
    fits = all(all_sizes[name] == SIZES[name] for name in set(SIZES) - {"first", "left"})
    if fits and 0 <= all_sizes["first"] <= PIXELS - pixels and 0 <= all_sizes["left"] <= COLUMNS - WIDTH - SIDE:
        answer(compiled, tail, given)
        assert (given["answers"] != -7.0).any(axis=0).all()
    else:
        with pytest.raises(ValueError, match="expected"):
            answer(compiled, tail, given)
