"""What every `cadtof calibrate` step has in common: captures → mean frames, earlier parts of the calibration, the report."""

import itertools
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float, Stored
from cadtof_cli.calibration.parts import PART_KINDS, Origin, PartKind
from cadtof_cli.calibration.store import Calibration, Part, digest_of, load_calibration, save_part
from cadtof_cli.capture.checks import shown
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture, single_frames
from cadtof_cli.capture.metadata import KEYS, CaptureMetadata, Target, Voltage
from cadtof_cli.doubts.camera import other_offsets
from cadtof_cli.doubts.frame import doubts
from cadtof_cli.doubts.mistaken_units import mistaken_unit
from cadtof_cli.doubts.planes import mistaken_order
from cadtof_cli.doubts.plausible import Copies
from cadtof_cli.errors import FrameError, OutputError, SettingsError
from cadtof_cli.files.atomic import require_new
from cadtof_cli.files.frames import CHANNELS
from cadtof_cli.files.reading import real_path
from cadtof_cli.phasors.frame_mean import MeanVolts, mean_volts
from cadtof_cli.phasors.noise import ambient_noise_v
from cadtof_cli.records import setting
from cadtof_cli.units import size_text
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.recording import FrameReader, named

ASSUMED_LENGTH = 1e5
"""Integration length n_av for predicting the noise of a frame if the metadata do not give it."""

MOST_SCATTER = 1.5
"""Largest scatter of the typical pixel over its frames, in units of the noise, that is not warned of."""

LEAST_FREEDOM = 100
"""Least number of deviations from the mean, in a harmonic, that show its scatter well enough for the warning."""


@dataclass(frozen=True, kw_only=True)
class CalibrateSettings:
    """Where a part is written, and facts about its captures.

    `distances_m` are those of the targets in m: one for all captures, or one each; empty: those in `capture.toml`. A
    `settings_file` replaces any `capture.toml`, and `overrides`, values by dotted key, replace those of any.
    """

    out: Path = setting(MISSING, "Calibration folder; this part is added to it.", option="-o --out")
    overwrite: bool = setting(False, "Replace this part if the folder already has it.")
    distances_m: tuple[float, ...] = ()
    settings_file: Path | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Averaged:
    """The data that a part is measured from: each capture with the mean of its frames, in V, and the origin of the part.

    `earlier` are the parts in the calibration folder that are to be applied to the means first; None: there are none.
    """

    captures: Sequence[tuple[Capture, MeanVolts]]
    earlier: Calibration | None
    origin: Origin


@dataclass(frozen=True)
class CalibrateReport:
    """The result of a step: what was measured as `figures` by name, and `findings` about them in words."""

    part: PartKind
    written: tuple[str, ...]
    digest: str
    frames: int
    figures: Mapping[str, Any]
    findings: tuple[str, ...]


def averaged_captures(
    inputs: Sequence[Path], kind: PartKind, /, *, settings: CalibrateSettings, progress: Progress
) -> Averaged:
    """Read every frame of the captures, and the earlier parts in the folder. Distances in the settings replace the metadata's.

    Raises:
        CadtofError: the part is there already, its folder is that of a capture, an input or its metadata is at fault, a frame
            cannot be read, or captures and earlier parts are not all of one camera with one setting.
    """
    require_new(settings.out / f"{kind}.toml", overwrite=settings.overwrite)
    captures = find_captures(inputs, overrides=settings.overrides, settings_file=settings.settings_file)
    if real_path(settings.out) in {real_path(one.root) for one in captures}:
        raise OutputError(
            f"{settings.out}: the calibration would be written among recorded frames; choose another folder with -o"
        )
    captures = _at_distances(captures, settings.distances_m) if settings.distances_m else captures
    _require_same_modulation(captures)
    progress.advance(0, total=sum(len(one.frames) * (one.typical.frames if one.typical else 1) for one in captures))
    averaged: list[tuple[Capture, MeanVolts]] = []
    has_light, has_dark = kind == "response", os.path.lexists(settings.out / "dark.toml")
    for capture in captures:
        if taken := capture.source.defaults_in_words():
            progress.say(f"{capture.root}: {taken}")
        frames = _frames(capture, progress, has_light=has_light, of_order=not has_dark)
        with named(capture):
            mean = mean_volts(frames, voltage=capture.source.metadata.voltage)
        # all captures have the same periods and optics
        of_unit = None if averaged else mistaken_unit(capture.source.metadata, mean.pixels)
        for told in filter(None, (_too_much_scatter(capture, mean), of_unit)):
            progress.say(f"warning: {capture.root}: {told}")
        first, expected = averaged[0] if averaged else (capture, mean)
        if mean.pixels != expected.pixels:
            here, there = size_text(mean.pixels), size_text(expected.pixels)
            raise SettingsError(f"{capture.root}: found {here} pixels, expected {there} as in {first.root}")
        averaged.append((capture, mean))
    metadata, pixels = captures[0].source.metadata, averaged[0][1].pixels
    earlier = _earlier_parts(settings.out, kind, metadata, pixels, progress)
    for one, mean in averaged:
        for doubt in earlier.doubts(one.source.metadata) if earlier else ():
            progress.say(f"warning: {one.root}: {doubt}")
        if dark := earlier and earlier.dark:
            in_volts = replace(one.source.metadata, voltage=Voltage())
            # offsets of all pixels look like another order, and planes in another order have other offsets
            order = mistaken_order(mean.volts - dark.offset_v, in_volts) if has_light else None
            if found := order or other_offsets(mean.volts, in_volts, dark.sound_offset_v, dark.offset_stderr_v()):
                progress.say(f"warning: {one.root}: {found}")
    origin = Origin(
        captures=tuple(str(one.root) for one in captures),
        frames=sum(mean.frames for _, mean in averaged),
        pixels=pixels,
        periods_ns=metadata.modulation.periods_ns,
        waveform=metadata.modulation.waveform,
        used=earlier.digests if earlier else {},
    )
    return Averaged(averaged, earlier, origin)


def predicted_noise_v(metadata: CaptureMetadata, /) -> Float:
    """Return the standard deviation of a channel of one frame in V at each harmonic, (H,), for too few frames to measure it."""
    given = metadata.pixel.integration_length
    lengths = given if isinstance(given, tuple) else (given or ASSUMED_LENGTH,) * len(metadata.modulation.harmonics)
    return np.array([ambient_noise_v(metadata, integration_length=length) for length in lengths])


def length_in_words(metadata: CaptureMetadata, /) -> str:
    """Return the integration length, or those of the harmonics."""
    given = metadata.pixel.integration_length
    if given is None:
        return f"{ASSUMED_LENGTH:g}, as none is given"
    return ", ".join(f"{length:g}" for length in given) if isinstance(given, tuple) else f"{given:g}"


def _frames(capture: Capture, progress: Progress, *, has_light: bool, of_order: bool) -> Iterator[Stored]:
    """Yield the frames of a capture. Warn if the first is likely wrong; `has_light`: look at its size and planes too, and
    `of_order`: at their order.

    Raises:
        FrameError: a frame cannot be read or is no recording; or it is a copy of an earlier frame, which would make the
            noise that is measured too small.
    """
    reader, copies = FrameReader.of(capture), Copies()
    for number, source in enumerate(single_frames(capture, typical=capture.typical)):
        stored, digest = reader.one(source)
        if original := copies.original_of(stored, digest, source):
            raise FrameError(
                f"{source}: holds the same values as {original} in every pixel, but noise makes two recordings differ: "
                "remove the copy, or record again"
            )
        if number == 0:
            for doubt in doubts(stored, reader.metadata, has_light=has_light, of_order=of_order):
                progress.say(f"warning: {capture.root}: {doubt}")
        yield stored
        progress.advance()


def _too_much_scatter(capture: Capture, mean: MeanVolts) -> str | None:
    """Return in words that the frames of a capture differ by far more than noise; None: they do not, or it cannot be told."""
    n_av = capture.source.metadata.pixel.integration_length
    if n_av is None or CHANNELS * np.count_nonzero(mean.sound) * (mean.frames - 1) < LEAST_FREEDOM:
        return None
    lengths = length_in_words(capture.source.metadata)
    each = np.hypot(predicted_noise_v(capture.source.metadata), mean.step / math.sqrt(12.0))
    worst = int(np.argmax(mean.frame_noise() / each))
    seen, expected = float(mean.frame_noise()[worst]), float(each[worst])
    if seen <= MOST_SCATTER * expected:
        return None
    return (
        f"its frames differ by {1000.0 * seen:.3g} mV per channel, {seen / expected:.1f} times what integration_length = "
        f"{lengths} explains: a frame of another scene is among them, something changed meanwhile (light, temperature, "
        "settings), or integration_length is not that of the camera; the mean of such frames may be wrong"
    )


def _at_distances(captures: Sequence[Capture], distances: tuple[float, ...]) -> tuple[Capture, ...]:
    """Return captures with their targets at these distances: one for all captures, or one each."""
    if len(distances) not in {1, len(captures)}:
        raise SettingsError(
            f"--distance: found {len(distances)} distances for {len(captures)} captures, expected one for all, or one each in "
            "the order of the captures"
        )
    described = []
    for one, distance in zip(captures, distances * (len(captures) // len(distances)), strict=True):
        metadata = replace(one.source.metadata, target=Target(distance_m=distance))
        described.append(replace(one, source=replace(one.source, metadata=metadata)))
    return tuple(described)


def _require_same_modulation(captures: Sequence[Capture]) -> None:
    keys = [key for key in KEYS.values() if key.table in {"modulation", "pulse", "optics"}]
    for capture, key in itertools.product(captures[1:], keys):
        values = [key.value_in(one.source.metadata) for one in (capture, captures[0])]
        if values[0] != values[1]:
            found, expected = ("not given" if value is None else shown(value) for value in values)
            raise SettingsError(
                f"{capture.root}: {key.path} is {found}, expected {expected} as in {captures[0].root}: all captures of a "
                "calibration need the same camera settings"
            )


def _earlier_parts(
    folder: Path, kind: PartKind, metadata: CaptureMetadata, pixels: tuple[int, int], progress: Progress
) -> Calibration | None:
    """Return the parts in the folder that are applied before this kind of part, and say which they are; None: there are none."""
    earlier = PART_KINDS[: PART_KINDS.index(kind)]
    if not any(os.path.lexists(folder / f"{name}.toml") for name in earlier):
        if earlier:
            progress.say(f"{folder}: no {' or '.join(earlier)} calibration there, so none is applied to the frames")
        return None
    parts = load_calibration(folder, kinds=earlier)
    parts.require_match(metadata, pixels)
    progress.say(f"applied to the frames first: {', '.join(part.kind for part in parts.parts)} of {folder}")
    return parts


def save_with_report(
    part: Part, settings: CalibrateSettings, figures: Mapping[str, Any], findings: tuple[str, ...], /
) -> CalibrateReport:
    """Write a part and return the report on it."""
    written = tuple(map(str, save_part(settings.out, part, overwrite=settings.overwrite)))
    return CalibrateReport(part.kind, written, digest_of(part), part.origin.frames, dict(figures), findings)
