"""The extension module refuses buffers that do not fit: it raises an error that names the fault, and never crashes.

`scripts/sanitize` runs these tests with the address and undefined-behaviour sanitizers.
"""

from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

PIXELS = 37

PLANES = {
    "stored": 4,
    "own": 4,
    "other": 4,
    "constant": 4,
    "samples": 1,
    "metres": 1,
    "shift": 1,
    "layers": 7,
    "status": 1,
}

TYPES = {"stored": "u2", "layers": "f4", "status": "u4"}


def buffers(compiled: ModuleType, pixels: int = PIXELS) -> dict[str, Any]:
    """Return buffers that fit: voltages in the middle of their range, and a response of 1."""
    found: dict[str, Any] = {"constants": np.ones(len(compiled.constant_names()))}
    for name, planes in PLANES.items():
        found[name] = np.ones((planes, pixels), TYPES.get(name, "f8"))
    return found


def run(
    compiled: ModuleType,
    given: dict[str, Any],
    *,
    level: str | None = None,
    order: int = 0,
    returns: int = 0,
    bits: int = -1,
) -> None:
    compiled.resolve(compiled.levels()[0] if level is None else level, order, returns, bits, *given.values())


def test_buffers_that_fit_are_filled_by_every_instruction_set(compiled: ModuleType) -> None:
    for level in compiled.levels():
        given = buffers(compiled)
        given["layers"][:] = -7.0
        run(compiled, given, level=level)
        assert not (given["layers"] == -7.0).any()
        assert (given["status"] >= 1).all()


def voltages(compiled: ModuleType, dtype: str) -> dict[str, Any]:
    """Return buffers that fit: voltages of a camera without values per pixel; nearly all of its pixels have paths."""
    usual = dict.fromkeys(compiled.constant_names(), 1.0)
    usual |= {f"gain{part}": 1e-4 for part in range(1, 5)} | {f"offset{part}": -1.0 for part in range(1, 5)}
    usual |= {"saturated_low": 0.0, "saturated_high": 16383.0}
    usual |= {"least_power": 0.01, "least_modulus": 0.01, "misfit_limit": 0.0, "most_volts": np.inf}
    stored = np.random.default_rng(0).integers(5000, 15000, (4, PIXELS)).astype(dtype)
    found = buffers(compiled) | dict.fromkeys(("own", "other", "constant", "samples", "metres", "shift"))
    return found | {"constants": np.array(list(usual.values())), "stored": stored}


@pytest.mark.parametrize("bits", [0, 64, 256, 1 << 20])
@pytest.mark.parametrize("dtype", ["u2", "f4", "f8"])
def test_bits_given_once_for_all_pixels_do_what_bits_per_pixel_do(compiled: ModuleType, bits: int, dtype: str) -> None:
    for level in compiled.levels():
        per_pixel, shared = voltages(compiled, dtype), voltages(compiled, dtype)
        per_pixel["status"][:], shared["status"][:] = bits, 1 << 21
        run(compiled, per_pixel, level=level)
        run(compiled, shared, level=level, bits=bits)
        np.testing.assert_array_equal(shared["status"], per_pixel["status"])
        np.testing.assert_array_equal(shared["layers"], per_pixel["layers"])
        assert (per_pixel["status"] & 16).any() == (bits != 256)


def test_a_call_with_no_pixels_writes_nothing(compiled: ModuleType) -> None:
    given, beyond = buffers(compiled, 0), {"layers": np.ones((7, 64), "f4"), "status": np.ones((1, 64), "u4")}
    for level in compiled.levels():
        run(
            compiled,
            given | {name: outside[:, :0].reshape(given[name].shape) for name, outside in beyond.items()},
            level=level,
        )
        assert all((outside == 1).all() for outside in beyond.values())


@pytest.mark.parametrize("name", PLANES)
@pytest.mark.parametrize("change", [-1, 1])
def test_a_buffer_of_the_wrong_size_is_refused(compiled: ModuleType, name: str, change: int) -> None:
    given = buffers(compiled)
    given[name] = np.ones((PLANES[name], PIXELS + change), given[name].dtype)
    with pytest.raises(ValueError, match="expected"):
        run(compiled, given)


@pytest.mark.parametrize("name", ["constants", *PLANES])
@pytest.mark.parametrize("dtype", ["u1", "i4", "i8", "f2", "c8", "S3", ">f8", ">u2", ">f4", ">u4"])
def test_a_buffer_of_another_type_is_refused(compiled: ModuleType, name: str, dtype: str) -> None:
    given = buffers(compiled)
    given[name] = np.zeros(given[name].shape, dtype)
    with pytest.raises((TypeError, ValueError, BufferError)):
        run(compiled, given)


@pytest.mark.parametrize("name", ["constants", *PLANES])
def test_strides_and_odd_addresses_are_refused(compiled: ModuleType, name: str) -> None:
    given = buffers(compiled)
    whole = given[name]
    given[name] = np.repeat(whole, 2, axis=-1)[..., ::2]
    with pytest.raises((ValueError, BufferError)):
        run(compiled, given)
    odd = memoryview(bytearray(whole.nbytes + 1))[1:]
    given[name] = odd.cast(whole.dtype.char)
    with pytest.raises(ValueError, match="aligned"):
        run(compiled, given)


@pytest.mark.parametrize("name", ["layers", "status"])
def test_read_only_outputs_are_refused(compiled: ModuleType, name: str) -> None:
    given = buffers(compiled)
    given[name].flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        run(compiled, given)
    given = buffers(compiled)
    given[name] = given[name].tobytes()
    with pytest.raises((TypeError, BufferError)):
        run(compiled, given)


@pytest.mark.parametrize("name", ["constants", "stored", "layers", "status"])
@pytest.mark.parametrize("value", [None, 3, "text", [1.0, 2.0]])
def test_a_value_that_is_no_buffer_is_refused(compiled: ModuleType, name: str, value: object) -> None:
    given = buffers(compiled)
    given[name] = value
    with pytest.raises(TypeError):
        run(compiled, given)


def test_a_frame_in_the_memory_of_its_maps_is_refused(compiled: ModuleType) -> None:
    given = buffers(compiled)
    memory = np.zeros(8 * PIXELS, np.float32)
    given["layers"], given["stored"] = memory[: 7 * PIXELS], memory[PIXELS : 5 * PIXELS]
    with pytest.raises(ValueError, match="memory"):
        run(compiled, given)


def test_a_part_of_an_affine_map_is_refused(compiled: ModuleType) -> None:
    for name in ("own", "other", "constant"):
        with pytest.raises(ValueError, match="all or none"):
            run(compiled, buffers(compiled) | {name: None})


@pytest.mark.parametrize(
    "options",
    [
        {"order": -1},
        {"order": 3},
        {"returns": -1},
        {"returns": 3},
        {"bits": -2},
        {"bits": 2**31},
        {"level": "mmx"},
        {"level": ""},
    ],
)
def test_options_out_of_range_are_refused(compiled: ModuleType, options: dict[str, Any]) -> None:
    with pytest.raises((ValueError, OverflowError), match=r"expected|greater"):
        run(compiled, buffers(compiled), **options)


def test_too_few_arguments_are_refused(compiled: ModuleType) -> None:
    with pytest.raises(TypeError):
        compiled.resolve(compiled.levels()[0], 0, 0, -1)


@pytest.mark.parametrize("arguments", [(), ("",), (None,) * 3, (1,) * 12, ("",) * 40, ("\0", *(0,) * 11)])
def test_arguments_of_another_kind_are_refused_by_every_function(
    compiled: ModuleType, arguments: tuple[object, ...]
) -> None:
    search = import_module("cadtof_cli.resolver.likelihood._likelihood")
    for module in (compiled, search):
        called = {name: one for name, one in vars(module).items() if callable(one) and not name.startswith("_")}
        for name in set(called) - {"levels", "constant_names", "tail_sizes", "tail_constants"}:
            with pytest.raises((TypeError, ValueError)):
                called[name](*arguments)


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), pixels=st.integers(0, 70), seed=st.integers(0, 2**32 - 1))
def test_any_bits_in_buffers_of_any_length_are_an_answer_or_an_error(
    compiled: ModuleType, data: st.DataObject, pixels: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    lengths = data.draw(st.lists(st.sampled_from([0, 0, 0, 0, 0, 0, 0, -1, 1, 31]), min_size=9, max_size=9))
    options = {
        "level": data.draw(st.sampled_from(compiled.levels())),
        "order": data.draw(st.integers(-1, 3)),
        "returns": data.draw(st.integers(-1, 3)),
    }
    stored = data.draw(st.sampled_from(["u2", "i2", "f4", "f8", "c16", "u1"]))
    given: dict[str, Any] = {"constants": _random(rng, "f8", len(compiled.constant_names()))}
    for (name, planes), more in zip(PLANES.items(), lengths, strict=True):
        dtype = np.dtype(stored if name == "stored" else TYPES.get(name, "f8"))
        count = max(0, (2 if dtype.kind == "c" else planes) * pixels + more)
        given[name] = _random(rng, dtype, count)
    for name in ("own", "samples", "metres", "shift"):
        if data.draw(st.booleans()):
            given[name] = None
    if given["own"] is None:
        given["other"] = given["constant"] = None
    fits = not any(
        given[name] is not None and more
        for name, more in zip(PLANES, lengths, strict=True)
        if pixels or more > 0  # a buffer of 0 values cannot be one value shorter
    )
    fits &= options["order"] in range(3) and options["returns"] in range(3) and stored != "u1"
    if fits:
        run(compiled, given, **options)
        return
    with pytest.raises((ValueError, TypeError)):
        run(compiled, given, **options)


def _random(rng: np.random.Generator, dtype: Any, count: int) -> Any:
    """Return `count` values of random bits."""
    return np.frombuffer(bytearray(rng.bytes(np.dtype(dtype).itemsize * count)), dtype)
