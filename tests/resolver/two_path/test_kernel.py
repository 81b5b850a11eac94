"""The compiled kernel gives numpy's maps, bit for bit, with every instruction set, even for numerically hard pixels."""

import json
import math
import sys
from dataclasses import fields, replace
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.metadata import CaptureMetadata, Optics, Pixel, Voltage
from cadtof_cli.errors import SettingsError
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.phasors.voltages import PhasorMap
from cadtof_cli.pipeline.frame import prepare_frame, resolve_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan, MapSettings
from cadtof_cli.resolver import two_path
from cadtof_cli.resolver.kernels import CHOICE, NUMPY, available_kernels, chosen_kernel, extension, numpy_note
from cadtof_cli.resolver.settings import ORDERS, RETURNS, ResolverSettings, Return
from cadtof_cli.resolver.two_path import kernel as front
from tests.resolver.compiled import bits_of, compiled_kernels
from tests.support.calibrations import made_up_calibration
from tests.support.captures import record
from tests.support.hard_pixels import HARD
from tests.support.kernels import by_kernel
from tests.support.run_cadtof import cadtof, program

FLOATS = CaptureMetadata(pixel=Pixel(integration_length=1e5))
COUNTS = replace(FLOATS, voltage=Voltage(zero_counts=8192.0, volts_per_count=6.0e-5, saturated_counts=(0.0, 16383.0)))

WIDTH = 97

pytestmark = pytest.mark.usefixtures("compiled")


def frame(planes: NDArray[Any], width: int = WIDTH) -> NDArray[Any]:
    """Return four planes of values, (4, n), as a frame (2, 2, Y, X)."""
    return planes.reshape(2, 2, -1, width)


def hard_voltages(name: str, pixels: int, seed: int = 3) -> NDArray[np.float64]:
    """Return SC1 and SC2 of both harmonics, in V, (4, n)."""
    p1, p2 = HARD[name](np.random.default_rng(seed), pixels)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([p1.real, p1.imag, p2.real, p2.imag]) * FLOATS.modulation.amplitude_v


def counts(dtype: str = "u2", pixels: int = 20 * WIDTH, seed: int = 4) -> NDArray[Any]:
    """Return counts of a camera, (2, 2, Y, X): two paths with noise; some pixels are saturated or at zero counts."""
    rng = np.random.default_rng(seed)
    volts = np.concatenate([hard_voltages(name, pixels // 2, seed) for name in ("close_paths", "faint")], axis=1)
    stored = 8192.0 + 0.3 * volts / 6.0e-5 + rng.normal(scale=7.0, size=volts.shape)
    stored[:, rng.integers(0, pixels, pixels // 50)] = 16383
    stored[:, rng.integers(0, pixels, pixels // 50)] = 8192
    return frame(np.clip(np.rint(stored), 0, 16383).astype(dtype))


def assert_same_bits(stored: Any, plan: FramePlan, calibration: Calibration | None = None) -> DepthMaps:
    """Resolve by numpy and by every compiled kernel, compare every bit, and return the maps."""
    maps = by_kernel(NUMPY, resolve_frame, stored, plan=plan, calibration=calibration).maps
    for kernel in compiled_kernels():
        found = by_kernel(kernel, resolve_frame, stored, plan=plan, calibration=calibration).maps
        np.testing.assert_array_equal(bits_of(found), bits_of(maps), err_msg=kernel)
    return maps


def plan_of(metadata: CaptureMetadata = FLOATS, **options: Any) -> FramePlan:
    of_maps = {name: options.pop(name) for name in ("depth", "pool", "average", "min_confidence_v") if name in options}
    return FramePlan(metadata=metadata, settings=MapSettings(resolver=ResolverSettings(**options), **of_maps))


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("returns", RETURNS)
def test_hard_pixels_have_the_same_bits(name: str, order: str, returns: Return) -> None:
    volts = frame(hard_voltages(name, 20 * WIDTH))
    assert_same_bits(volts, plan_of(order=order, returns=returns))
    with np.errstate(over="ignore", invalid="ignore"):
        assert_same_bits(volts.astype(np.float32), plan_of(order=order, returns=returns))


@pytest.mark.parametrize("false_alarm", [0.5, 0.01, 1e-6])
@pytest.mark.parametrize("integration_length", [1e3, 1e5])
def test_pixels_between_one_path_and_two_have_the_same_bits(false_alarm: float, integration_length: float) -> None:
    # Pixels are roughly sorted by their distance from light of one path, so that groups of 32 go from one path to two.
    # But one pixel of each group has two paths for certain.
    rng, n = np.random.default_rng(5), 32 * 640
    a, x, apart = 10 ** rng.uniform(-1.0, -0.2, n), rng.uniform(0, 2 * np.pi, n), rng.uniform(-np.pi, np.pi, n)
    b = a * 10 ** rng.uniform(-2.5, 0, n)
    harmonics = [a * np.exp(1j * h * x) + b * np.exp(1j * h * (x + apart)) for h in (1, 2)]
    distance = np.abs(np.abs(harmonics[0]) - harmonics[1] * np.exp(-2j * np.angle(harmonics[0])))
    order = np.argsort(distance * rng.uniform(0.97, 1.03, n))
    order = np.column_stack([order[-n // 32 :], order[: -n // 32].reshape(-1, 31)]).ravel()
    planes = np.stack([part[order] for phasor in harmonics for part in (phasor.real, phasor.imag)])
    metadata = CaptureMetadata(pixel=Pixel(integration_length=integration_length))
    volts = (planes * metadata.modulation.amplitude_v).astype(np.float32)
    maps = assert_same_bits(frame(volts, 32), plan_of(metadata, false_alarm=false_alarm, mpi_model="discrete"))
    assert min(np.count_nonzero(maps.status & bit) for bit in (8, 16)) > n // 20


OPTIONS: list[dict[str, Any]] = [
    {"min_return_ratio": 0.0},
    {"min_return_ratio": 0.7},
    {"min_return_ratio": 1.0, "returns": "last"},
    {"min_confidence_v": 0.0},
    {"min_confidence_v": 0.01},
    {"false_alarm": 0.5},
    {"false_alarm": 1e-9},
    {"solver": "one-path"},
    {"paths": 1},
]


def test_every_option_of_the_resolver_is_compared() -> None:
    """An option that only numpy follows would have no effect on most frames."""
    # min_confidence_v sets min_confidence, and tests/resolver/diffuse compares the models of MPI; the others are of lm
    elsewhere = {"order", "returns", "min_confidence", "mpi_model", "starts", "seed"}
    lost = {one.name for one in fields(ResolverSettings)}.difference(elsewhere, *OPTIONS)
    assert not lost, f"add {', '.join(lost)} to OPTIONS: the kernel has to follow it (kernel.py: shared_constants)"


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("options", OPTIONS)
def test_options_have_the_same_bits(name: str, options: dict[str, Any]) -> None:
    assert_same_bits(frame(hard_voltages(name, 5 * WIDTH)), plan_of(**options))


@pytest.mark.parametrize("dtype", ["u1", "u2", "i2", ">u2", ">i2", "u4", "i4", "f2", "f4", ">f4", "f8", ">f8"])
def test_every_type_of_stored_values_has_the_same_bits(dtype: str) -> None:
    stored = counts("u2")
    if dtype == "u1":
        metadata = replace(
            COUNTS, voltage=Voltage(zero_counts=128.0, volts_per_count=4e-3, saturated_counts=(0.0, 255.0))
        )
        maps = assert_same_bits((stored // 64).astype(dtype), plan_of(metadata))
    else:
        maps = assert_same_bits(stored.astype(dtype), plan_of(COUNTS))
    assert set(np.unique(maps.status)) >= {1, 4}


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8"])
def test_limits_of_saturation_that_are_rounded_saturate_the_same_pixels(dtype: str) -> None:
    metadata = replace(FLOATS, voltage=Voltage(saturated_counts=(-0.3, 0.7)))
    stored = np.random.default_rng(1).choice(np.array([-0.3, 0.7, 0.1, np.nan, np.inf]), (4, 5 * WIDTH)).astype(dtype)
    maps = assert_same_bits(frame(stored), plan_of(metadata))
    beyond = (stored <= stored.dtype.type(-0.3)) | (stored >= stored.dtype.type(0.7))
    np.testing.assert_array_equal(maps.status.ravel() & 1, beyond.any(axis=0))


@pytest.mark.parametrize("returns", RETURNS)
@pytest.mark.parametrize("depth", ["range", "z"])
@pytest.mark.parametrize("parts", [("dark",), ("response",), ("petzval",), ("dark", "response", "petzval")])
def test_calibrated_pixels_have_the_same_bits(returns: Return, depth: str, parts: tuple[str, ...]) -> None:
    stored = counts()
    metadata = replace(COUNTS, optics=Optics(focal_length_px=80.0))
    calibration = made_up_calibration(metadata, (stored.shape[2], WIDTH), parts)
    plan = replace(
        plan_of(metadata, returns=returns, depth=depth), calibration=CalibrationUse(Path("made up"), calibration.digest)
    )
    maps = assert_same_bits(stored, plan, calibration)
    assert (maps.status & 64).all()
    assert bool((maps.status & 256).any()) == ("dark" in parts)


@pytest.mark.parametrize("pool", [1, 3])
def test_means_over_frames_and_neighbours_have_the_same_bits(pool: int) -> None:
    stored = counts("f4")
    samples = np.random.default_rng(6).integers(1, 9, stored.shape[2:]).astype(np.float64)
    mean = FrameMean(stored.astype(np.float64), samples, stored.dtype)
    for order in ORDERS:
        maps = assert_same_bits(mean, plan_of(COUNTS, pool=pool, average=8, order=order))
        assert (maps.status & 1024).any()
        assert maps.layer("effective_pixels").max() >= samples.max()
    assert_same_bits(stored, plan_of(COUNTS, pool=pool))


def test_a_frame_with_estimated_noise_has_the_same_bits() -> None:
    assert_same_bits(counts(), plan_of(replace(COUNTS, pixel=Pixel(integration_length=None))))


@pytest.mark.parametrize("cut", [1, 7, 31, 32, 33, 1000])
@pytest.mark.parametrize("name", ["close_paths", "special_values"])
def test_a_pixel_has_the_same_bits_wherever_a_part_begins_and_ends(cut: int, name: str) -> None:
    plan = plan_of()
    stored = frame(hard_voltages(name, 12 * WIDTH))
    stages = stages_of(stored, plan)
    pixels = prepare_frame(stored, stages)
    for kernel in available_kernels():
        whole = bits_of(by_kernel(kernel, resolve_pixels, pixels, stages))
        parts = [pixels[:cut], pixels[cut : cut + 95], pixels[cut + 95 :]]
        joined = [bits_of(by_kernel(kernel, resolve_pixels, part, stages)) for part in parts]
        np.testing.assert_array_equal(np.concatenate(joined, axis=-1), whole)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(*[st.floats(width=64)] * 4), min_size=1, max_size=70),
    st.sampled_from(ORDERS),
    st.sampled_from(RETURNS),
)
def test_any_voltages_have_the_same_bits(pixels: list[tuple[float, ...]], order: str, returns: Return) -> None:
    stored = np.array(pixels).T.reshape(2, 2, 1, -1)
    assert_same_bits(stored, plan_of(order=order, returns=returns))
    with np.errstate(over="ignore"):
        assert_same_bits(stored.astype(np.float32), plan_of(order=order, returns=returns))


@settings(max_examples=100)
@given(st.lists(st.tuples(*[st.integers(0, 65535)] * 4), min_size=1, max_size=70))
def test_any_counts_have_the_same_bits(pixels: list[tuple[int, ...]]) -> None:
    stored = np.array(pixels, np.uint16).T.reshape(2, 2, 1, -1)
    assert_same_bits(stored, plan_of(COUNTS))
    assert_same_bits(stored.view(np.int16), plan_of(COUNTS))


def test_the_stored_values_are_not_changed() -> None:
    stored, plan = counts(), plan_of(COUNTS)
    before = stored.copy()
    stored.flags.writeable = False
    resolve_frame(stored, plan=plan)
    np.testing.assert_array_equal(stored, before)


def front_of(**other: Any) -> tuple[NDArray[Any], front.KernelScales, dict[str, Any]]:
    """Return 40 stored pixels, the scales, and the other arguments of `fill`; those named in `other` are replaced."""
    plan = plan_of()
    stored = frame(np.zeros((4, 40)), 40)
    noise = prepare_frame(stored, stages_of(stored, plan)).noise
    parts: dict[str, Any] = {"phasor_map": None}
    parts |= {"saturated_counts": None, "metres": 1.0, "volts": 1.0, "phase_offset_rad": None}
    parts |= {"tail": None, "most_volts": np.inf, "noise_volts": 0.0}
    rest: dict[str, Any] = {"layers": np.zeros((7, 40), np.float32), "status": np.zeros(40, np.uint32)}
    rest |= {"settings": plan.resolver, "noise": noise}
    return (
        other.pop("stored", np.zeros((2, 40), np.complex128)),
        front.KernelScales(**parts | {name: value for name, value in other.items() if name in parts}),
        rest | {name: value for name, value in other.items() if name not in parts},
    )


def fill(stored: NDArray[Any], scales: front.KernelScales, /, *, settings: Any, noise: Any, **rest: Any) -> None:
    kernel = front.FrameKernel(scales, settings=settings, noise=noise, count=40, source_type=stored.dtype)
    kernel.fill(stored, **rest)


@pytest.mark.parametrize(
    "other",
    [
        {"stored": np.zeros((2, 41), np.complex128)},
        {"stored": np.zeros((3, 40), np.complex128)},
        {"stored": np.zeros((2, 2, 40))},
        {"layers": np.zeros((6, 40), np.float32)},
        {"layers": np.zeros((7, 80), np.float32)[:, ::2]},
        {"layers": np.zeros((7, 40))},
        {"status": np.zeros((2, 40), np.uint32)},
        {"status": np.zeros(40, np.int64)},
        {"metres": np.ones(39)},
        {"metres": np.ones(40, np.float32)},
        {"phase_offset_rad": np.ones((1, 40))},
    ],
)
def test_the_front_refuses_arguments_that_do_not_fit(other: dict[str, Any]) -> None:
    stored, scales, rest = front_of(**other)
    with pytest.raises((ValueError, TypeError)):
        fill(stored, scales, **rest)


@pytest.mark.parametrize("missing", ["other", "constant"])
def test_the_front_refuses_maps_of_pixels_that_lack_a_part(missing: str) -> None:
    """The kernel reads all three parts of a map if pixels have maps of their own."""
    parts: dict[str, Any] = {name: np.ones((2, 2, 40)) for name in ("own", "other", "constant") if name != missing}
    stored, scales, rest = front_of(stored=np.zeros((2, 2, 40), np.uint16), phasor_map=PhasorMap(**parts))
    with pytest.raises(ValueError, match="without other or constant"):
        fill(stored, scales, **rest)


def test_the_front_takes_arguments_that_fit() -> None:
    stored, scales, rest = front_of()
    fill(stored, scales, **rest)
    assert (rest["status"] == 4).all()
    assert np.isnan(rest["layers"][:6]).all()


@settings(max_examples=50)
@given(st.lists(st.integers(0, 2**32 - 1), max_size=70), st.sampled_from([1, 2, 3, 100]))
def test_pixels_are_counted_as_numpy_does(bits: list[int], repeats: int) -> None:
    status = np.array(bits, np.uint32).repeat(repeats)
    for view in (status, status[::2], status[::-1], status.reshape(1, -1)):
        assert front.count_status(view) == by_kernel(NUMPY, front.count_status, view)


def test_status_of_another_type_is_not_counted(compiled: ModuleType) -> None:
    for wrong in (np.zeros(4, np.int32), np.zeros(4, np.float32), np.zeros(4, np.uint64)):
        with pytest.raises(TypeError, match="status"):
            compiled.count_status(available_kernels()[0], wrong)
    with pytest.raises(ValueError, match="mmx"):
        compiled.count_status("mmx", np.zeros(4, np.uint32))


def test_each_constant_that_the_kernel_reads_has_a_value(compiled: ModuleType) -> None:
    _, _, rest = front_of()
    constants = front.shared_constants(rest["settings"], rest["noise"].each)
    assert set(compiled.constant_names()) > set(constants)
    assert not [name for name, value in constants.items() if math.isnan(value)]


@pytest.mark.parametrize(("damaged", "why"), [(True, "it cannot be loaded: "), (False, "cadtof was installed without")])
def test_the_note_says_why_numpy_runs(damaged: bool, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if damaged:
        (tmp_path / f"_kernel{EXTENSION_SUFFIXES[0]}").write_text("no library")
    monkeypatch.setattr(two_path, "__path__", [str(tmp_path)])
    monkeypatch.delitem(sys.modules, f"{two_path.__name__}._kernel", raising=False)
    extension.cache_clear()
    try:
        assert available_kernels() == (NUMPY,)
        assert f"but slower ({why}" in numpy_note()
        assert (str(tmp_path) in numpy_note()) is damaged
    finally:
        extension.cache_clear()


def test_the_environment_chooses_among_available_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen_kernel.cache_clear()
    monkeypatch.setenv(CHOICE, NUMPY)
    assert chosen_kernel() == NUMPY
    assert "asks" in numpy_note()
    chosen_kernel.cache_clear()
    monkeypatch.setenv(CHOICE, "mmx")
    with pytest.raises(SettingsError, match=r"CADTOF_KERNEL: found 'mmx', expected one of .*numpy"):
        chosen_kernel()
    monkeypatch.delenv(CHOICE)
    assert chosen_kernel() == available_kernels()[0] != NUMPY


WITHOUT_EXTENSION = (
    "import sys; sys.modules['cadtof_cli.resolver.two_path._kernel'] = None\n"
    "from cadtof_cli.cli import main\n"
    "sys.argv = ['cadtof', *sys.argv[sys.argv.index('cadtof_cli') + 1 :]]\n"
    "main()"
)


def test_without_the_extension_the_files_are_the_same_and_one_line_says_that_it_is_missing(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2).folder
    assert cadtof("resolve", capture, "-o", tmp_path / "fast", "-j", "1").status == 0
    done = program(
        "resolve", capture, "-o", tmp_path / "slow", "-j", "1", before=(sys.executable, "-c", WITHOUT_EXTENSION)
    )
    assert done.status == 0, done.err
    notes = [line for line in done.err.splitlines() if "numpy" in line]
    assert len(notes) == 1
    assert "without a C compiler" in notes[0]
    kernels = [json.loads((tmp_path / run / "run.json").read_text())["kernel"] for run in ("fast", "slow")]
    assert kernels == [available_kernels()[0], NUMPY]
    for name in ("frame_0.tif", "frame_1.tif"):
        assert (tmp_path / "fast" / name).read_bytes() == (tmp_path / "slow" / name).read_bytes()
