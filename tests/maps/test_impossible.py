"""No light gives a phasor longer than the modulation amplitude. A pixel beyond this limit and noise has no answer."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Pulse, Voltage, Waveform
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.kernels import available_kernels
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from tests.support.kernels import by_kernel
from tests.support.mixtures import Mixture, recorded

AMPLITUDE_V = 0.2746
WIDTH = 40


def voltages(
    light: Mixture, *, harmonics: tuple[int, ...] = (1, 2), n_av: float = 1e5, rows: int = 5, seed: int = 0
) -> NDArray[np.float64]:
    """Return the voltages that a camera would record, in V, (H, 2, Y, X)."""
    rng = np.random.default_rng(seed)
    drawn = light.phasors(harmonics, n_av=n_av, size=rows * WIDTH, rng=rng)
    drawn *= np.array([[light.pulse(h)] for h in harmonics])
    return AMPLITUDE_V * np.stack((drawn.real, drawn.imag), axis=1).reshape(len(harmonics), 2, rows, WIDTH)


def resolved(
    stored: Any, *, metadata: CaptureMetadata | None = None, kernel: str | None = None, **options: Any
) -> DepthMaps:
    harmonics = tuple(range(1, 1 + len(getattr(stored, "stored", stored))))
    plan = FramePlan(
        metadata=metadata or recorded(harmonics, n_av=1e5), settings=MapSettings(resolver=ResolverSettings(**options))
    )
    return by_kernel(kernel, resolve_frame, stored, plan=plan).maps


def assert_impossible(maps: DepthMaps) -> None:
    assert (maps.status == StatusBit.IMPOSSIBLE).all()
    assert np.isnan(maps.values).all()


TWO = Mixture((1.0, 0.3), (5.0, 16.0))


@pytest.mark.parametrize("options", [{}, {"order": "1"}, {"order": "2"}, {"solver": "lm"}, {"mpi_model": "discrete"}])
@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 3)])
@pytest.mark.parametrize("factor", [10.0, 1e6])
def test_voltages_beyond_the_modulation_have_no_answer(
    factor: float, harmonics: tuple[int, ...], options: dict[str, Any]
) -> None:
    assert_impossible(resolved(factor * voltages(TWO, harmonics=harmonics), **options))


def test_values_that_overflow_a_map_have_no_answer() -> None:
    stored = np.full((2, 2, 3, WIDTH), 3e38, np.float32)
    assert_impossible(resolved(stored))


def test_a_pulse_longer_than_the_second_period_has_no_answer() -> None:
    """Such a pulse leaves 1.3e-6 of the second harmonic. Divided by that, the voltages are 750,000 times too large."""
    metadata = replace(CaptureMetadata(), pixel=Pixel(integration_length=1e5), pulse=Pulse(fwhm_ns=39.0))
    assert_impossible(resolved(voltages(TWO), metadata=metadata))


@pytest.mark.parametrize("kernel", available_kernels())
def test_an_impossible_pixel_does_not_change_the_others(kernel: str) -> None:
    stored = voltages(TWO)
    sound = resolved(stored, kernel=kernel, mpi_model="discrete")
    spoilt = stored.copy()
    spoilt[:, :, 1, 3:9] *= 20.0
    maps = resolved(spoilt, kernel=kernel, mpi_model="discrete")
    expected = np.zeros(maps.status.shape, np.bool_)
    expected[1, 3:9] = True
    np.testing.assert_array_equal(maps.status == StatusBit.IMPOSSIBLE, expected)
    np.testing.assert_array_equal(maps.values[:, ~expected], sound.values[:, ~expected])
    np.testing.assert_array_equal(maps.status[~expected], sound.status[~expected])


@pytest.mark.parametrize("order", ["auto", "1", "2"])
@pytest.mark.parametrize("n_av", [100.0, 1e3, 1e5])
@pytest.mark.parametrize(
    "light",
    [
        Mixture((1.0,), (5.0,), asr=0.0),
        Mixture((1.0, 0.3), (5.0, 16.0), asr=0.0),
        Mixture((1.0, 0.9), (5.0, 7.0), asr=0.0),
        Mixture((1.0, 1.0), (5.0, 25.0), asr=0.0),
    ],
)
def test_light_without_any_ambient_is_possible(light: Mixture, n_av: float, order: str) -> None:
    metadata = recorded((1, 2), n_av=n_av)
    maps = resolved(voltages(light, n_av=n_av, rows=50), metadata=metadata, order=order, mpi_model="discrete")
    assert not (maps.status & StatusBit.IMPOSSIBLE).any()


@pytest.mark.parametrize("order", ["auto", "1", "2"])
def test_a_triangle_sampled_near_its_peaks_may_exceed_the_modulation_amplitude(order: str) -> None:
    """All laser light comes at one instant; ambient light is a tenth of it.

    Near a peak of the triangle, the recorded voltage is larger than its fundamental, whose amplitude is 8/π².
    """
    metadata = CaptureMetadata(
        modulation=Modulation(waveform="triangle"), pixel=Pixel(integration_length=1e5), pulse=Pulse(fwhm_ns=0.0)
    )
    turns = np.linspace(0.0, 1.0, 5 * WIDTH, endpoint=False)
    first = np.abs(np.mod(np.outer((1.0, 2.0), turns), 1.0) - 0.5) * 4.0 - 1.0
    second = np.abs(np.mod(np.outer((1.0, 2.0), turns) - 0.25, 1.0) - 0.5) * 4.0 - 1.0
    stored = AMPLITUDE_V / 1.1 * np.stack((first, second), axis=1).reshape(2, 2, 5, WIDTH)
    maps = resolved(stored, metadata=metadata, order=order, mpi_model="discrete")
    assert np.isfinite(maps.layer("direct.depth")).all()
    assert maps.layer("confidence").max() > 1.05 * AMPLITUDE_V
    assert_impossible(resolved(2.0 * stored, metadata=metadata, order=order, mpi_model="discrete"))


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_a_value_beyond_single_precision_invalidates_only_its_own_pixel_without_a_warning(waveform: Waveform) -> None:
    """With the default MPI model, a first look at the whole frame meets this value before any pixel is resolved."""
    stored = voltages(TWO)
    stored[0, 1, 2, 3] = 1e300
    metadata = CaptureMetadata(modulation=Modulation(waveform=waveform), pixel=Pixel(integration_length=1e5))
    maps = resolved(stored, metadata=metadata)
    assert np.argwhere(np.isnan(maps.layer("direct.depth"))).tolist() == [[2, 3]]


def test_a_mean_may_exceed_the_modulation_by_less_than_one_recording() -> None:
    """Noise explains an excess of 5 % in one short recording, but not in the mean of a thousand."""
    stored = 1.05 * voltages(Mixture((1.0,), (5.0,), asr=0.0))
    metadata = recorded((1, 2), n_av=1e3)
    assert not (resolved(stored, metadata=metadata).status & StatusBit.IMPOSSIBLE).any()
    samples = np.full(stored.shape[2:], 1000.0)
    mean = resolved(FrameMean(stored, samples, stored.dtype), metadata=metadata)
    assert (mean.status == StatusBit.IMPOSSIBLE | StatusBit.POOLED).all()
    assert np.isnan(mean.layer("direct.depth")).all()


@pytest.mark.parametrize("kernel", available_kernels())
@pytest.mark.parametrize("options", [{}, {"order": "1"}, {"mpi_model": "discrete"}])
def test_a_frame_whose_pixels_all_hold_the_same_values_is_impossible(kernel: str, options: dict[str, Any]) -> None:
    """With noise of 10⁻³ V, 200 pixels never have the same voltages."""
    constant = np.broadcast_to(voltages(TWO)[:, :, :1, :1], (2, 2, 5, WIDTH))
    assert_impossible(resolved(constant.copy(), kernel=kernel, **options))
    assert_impossible(resolved(constant.astype(np.float32), kernel=kernel, metadata=CaptureMetadata(), **options))
    almost = constant.copy()
    almost[0, 0, 2, 3] *= 1.001
    assert not (resolved(almost, kernel=kernel, **options).status & StatusBit.IMPOSSIBLE).any()


def test_counts_may_all_agree_if_a_step_is_larger_than_the_noise() -> None:
    """At n_av 1e5 the noise of a channel is .43 mV. That is seven steps of 60 µV, but a fifth of a step of 2 mV."""
    for volts_per_count, impossible in ((6e-5, True), (2e-3, False)):
        metadata = replace(
            CaptureMetadata(),
            pixel=Pixel(integration_length=1e5),
            voltage=Voltage(zero_counts=0.0, volts_per_count=volts_per_count),
        )
        counts = np.rint(voltages(TWO)[:, :, :1, :1] / volts_per_count).astype(np.int16)
        status = resolved(np.repeat(np.repeat(counts, 5, axis=2), WIDTH, axis=3), metadata=metadata).status
        assert ((status & StatusBit.IMPOSSIBLE) > 0).all() == impossible


def test_pixels_of_a_frame_without_noise_keep_the_reason_why_they_have_no_answer() -> None:
    dark = np.zeros((2, 2, 5, WIDTH))
    assert (resolved(dark).status == StatusBit.LOW_CONFIDENCE).all()
    few = np.broadcast_to(voltages(TWO)[:, :, :1, :1], (2, 2, 3, 5))
    assert not (resolved(few.copy()).status & StatusBit.IMPOSSIBLE).any()


@pytest.mark.parametrize("kernel", available_kernels())
@pytest.mark.parametrize("options", [{}, {"order": "1"}, {"order": "2"}, {"mpi_model": "discrete"}])
def test_a_pixel_has_an_answer_or_a_reason_why_it_has_none(options: dict[str, Any], kernel: str) -> None:
    """One voltage of each pixel is between 1e-10 V and 1e288 V. Beyond about 1e40 V, floating point finds no paths."""
    stored = voltages(TWO)
    exponents = np.arange(200)
    stored.reshape(4, -1)[exponents % 4, exponents] = 10.0 ** (1.5 * exponents - 10.0)
    maps = resolved(stored, kernel=kernel, **options)
    assert np.isfinite(maps.layer("direct.depth")[maps.status == 0]).all()
    assert (maps.status.reshape(-1)[40:] & (StatusBit.NOT_FINITE | StatusBit.IMPOSSIBLE) != 0).all()
