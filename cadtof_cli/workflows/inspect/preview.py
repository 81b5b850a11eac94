"""`cadtof preview`: one picture of a frame, or a film or a sheet of many."""

import itertools
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import spread_values
from cadtof_cli.calibration.store import is_calibration_folder, load_calibration
from cadtof_cli.errors import CadtofError, CaptureError, SettingsError, require
from cadtof_cli.figures.calibration import draw_calibration
from cadtof_cli.figures.kinds import require_picture
from cadtof_cli.figures.layers import (
    Shown,
    block_of,
    draw_all_layers,
    draw_layer,
    draw_recorded,
    magnified_width,
)
from cadtof_cli.figures.maps import OF_A_MAP, draw_maps
from cadtof_cli.figures.page import Block, Image
from cadtof_cli.figures.pixel_classes import PixelClass
from cadtof_cli.figures.scales import Scale
from cadtof_cli.figures.sequence import (
    FILMS,
    draw_film,
    draw_sheet,
    fitted,
    require_film,
    thumbnail_size,
)
from cadtof_cli.workflows.inspect.first_phasors import first_phasors
from cadtof_cli.workflows.inspect.pictured import Pictured, pictured
from cadtof_cli.workflows.inspect.preview_settings import PreviewSettings
from cadtof_cli.workflows.inspect.run_map import RunMap, require_same_depth
from cadtof_cli.workflows.inspect.truth import Truth
from cadtof_cli.workflows.progress import Progress

_FILM_PIXELS = 640
"""Most pixels along the longer side of a map that is magnified in a film."""

_VALUES_A_FRAME = 4096
"""How many values of each frame are used to find the scale of many frames."""


def preview(inputs: Sequence[Path], out: Path, /, *, settings: PreviewSettings, progress: Progress) -> None:
    """Draw maps, truth, recorded frames or a calibration into the picture or film `out`.

    One frame becomes a figure, or one of its layers is drawn at full resolution. Several frames become a sheet of thumbnails,
    or a film if `out` is a GIF or MP4.

    Raises:
        CadtofError: an input cannot be read or drawn, frames hold different kinds of depth, or the file cannot be written.
    """
    film = out.suffix.lower() in FILMS
    if film:
        require_film(out, overwrite=settings.overwrite)
    else:
        require_picture(out, overwrite=settings.overwrite, more=FILMS)
    if len(inputs) == 1 and is_calibration_folder(inputs[0]):
        _draw_calibration(inputs[0], out, settings)
        return
    found = list(pictured(inputs, say=progress.say))
    if settings.frame is not None:
        require(settings.frame < len(found), "--frame", settings.frame, f"0 … {len(found) - 1}")
        found = [found[settings.frame]]
    if settings.truth is not None and found[0].run is None:
        raise SettingsError(f"--truth: found the recorded frame {found[0].name}, expected maps, which have errors")
    if settings.truth is not None and len(found) > 1 and not film:
        progress.say(f"drawn with truth: the first of {len(found)} frames; --frame N draws another")
        found = found[:1]
    if settings.layer is None or settings.layer.endswith(".depth"):
        # the frames share a scale, and its title names one kind of depth
        for run, following in itertools.pairwise(one.run for one in found if one.run is not None):
            require_same_depth(run, following)
    if film:
        _film(found, out, settings, progress)
    elif len(found) > 1:
        _sheet(found, out, settings, progress, title=" ".join(path.name or str(path) for path in inputs))
    else:
        _figure(found[0], out, settings, progress)


def _draw_calibration(folder: Path, out: Path, settings: PreviewSettings) -> None:
    of_frames = settings.layer, settings.limits, settings.colours, settings.truth, settings.frame
    if any(one is not None for one in of_frames) or out.suffix.lower() in FILMS:
        raise SettingsError(
            f"{folder}: a calibration is drawn as one picture; leave out --layer, --range, --cmap, --truth and --frame"
        )
    calibration = load_calibration(folder)
    parts = ", ".join(f"{kind_of} {digest}" for kind_of, digest in calibration.digests.items())
    draw_calibration(calibration, out, title=f"calibration {folder.absolute().name}: {parts}")


def _figure(one: Pictured, out: Path, settings: PreviewSettings, progress: Progress) -> None:
    """Draw one frame: one of its layers, or all of them."""
    shown = one.read()
    if settings.layer is not None or settings.limits is not None or settings.colours is not None:
        name = _layer_name(one, shown, settings.layer)
        scale = Scale.of_layer(name, shown.values(name)).chosen(settings.limits, settings.colours)
        draw_layer(block_of(shown, name, scale), shown, out)
    elif one.run is None or one.file is None:
        draw = draw_recorded if "H1.phase" in shown.layers else draw_all_layers
        draw(shown, out)
    elif missing := [name for name in OF_A_MAP if name not in shown.layers]:
        if settings.truth is not None:
            raise CaptureError(f"{one.file}: found layers {', '.join(shown.layers)}; expected {', '.join(missing)} too")
        draw_all_layers(shown, out)
    elif settings.truth is None:
        draw_maps(shown, out)
    else:
        a_map = RunMap(one.run, one.file, shown.layers)
        known = Truth(settings.truth, one.run).depth(a_map)
        first = first_phasors(one.run, progress.say).depth(a_map)
        draw_maps(shown, out, truth_m=known, first_phasor_m=first)


def _layer_name(one: Pictured, shown: Shown, chosen: str | None) -> str:
    """Return the name of the layer to draw if only one is drawn: the chosen one, else the leading one, else the first."""
    name = chosen or (one.layer if one.layer in shown.layers else next(iter(shown.layers)))
    require(name in shown.layers, "--layer", repr(name), f"one of {', '.join(shown.layers)}: {shown.title}")
    return name


@dataclass(frozen=True)
class _Shared:
    """What all frames of one picture share: layer, scale, classes of pixels, and the shape of the first frame, (Y, X)."""

    layer: str
    scale: Scale
    kinds: set[PixelClass]
    shape: tuple[int, int]


def _shared(found: Sequence[Pictured], settings: PreviewSettings, progress: Progress) -> _Shared:
    """Return what suits all frames. Each frame is read once to find it.

    Frames that cannot be read, or that lack the layer of the first frame, are left out, with a note.
    """
    values: list[NDArray[np.floating]] = []
    ends: list[float] = []
    kinds: set[PixelClass] = set()
    layer, shape = settings.layer, (0, 0)
    for one in found:
        progress.advance()
        try:
            shown = one.read()
            layer = _layer_name(one, shown, layer)
        except CadtofError as error:
            # if the first frame lacks the layer, the others lack it too
            if isinstance(error, SettingsError) and not values:
                raise
            progress.say(f"left out: {error}")
            continue
        block = block_of(shown, layer)
        plane = block.panels[0].values
        shape = shape if any(shape) else (plane.shape[0], plane.shape[1])
        kinds |= block.shown(block.panels[0])
        values.append(spread_values(plane, _VALUES_A_FRAME).copy())
        finite = plane[np.isfinite(plane)]
        ends += [float(finite.min()), float(finite.max())] if finite.size else []
    if layer is None or not values:
        raise CaptureError(f"none of the {len(found)} frames can be drawn")
    scale = Scale.of_layer(layer, *values).chosen(settings.limits, settings.colours)
    return _Shared(layer, replace(scale, reach=(min(ends), max(ends)) if ends else None), kinds, shape)


def _blocks(found: Sequence[Pictured], shared: _Shared, progress: Progress) -> Iterator[tuple[str, Block | None]]:
    """Yield each frame's name, and its layer on the common scale; None: it cannot be drawn."""
    for one in found:
        progress.advance()
        block = None
        with suppress(CadtofError):
            shown = one.read()
            block = block_of(shown, _layer_name(one, shown, shared.layer), shared.scale)
        yield one.name, block


def _sheet(found: Sequence[Pictured], out: Path, settings: PreviewSettings, progress: Progress, *, title: str) -> None:
    """Draw a thumbnail of every frame."""
    progress.advance(0, total=2 * len(found))
    shared = _shared(found, settings, progress)
    size = thumbnail_size(len(found), shared.shape)
    thumbnails: list[tuple[str, Image | None]] = []
    bar: Block | None = None
    for name, block in _blocks(found, shared, progress):
        bar = bar or block
        thumbnails.append((name, None if block is None else fitted(block.painted(block.panels[0]), size)))
    assert bar is not None
    heading = f"{title}: {shared.layer}{f' ({bar.unit})' if bar.unit else ''}, {len(found)} frames"
    draw_sheet(thumbnails, bar, out, title=heading, size=size, kinds=shared.kinds)


def _film(found: Sequence[Pictured], out: Path, settings: PreviewSettings, progress: Progress) -> None:
    """Draw one layer of every frame, one after the other."""
    if settings.truth is not None:
        raise SettingsError("--truth goes with the figure of one frame, not with a film")
    progress.advance(0, total=2 * len(found))
    shared = _shared(found, settings, progress)

    def frames() -> Iterator[tuple[str, Block]]:
        for number, (name, block) in enumerate(_blocks(found, shared, progress), start=1):
            if block is None:
                continue
            if block.panels[0].values.shape != shared.shape:
                progress.say(f"left out: {name} has another size than the first frame")
                continue
            yield f"{name}  ({number} of {len(found)})", block

    width = magnified_width(shared.shape, _FILM_PIXELS)
    draw_film(frames(), out, per_second=settings.frames_per_second, panel_width=width, kinds=shared.kinds)
