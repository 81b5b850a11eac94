"""Frames of known light whose planes were copied, left out, or stored in another order or with another sign."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli import read_frames
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pulse, Voltage
from cadtof_cli.doubts.frame import doubt_of_planes
from cadtof_cli.doubts.pixels import FEWEST
from cadtof_cli.doubts.planes import mistaken_order, share_of_one_path, wrong_planes
from cadtof_cli.doubts.plausible import no_recording
from cadtof_cli.pipeline.plan import FramePlan

SAMPLES = Path(__file__).parents[2] / "sample_data"

AMPLITUDE_V = 0.2746
COUNTS = Voltage(zero_counts=8192.0, volts_per_count=6e-5, saturated_counts=(0.0, 16383.0))
TWO, THREE = (40.0, 20.0), (40.0, 20.0, 40.0 / 3.0)

Planes = NDArray[np.float64]


def light(
    periods_ns: tuple[float, ...] = TWO, *, mpi: float = 0.2, delay_ns: float = 8.0, pixels: int = 2000, seed: int = 1
) -> Planes:
    """Return voltages, (H, 2, n), of surfaces between 1 and 5 m with a second path, by Eq. (5), with noise of .4 mV."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(1.0, 5.0, pixels) * 2.0 / 0.299792458
    times = np.stack([first, first + delay_ns])[:, np.newaxis]
    shares = np.array([1.0, mpi])[:, np.newaxis, np.newaxis]
    phasors = 0.3 * (shares * np.exp(2j * np.pi * times / np.array(periods_ns)[:, np.newaxis])).sum(axis=0)
    volts = AMPLITUDE_V * np.stack([phasors.real, phasors.imag], axis=1)
    return volts + rng.normal(0.0, 4e-4, volts.shape)


def counts(volts: Planes) -> NDArray[np.uint16]:
    return np.rint(volts / 6e-5 + 8192.0).astype(np.uint16)


def doubt_of_order(
    stored: NDArray[np.generic], periods_ns: tuple[float, ...] = TWO, voltage: Voltage | None = None
) -> str | None:
    """Return the message about the order of the planes for pixels, (H, 2, n), in rows of 50."""
    modulation = Modulation(periods_ns=periods_ns, amplitude_v=AMPLITUDE_V)
    frame = stored.reshape(*stored.shape[:2], -1, 50)
    return mistaken_order(frame, CaptureMetadata(modulation=modulation, voltage=voltage or Voltage()))


@pytest.mark.parametrize("periods_ns", [TWO, THREE])
def test_light_in_the_right_order_is_not_doubted(periods_ns: tuple[float, ...]) -> None:
    volts = light(periods_ns)
    assert doubt_of_order(volts, periods_ns) is None
    assert no_recording(volts, (1, 2, 3)) is None


@pytest.mark.parametrize("periods_ns", [TWO, THREE])
@pytest.mark.parametrize("mpi", [0.0, 0.5, 0.8, 1.0, 2.0])
@pytest.mark.parametrize("delay_ns", [2.0, 5.0, 10.0, 16.0])
def test_the_right_order_is_not_doubted_however_strong_the_second_path_is(
    mpi: float, delay_ns: float, periods_ns: tuple[float, ...]
) -> None:
    assert doubt_of_order(light(periods_ns, mpi=mpi, delay_ns=delay_ns), periods_ns) is None


def test_strong_mpi_is_named_as_well_where_it_may_be_the_cause() -> None:
    """A path of half the light, 13 ns after the direct one, has the phases of SC1 and SC2 swapped."""
    also = (
        " (strong MPI everywhere, or offsets without a calibration, look like that, too): are the planes in the order "
    )
    times_ns = np.array([[7.0], [20.0]]) + np.random.default_rng(3).normal(0.0, 0.02, 4000)
    phasors = np.stack([np.array([1.0, 0.5]) @ np.exp(2j * np.pi * h / 40.0 * times_ns) for h in (1, 2)])
    told = str(doubt_of_order(0.1 * np.stack([phasors.real, phasors.imag], axis=1)))
    assert also in told
    assert also not in str(doubt_of_order(light(TWO)[:, ::-1]))
    mostly_mpi = np.where(np.arange(2000) % 4, light(TWO), light(TWO, mpi=0.9, delay_ns=16.0))
    assert also in str(doubt_of_order(mostly_mpi[:, ::-1]))


def test_hot_pixels_and_fine_meshes_are_no_planes_without_light() -> None:
    """Hot pixels are the same in all planes, which hold little light. Of a mesh, neighbours differ as far pixels do."""
    rng, known = np.random.default_rng(5), CaptureMetadata(modulation=Modulation(amplitude_v=AMPLITUDE_V))
    row, column = np.indices((60, 80))
    phase = 1.0 + 0.5 * column / 80.0
    phasors = 0.01 * np.exp(1j * np.array([1, 2])[:, None, None] * phase)
    volts = AMPLITUDE_V * np.stack([phasors.real, phasors.imag], axis=1) + rng.normal(0.0, 5e-3, (2, 2, 60, 80))
    volts[:, :, rng.random((60, 80)) < 0.005] = 0.3
    assert wrong_planes(volts, known) is None
    near = (row + column) % 9 < 3
    phasors = np.where(near, 0.2, 0.1) * np.exp(1j * np.array([1, 2])[:, None, None] * np.where(near, 0.4, 2.9))
    phasors[:, :20] = 0.0
    volts = AMPLITUDE_V * np.stack([phasors.real, phasors.imag], axis=1) + rng.normal(0.0, 1e-3, (2, 2, 60, 80))
    volts[0, 0] += np.linspace(0.0, 0.5, 80)
    assert wrong_planes(volts, known) is None
    volts[1] = rng.normal(0.0, 1e-3, (2, 60, 80))
    assert str(wrong_planes(volts, known)).startswith("H2.SC1, H2.SC2: found only noise")


def test_planes_of_a_frame_are_looked_at_without_a_copy_of_the_frame() -> None:
    """A run does so with each frame in which few pixels have one path. Orders are views, also those of single pixels."""
    metadata = CaptureMetadata(modulation=Modulation(periods_ns=TWO, amplitude_v=AMPLITUDE_V), voltage=COUNTS)
    for mpi, swapped in ((0.9, False), (0.2, True)):
        frame = counts(light(mpi=mpi, pixels=400_000)[:, :: -1 if swapped else 1]).reshape(2, 2, 500, 800)
        tracemalloc.start()
        told, (_, most) = doubt_of_planes(frame, FramePlan(metadata=metadata)), tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert ("with SC1 and SC2 swapped" in str(told)) == swapped
        assert most < frame.nbytes / 2


@pytest.mark.parametrize("mpi", [0.0, 0.1, 0.2])
@pytest.mark.parametrize(
    ("stored", "words"),
    [
        ([1, 0, 2], "with the planes of H2 and H1 as those of H1 and H2"),
        ([0, 2, 1], "with the planes of H1 and H3 as those of H1 and H2"),
        ([1, 2, 0], "with the planes of H3 and H1 as those of H1 and H2"),
        ([2, 0, 1], "with the planes of H2 and H3 as those of H1 and H2"),
        ([2, 1, 0], "with the harmonics in the opposite order"),
    ],
)
def test_three_harmonics_in_any_other_order_are_doubted(stored: list[int], words: str, mpi: float) -> None:
    """As in planes that are sorted by the names 100MHz, 25MHz, 50MHz."""
    assert f"; {words}, they would in " in str(doubt_of_order(light(THREE, mpi=mpi)[stored], THREE))


@pytest.mark.parametrize("periods_ns", [(8.0, 4.0), (5.0, 2.5)])
def test_a_pulse_that_is_long_for_the_periods_raises_no_doubt(periods_ns: tuple[float, float]) -> None:
    """A pulse of 1.7 ns shortens the second harmonic at 8 and 4 ns by .62 relative to the first. Surfaces are near."""
    rng = np.random.default_rng(5)
    delays_ns = rng.uniform(0.12, 0.25, 2000) * 2.0 / 0.299792458
    waves = 2.0 * np.pi / np.array(periods_ns)[:, np.newaxis]
    phasors = 0.3 * np.exp(1j * waves * delays_ns - 0.5 * (waves * 1.7 / 2.3548) ** 2)
    volts = AMPLITUDE_V * np.stack([phasors.real, phasors.imag], axis=1) + rng.normal(0.0, 4e-4, (2, 2, 2000))
    assert doubt_of_order(volts, periods_ns) is None
    assert doubt_of_order(volts[:, ::-1], periods_ns) is not None


def test_two_equal_paths_a_third_of_a_period_apart_in_every_pixel_are_doubted_wrongly() -> None:
    assert "with the opposite sign" in str(doubt_of_order(light(mpi=1.0, delay_ns=40.0 / 3.0)))


def test_noise_alone_has_no_order() -> None:
    assert doubt_of_order(np.random.default_rng(2).normal(0.0, 4e-4, (2, 2, 4000))) is None


@pytest.mark.parametrize("periods_ns", [TWO, THREE])
def test_channels_and_harmonics_in_another_order_are_doubted(periods_ns: tuple[float, ...]) -> None:
    volts = light(periods_ns)
    assert "; with SC1 and SC2 swapped, they would in " in str(doubt_of_order(volts[:, ::-1], periods_ns))
    assert "with the harmonics in the opposite order" in str(doubt_of_order(volts[::-1], periods_ns))
    channel_first = volts.swapaxes(0, 1).reshape(volts.shape)
    assert "with SC1 of all harmonics before SC2" in str(doubt_of_order(channel_first, periods_ns))


@pytest.mark.parametrize("scene", ["card", "corner", "inter-reflection", "room", "wall"])
def test_scenes_of_few_depths_in_another_order_are_doubted(scene: str) -> None:
    """With few depths in a scene, some pixels of planes in a wrong order look like light of one path by chance."""
    (frame,) = read_frames(SAMPLES / scene)
    stored, channel_first = frame.stored, frame.stored.swapaxes(0, 1).copy()
    assert mistaken_order(stored, frame.metadata) is None
    assert "with SC1 and SC2 swapped" in str(mistaken_order(stored[:, ::-1], frame.metadata))
    assert "with the harmonics in the opposite order" in str(mistaken_order(stored[::-1], frame.metadata))
    assert "with SC1 of all harmonics before SC2" in str(mistaken_order(channel_first, frame.metadata))


@pytest.mark.parametrize("periods_ns", [TWO, THREE])
def test_planes_that_are_interleaved_are_doubted(periods_ns: tuple[float, ...]) -> None:
    volts = light(periods_ns)
    planes = volts.reshape(2 * len(periods_ns), -1, 50)
    by_line, by_pixel = (np.moveaxis(planes, 0, axis).reshape(volts.shape) for axis in (1, 2))
    assert "; interleaved line by line, they would in " in str(doubt_of_order(by_line, periods_ns))
    assert "; interleaved pixel by pixel, they would in " in str(doubt_of_order(by_pixel, periods_ns))


@pytest.mark.parametrize("scene", ["card", "corner", "inter-reflection", "room", "wall"])
def test_planes_that_are_interleaved_with_the_channels_first_are_doubted(scene: str) -> None:
    """A camera that stores C H by line or by pixel, or `fwrite` of a MATLAB array H × C × Y × X."""
    (frame,) = read_frames(SAMPLES / scene)
    after = ", with SC1 of all harmonics before SC2, they would in "
    for axes, words in (
        ((2, 1, 0, 3), "line by line"),
        ((2, 3, 1, 0), "pixel by pixel"),
        ((3, 2, 1, 0), "pixel by pixel"),
    ):
        stored = frame.stored.transpose(axes).reshape(frame.stored.shape)
        assert f"; interleaved {words}{after}" in str(mistaken_order(stored, frame.metadata))


@pytest.mark.parametrize("signs", [((-1, -1), (-1, -1)), ((-1, 1), (-1, 1)), ((1, 1), (-1, -1))])
def test_channels_of_the_opposite_sign_are_doubted(signs: tuple[tuple[int, int], ...]) -> None:
    assert "with the opposite sign" in str(doubt_of_order(light() * np.array(signs)[..., np.newaxis]))


def test_saturated_and_nan_pixels_say_nothing_of_the_order() -> None:
    stored = counts(light()[:, ::-1])
    message = doubt_of_order(stored, voltage=COUNTS)
    assert message is not None
    assert message.startswith(
        "the phases of the harmonics fit each other in only 0% of the pixels; with SC1 and SC2 swapped, they would in 100%"
    )
    stored[0, 0, FEWEST - 1 :] = 16383
    assert doubt_of_order(stored, voltage=COUNTS) is None
    volts = light()[:, ::-1].copy()
    volts[1, 1, ::2] = np.nan
    assert doubt_of_order(volts) == message


def test_one_harmonic_says_nothing_of_an_order() -> None:
    assert doubt_of_order(light((40.0,))[:, ::-1], (40.0,)) is None


@pytest.mark.parametrize(
    ("copied", "onto", "names"),
    [(0, 1, "H1.SC2 holds the same values as H1.SC1"), (1, 5, "H3.SC2 holds the same values as H1.SC2")],
)
def test_a_plane_that_is_stored_twice_is_refused(copied: int, onto: int, names: str) -> None:
    stored = counts(light(THREE))
    planes = stored.reshape(6, -1)
    planes[onto] = planes[copied]
    assert str(no_recording(stored, (1, 2, 3))).startswith(f"{names} in every pixel")
    planes[onto, -1] += 1
    assert no_recording(stored, (1, 2, 3)) is None


def test_planes_may_agree_if_all_but_a_few_pixels_are_saturated() -> None:
    stored = np.full((2, 2, 500), 16383, np.uint16)
    stored[..., :7] = np.arange(8000, 8007)
    assert no_recording(stored, (1, 2)) is None
    stored[..., 7] = 8007
    assert no_recording(stored, (1, 2)) is not None


def test_a_plane_of_one_value_is_refused_if_other_planes_scatter() -> None:
    stored = counts(light())
    stored[1, 0] = 8192
    assert (
        no_recording(stored, (1, 3))
        == "H3.SC1 holds 8192 in every pixel, but the values of other planes differ: this plane was not recorded"
    )
    stored[1, 0, -1] = 8193
    assert no_recording(stored, (1, 3)) is None
    volts = light()
    volts[0, 1] = 0.0
    assert "H1.SC2 holds 0 in every pixel" in str(no_recording(volts, (1, 2)))
    volts[:, 0, 30], volts[1, 1, 7:9] = np.nan, np.inf
    assert "H1.SC2 holds 0 in every pixel" in str(no_recording(volts, (1, 2)))


def test_a_plane_of_one_value_is_accepted_if_a_step_is_wider_than_the_noise() -> None:
    """The frame shows a wall at one distance, in counts of 8 bits whose step is larger than the noise."""
    rng = np.random.default_rng(3)
    stored = np.rint(rng.normal(128.0, 0.2, (2, 2, 500))).astype(np.uint8)
    stored[0, 0] = 128
    assert no_recording(stored, (1, 2)) is None


def test_planes_that_all_hold_one_value_are_not_refused_here() -> None:
    """Whether noise would show in such a frame depends on more than its planes: `implausible` decides."""
    assert no_recording(np.full((2, 2, 500), 8192, np.uint16), (1, 2)) is None
    assert no_recording(np.full((2, 2, 500), np.nan), (1, 2)) is None


def test_planes_of_few_pixels_may_agree() -> None:
    stored = counts(light(pixels=FEWEST - 1))
    stored[1] = stored[0]
    assert no_recording(stored, (1, 2)) is None


@pytest.mark.parametrize(
    ("turned", "ratio", "is_one"),
    [
        (0.0, 1.0, True),
        (0.4, 1.0, True),
        (-0.4, 1.0, True),
        (0.5, 1.0, False),
        (-0.5, 1.0, False),
        (0.0, 1.5, True),
        (0.0, 1.7, False),
        (0.0, 1.0 / 1.5, True),
        (0.0, 1.0 / 1.7, False),
    ],
)
@pytest.mark.parametrize("harmonic", [2, 3])
def test_pixels_look_like_one_path_up_to_a_delay_and_a_weakening(
    turned: float, ratio: float, is_one: bool, harmonic: int
) -> None:
    """A second path turns the second harmonic, and makes it weaker or stronger than the first."""
    phases = np.linspace(0.0, 6.0, 200)
    phasors = np.stack([np.exp(1j * phases), ratio * np.exp(1j * (harmonic * phases + turned))])
    volts = 0.05 * np.stack([phasors.real, phasors.imag], axis=1)
    periods_ns = (40.0, 40.0 / harmonic)
    known = CaptureMetadata(modulation=Modulation(periods_ns=periods_ns), pulse=Pulse(fwhm_ns=0.0))
    assert share_of_one_path(volts, known) == is_one
    assert share_of_one_path(-volts, known, sign=-1.0) == is_one
    half = volts.copy()
    half[:, :, ::2] = np.nan
    assert share_of_one_path(half, known) == is_one
    assert share_of_one_path(half[:, :, :120], known) == 0.0


@pytest.mark.parametrize(("lit", "is_told"), [(0.2, False), (0.4, True), (0.7, True)])
def test_an_order_is_told_if_enough_pixels_fit_it(lit: float, is_told: bool) -> None:
    """The others are dark: in a tenth of them, noise looks like one path, in any order."""
    swapped = light(pixels=8000)[:, ::-1].copy()
    dark = np.arange(8000) % 100 >= 100 * lit
    swapped[:, :, dark] = np.random.default_rng(1).normal(0.0, 4e-4, (2, 2, np.count_nonzero(dark)))
    assert ("with SC1 and SC2 swapped" in str(doubt_of_order(swapped))) == is_told


@pytest.mark.parametrize(("right", "is_told"), [(0.1, True), (0.3, False)])
def test_an_order_is_not_told_if_many_pixels_fit_the_one_that_was_read(right: float, is_told: bool) -> None:
    mixed = light(pixels=4000)
    wrong = np.arange(4000) % 20 >= 20 * right
    mixed[:, :, wrong] = mixed[:, ::-1, wrong]
    assert ("with SC1 and SC2 swapped" in str(doubt_of_order(mixed))) == is_told


@pytest.mark.parametrize(("noise_counts", "is_refused"), [(1.5, False), (3.2, True)])
def test_a_plane_of_one_count_is_refused_if_others_scatter_over_several(noise_counts: float, is_refused: bool) -> None:
    stored = np.rint(np.random.default_rng(3).normal(128.0, noise_counts, (2, 2, 500))).astype(np.uint8)
    stored[0, 0] = 128
    assert (no_recording(stored, (1, 2)) is not None) == is_refused


def test_the_order_that_was_read_is_told_plane_by_plane() -> None:
    told = str(doubt_of_order(light()[:, ::-1]))
    assert told.endswith("are the planes in the order H1.SC1, H1.SC2, H2.SC1, H2.SC2, and are their signs right?")
