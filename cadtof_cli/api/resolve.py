"""Frames → maps for Python, by the functions that `cadtof resolve` uses, so with the same bits."""

import logging
import os
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np

from cadtof_cli.api.frames import Frame
from cadtof_cli.api.maps import Maps
from cadtof_cli.api.values import as_declared
from cadtof_cli.arrays import Stored
from cadtof_cli.calibration.store import current_calibration
from cadtof_cli.doubts.plausible import Copies, require_plausible
from cadtof_cli.errors import FrameError, SettingsError
from cadtof_cli.files.digests import content_digest
from cadtof_cli.files.maps import STATUS
from cadtof_cli.phasors.frame_mean import FrameMean, frame_mean
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import CalibrationUse, DepthKind, FramePlan, MapSettings
from cadtof_cli.resolver.settings import MpiModel, ResolverSettings, Return, SolverName
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.workflows.resolve.frame_task import answered_maps

_log = logging.getLogger("cadtof_cli")


class ResolverOptions(TypedDict, total=False):
    """Options for how phasors become paths: the fields of `ResolverSettings`, which gives their meanings and defaults."""

    mpi_model: MpiModel
    solver: SolverName
    paths: int
    order: str
    starts: int
    seed: int
    false_alarm: float
    returns: Return
    min_return_ratio: float


class ResolveOptions(ResolverOptions, total=False):
    """All options of `resolve`: the fields of `ResolverSettings` and of `MapSettings`."""

    depth: DepthKind
    pool: int
    roi: tuple[int, int, int, int] | None
    min_confidence_v: float | None


# the answer must not depend on how the caller treats rounding to 0: numpy's own default, as in the command
@np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
def resolve(
    frame: Frame | Sequence[Frame],
    /,
    *,
    calibration: str | os.PathLike[str] | None = None,
    **options: Unpack[ResolveOptions],
) -> Maps:
    """Return the maps of a recorded frame, or of the mean of several frames, with the same bits as `cadtof resolve` writes.

    Args:
        frame: a frame; or several frames of one capture, whose mean is resolved, as with `--average`. A frame that holds the
            same values as another one is left out of the mean, and the logger `cadtof_cli` names it.
        calibration: folder made by `cadtof calibrate`.
        options: options of `cadtof resolve` under the names of the settings records, such as `solver="lm"`, `pool=5`,
            `depth="z"`, `returns="strongest"`, `min_confidence_v=0.001`. The defaults are those of the command.

    Returns:
        Named layers, float32 (Y, X) in m and V, NaN if a pixel has no answer; the bits in `status` say why.

    Raises:
        SettingsError: an option is not allowed, or does not fit the frame.
        MetadataError: the calibration cannot be read.
        FrameError: values cannot be voltages, no pixel has an answer, or the frames are not of one capture.
    """
    frames = _frames(frame)
    first = frames[0]
    pixels = first.stored.shape[2], first.stored.shape[3]
    settings = _settings(options, average=len(frames))
    for name, where in (settings.resolver.without_effect | settings.without_effect).items():
        if name in options:
            _log_once(f"{name}: has no effect {where}")
    settings.require_roi_within(pixels, of=str(first))
    loaded, use = None, None
    if calibration is not None:
        folder = Path(calibration)
        loaded = current_calibration(folder)
        loaded.require_match(first.metadata, pixels)
        use = CalibrationUse(folder, loaded.digest, sine=loaded.sine)
    plan = FramePlan(metadata=first.metadata, settings=settings, calibration=use)
    resolved = resolve_frame(_recorded(frames), plan=plan, calibration=loaded)
    maps, _ = answered_maps(resolved, plan, source=first)
    forced = settings.resolver.mpi_model == "diffuse" and settings.resolver.may_be_diffuse((1, 2))
    if forced and not (maps.status & np.uint32(StatusBit.DIFFUSE_MPI)).any():
        _log.warning(
            f"{first}: mpi_model has no effect, because the frame has enough light in too few places; all its MPI is taken for "
            "separate paths"
        )
    layers = {name: maps.layer(name) for name in maps.names} | {STATUS: maps.status}
    return Maps(layers, plan.header.of_frame(str(first)).facts)


@cache
def _log_once(note: str) -> None:
    """Log a note on options, which are often the same for a thousand frames."""
    _log.warning(note)


def _frames(given: Frame | Sequence[Frame]) -> list[Frame]:
    frames = [given] if isinstance(given, Frame) or not isinstance(given, Iterable) else list(given)
    if not frames:
        raise SettingsError("resolve: found no frame, expected one or more")
    for one in frames:
        if not isinstance(one, Frame):
            hint = "read_frames(PATH) yields them, Frame.from_array(ARRAY) makes one"
            raise SettingsError(f"resolve: found {type(given).__name__}, expected a Frame, or several; {hint}")
    return frames


def _settings(options: ResolveOptions, *, average: int) -> MapSettings:
    """Return the settings record for some options; an option that is not given has the record's default."""
    of_resolver = ResolverOptions.__annotations__.keys()
    unknown = options.keys() - ResolveOptions.__annotations__.keys()
    if unknown:
        allowed = ", ".join(("calibration", *ResolveOptions.__annotations__))
        raise SettingsError(f"resolve: found the option {', '.join(sorted(unknown))}, expected some of {allowed}")
    given = as_declared(dict(options), ResolveOptions.__annotations__, of="resolve")
    if "order" in given:
        given["order"] = str(given["order"])
    resolver = ResolverSettings(**{name: value for name, value in given.items() if name in of_resolver})
    others = {name: value for name, value in given.items() if name not in of_resolver}
    return MapSettings(resolver=resolver, average=average, **others)


def _recorded(frames: Sequence[Frame]) -> Stored | FrameMean:
    """Return the values to be resolved: the stored values of a single frame, or the mean of several frames."""
    first = frames[0]
    for one in frames:
        if one.stored.shape != first.stored.shape or one.metadata != first.metadata:
            raise FrameError(f"{one}: differs in size or metadata from {first}, expected frames of one capture")
        require_plausible(one.stored, one.metadata, of=one)
    if len(frames) == 1:
        return first.stored
    return frame_mean(_without_copies(frames), saturated_counts=first.metadata.voltage.saturated_counts)


def _without_copies(frames: Sequence[Frame]) -> Iterator[Stored]:
    """Yield the values of frames, but not those that an earlier frame holds too."""
    copies = Copies()
    for one in frames:
        if copies.original_of(one.stored, content_digest(one.stored), one):
            _log.warning(f"warning: {one}: holds the same values as another of these frames, so the mean is without it")
        else:
            yield one.stored
