"""Recorded frames for Python: read from captures as `cadtof resolve` reads them, or made from an array."""

import difflib
import logging
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import starmap
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import find_captures, placed_captures
from cadtof_cli.capture.frames import FrameSource, frame_names
from cadtof_cli.capture.metadata import KEYS, CaptureMetadata
from cadtof_cli.capture.toml import MetadataSource, load_metadata
from cadtof_cli.doubts.frame import doubts
from cadtof_cli.doubts.mistaken_units import mistaken_unit
from cadtof_cli.doubts.plausible import implausible
from cadtof_cli.errors import CaptureError, FrameError, SettingsError
from cadtof_cli.files.axis_orders import transpositions
from cadtof_cli.files.frames import CHANNELS, SAMPLE_TYPES
from cadtof_cli.pipeline.plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.workflows.recording import FrameReader
from cadtof_cli.workflows.resolve.plans import plan_captures
from cadtof_cli.workflows.resolve.settings import ResolveSettings

Place = str | os.PathLike[str]
"""The path of a file or folder."""

MOST_KINDS = 64
"""Largest number of kinds of frames that are looked at: a program that changes its settings for each frame pays no more."""

_log = logging.getLogger("cadtof_cli")
_kinds: set[object] = set()


@dataclass(frozen=True, eq=False)
class Frame:
    """One recorded frame.

    Attributes:
        stored: recorded values, (H, 2, Y, X), of any type that a file of frames may hold.
        metadata: how the values were recorded: the content of `capture.toml`.
        name: name of the map file that `cadtof resolve` would write for this frame, without suffix.
        source: name of the recorded file, with the position in a stack. The maps name it as their source.
    """

    stored: Stored
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)
    name: str = "frame"
    source: str = ""

    def __post_init__(self) -> None:
        harmonics = len(self.metadata.modulation.harmonics)
        if _masked(self.stored):
            raise FrameError(
                f"{self}: found masked values, expected an array of numbers; fill the masked ones with NaN or a saturated value"
            )
        try:
            # an array that is contiguous and aligned is not copied
            stored = np.require(self.stored, requirements=("C_CONTIGUOUS", "ALIGNED", "ENSUREARRAY"))
        except ValueError as error:
            raise FrameError(f"{self}: found no array of numbers: {error}") from error
        if stored.ndim != 4 or stored.shape[:2] != (harmonics, CHANNELS) or 0 in stored.shape:
            ways = transpositions(("stored", ""), stored.shape, harmonics)
            if stored.ndim == len("PYX") and (ways or stored.shape[0] == CHANNELS * harmonics):
                # the planes on one axis
                planes = f"({harmonics}, {CHANNELS}, Y, X) with its numbers of rows and columns"
                ways = f"{ways}, then .reshape{planes}" if ways else f"planes on one axis: stored.reshape{planes}"
            raise FrameError(
                f"{self}: found an array of shape {stored.shape}, expected ({harmonics}, {CHANNELS}, Y, X): the harmonics "
                f"of modulation.periods_ns, SC1 and SC2, rows, columns{ways and f'; {ways}'}"
            )
        if stored.dtype.name not in SAMPLE_TYPES:
            raise FrameError(f"{self}: found values of type {stored.dtype}, expected one of {', '.join(SAMPLE_TYPES)}")
        object.__setattr__(self, "stored", stored)

    def __str__(self) -> str:
        return self.source or self.name

    def __repr__(self) -> str:
        harmonics, _, height, width = self.stored.shape
        return f"<Frame {self} of {width} × {height} pixels: {harmonics} harmonics, {self.stored.dtype}>"

    @classmethod
    def from_array(
        cls,
        stored: Stored,
        /,
        metadata: Mapping[str, Any] | None = None,
        *,
        settings_file: Place | None = None,
        name: str = "frame",
    ) -> "Frame":
        """Return a frame made from an array in memory, such as from a camera's own driver. A contiguous array is not copied.

        The logger `cadtof_cli` says which values are the paper's, and what is likely wrong, such as planes in another order. It
        says so once, for the first frame with the same settings, size and type.

        Args:
            stored: (H, 2, Y, X): harmonics in the order of the periods, SC1 and SC2, rows, columns. Floats are volts, unless
                `volts_per_count` is given. Whole numbers need `volts_per_count`.
            metadata: values by dotted key of `capture.toml`, such as `{"modulation.periods_ns": [40.0, 20.0]}`.
                Periods, waveform, amplitude and pulse are the paper's if they are not given.
            settings_file: a `capture.toml` with the values that `metadata` does not give.
            name: name of the frame.

        Raises:
            SettingsError: a key does not exist.
            MetadataError: a value is not allowed.
            FrameError: the array has another shape or type, or values that are masked.
        """
        path = None if settings_file is None else Path(settings_file)
        known = load_metadata(path, _overrides(metadata))
        made = cls(stored, known.metadata, name)
        for key in filter(lambda key: key.startswith("layout."), metadata or {}):
            _log.warning(f"{name}: {key} has no effect on an array")
        _log_notes(made.stored, known, of=name)
        return made


def read_frames(
    *inputs: Place,
    metadata: Mapping[str, Any] | None = None,
    settings_file: Place | None = None,
    recursive: bool = False,
    frames: slice | None = None,
) -> Iterator[Frame]:
    """Return an iterator over the recorded frames of folders and files, in the order of `cadtof resolve`.

    Only one frame is in memory at a time. If a frame cannot be read, `next` raises FrameError, and the next call of `next`
    goes on with the frame after it. Assumptions, such as values that default to the paper's, are logged by the logger
    `cadtof_cli`.

    Args:
        inputs: capture folders, and single files.
        metadata: values by dotted key that replace those of `capture.toml`, such as `{"pixel.integration_length": 1e5}`.
        settings_file: a `capture.toml` that is used for all inputs, in place of any other.
        recursive: whether the folders below each input are searched too.
        frames: which frames of each capture, such as `slice(10, 20)`; None: all.

    Raises:
        CadtofError: an input is not a capture, its metadata are not allowed, or a frame cannot be read; the message says why.
    """
    if not all(map(os.fspath, inputs)) or not inputs:
        raise CaptureError(f"read_frames: found {inputs}, expected capture folders or frames")
    if frames is not None and not (isinstance(frames, slice) and _counts_from_0(frames)):
        raise SettingsError(f"read_frames: found frames={frames!r}, expected a slice from 0 on, such as slice(10, 20)")
    # the one-path solver fits every recording; `resolve` checks the options that its caller chooses
    settings = ResolveSettings(
        out=Path(os.devnull),
        maps=MapSettings(resolver=ResolverSettings(solver="one-path")),
        recursive=recursive,
        settings_file=None if settings_file is None else Path(settings_file),
        frames=frames,
    )
    # a generator ends with the first error, `starmap` goes on with the frame after it
    return starmap(_frame_of, _recorded([Path(one) for one in inputs], _overrides(metadata), settings))


def _recorded(
    inputs: list[Path], overrides: Mapping[str, Any], settings: ResolveSettings
) -> Iterator[tuple[FrameReader, FrameSource]]:
    """Yield where each frame lies, and how it is read."""
    found = find_captures(
        inputs, overrides=overrides, settings_file=settings.settings_file, recursive=settings.recursive
    )
    captures, _ = placed_captures(found, inputs)
    for plan in plan_captures(captures, settings, None):
        for note in plan.notes():
            _log.warning(note)
        for (source,) in plan.groups(taken=partial(frame_names, captures)):
            yield plan.reader, source


def _frame_of(reader: FrameReader, source: FrameSource) -> Frame:
    stored = reader.read([source]).stored
    assert stored is not None
    return Frame(stored, reader.metadata, source.name, source.file_name)


def _log_notes(stored: Stored, source: MetadataSource, /, *, of: str) -> None:
    """Log what is assumed about an array, (H, 2, Y, X), and what is likely wrong with it, once for each kind of frame.

    A camera's own driver has no capture, but makes one frame after the other, so the first frame with the same settings, size
    and type stands for all of them. A frame that `resolve` refuses is left to it, and does not count as the first of its kind.
    """
    known = source.metadata
    kind = (known.modulation, known.voltage, known.optics, stored.shape, stored.dtype)
    if kind in _kinds or len(_kinds) >= MOST_KINDS:
        return
    try:
        if implausible(stored, known):
            return
        doubtful = doubts(stored, known)
    except SettingsError:
        return
    _kinds.add(kind)
    if taken := source.defaults_in_words():
        _log.warning(f"{of}: {taken}")
    for doubt in (*doubtful, *filter(None, [mistaken_unit(known, (stored.shape[2], stored.shape[3]))])):
        _log.warning(f"warning: {of}: {doubt}")


def _masked(values: Any, /, *, depth: int = 2) -> bool:
    """Return whether an array has masked values, or an array in a list of (lists of) arrays: planes by harmonic and channel."""
    if isinstance(values, list | tuple):
        return depth > 0 and any(_masked(one, depth=depth - 1) for one in values)
    return bool(np.ma.is_masked(values))


def _counts_from_0(frames: slice) -> bool:
    parts = (frames.start, frames.stop, frames.step)
    return all(part is None or (isinstance(part, int | np.integer) and 0 <= part <= sys.maxsize) for part in parts)


def _overrides(metadata: Mapping[str, Any] | None) -> dict[str, Any]:
    for name in metadata or {}:
        if name not in KEYS:
            meant = [key for key in KEYS if key.endswith(f".{name}") or key.startswith(f"{name}.")]
            named = meant or difflib.get_close_matches(str(name), KEYS, n=1) or sorted(KEYS)[:3]
            raise SettingsError(f"metadata: found {name!r}, expected keys such as {', '.join(named)}, …")
    return {name: _plain(value) for name, value in (metadata or {}).items()}


def _plain(value: Any) -> Any:
    """Return numbers and arrays of numpy, also in a list, as what `capture.toml` would hold."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value
