"""Pictures of many frames: a sheet of thumbnails, or a film as GIF or MP4. All frames have the same scale."""

import importlib.util
import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from cadtof_cli.errors import SettingsError
from cadtof_cli.figures.canvas import Figure, add_title, within
from cadtof_cli.figures.kinds import save
from cadtof_cli.figures.page import LEGEND_ENTRY, Block, Image, add_bar, add_legend, page_figure
from cadtof_cli.figures.pixel_classes import PixelClass
from cadtof_cli.files.atomic import atomic_write, require_new

FILMS = (".gif", ".mp4")
"""Endings of the names of films."""

DOTS_PER_INCH = 100

_SHEET_WIDTH, _LEAST_THUMB, _MOST_THUMB = 1800, 48, 320
_NAME_HEIGHT, _SPACE, _TOP, _RIGHT, _BOTTOM = 15, 6, 44, 92, 34


def thumbnail_size(count: int, shape: tuple[int, int], /) -> tuple[int, int]:
    """Return width and height of a thumbnail in pixels, for `count` thumbnails of frames of a shape (Y, X).

    The number of thumbnails in a row of the sheet follows from this size.
    """
    aspect = shape[1] / shape[0]
    columns = max(1, min(count, round(math.sqrt(1.6 * count / aspect))))
    width = float(np.clip(_SHEET_WIDTH / columns - _SPACE, _LEAST_THUMB, _MOST_THUMB))
    if width / aspect > 2 * _MOST_THUMB:
        width = 2 * _MOST_THUMB * aspect
    return max(round(width), 1), max(round(width / aspect), 1)


def fitted(image: Image, size: tuple[int, int], /) -> Image:
    """Return an image in the middle of a white one of a size (width, height); each new pixel is the nearest old one.

    It keeps its proportions: frames of other sensors are not stretched. Half a pixel is the rounding of the size.
    """
    (width, height), aspect = size, image.shape[1] / image.shape[0]
    inner = min(height, math.ceil((width + 0.5) / aspect)), min(width, math.ceil((height + 0.5) * aspect))
    rows, columns = ((np.arange(new) + 0.5) / new for new in inner)
    whole: Image = np.full((height, width, image.shape[2]), 255, np.uint8)
    top, left = (height - inner[0]) // 2, (width - inner[1]) // 2
    whole[top : top + inner[0], left : left + inner[1]] = image[
        (rows * image.shape[0]).astype(int)[:, None], (columns * image.shape[1]).astype(int)
    ]
    return whole


def draw_sheet(
    thumbnails: Sequence[tuple[str, Image | None]],
    scale: Block,
    path: Path,
    /,
    *,
    title: str,
    size: tuple[int, int],
    kinds: Collection[PixelClass],
) -> None:
    """Draw thumbnails of frames in rows, with one bar of colours and a legend.

    `thumbnails` are names and pictures of width and height `size` in pixels; None: the frame cannot be drawn. `scale` is a block
    with the scale that all frames share, and `kinds` are the classes of pixels that the legend names.
    """
    width, height = size
    pitch = max(width, 64) + _SPACE
    columns = max(1, min(len(thumbnails), (_SHEET_WIDTH + _SPACE) // pitch))
    rows = math.ceil(len(thumbnails) / columns)
    sheet: Image = np.full((rows * (height + _NAME_HEIGHT), columns * pitch, 4), 255, np.uint8)
    places = [divmod(number, columns) for number in range(len(thumbnails))]
    for (_, image), (row, column) in zip(thumbnails, places, strict=True):
        top, left = row * (height + _NAME_HEIGHT), column * pitch
        if image is not None:
            sheet[top : top + height, left : left + width] = image
    page_width, page_height = max(sheet.shape[1], 320) + 2 * _SPACE + _RIGHT, sheet.shape[0] + _TOP + _BOTTOM
    figure = Figure(figsize=(page_width / DOTS_PER_INCH, page_height / DOTS_PER_INCH), dpi=DOTS_PER_INCH)
    figure.figimage(sheet, _SPACE, _BOTTOM, origin="upper")
    add_title(figure, title, below=20 / DOTS_PER_INCH)
    for (name, image), (row, column) in zip(thumbnails, places, strict=True):
        x = (_SPACE + column * pitch + width / 2) / page_width
        below = _TOP + row * (height + _NAME_HEIGHT) + height
        y = 1 - (below + _NAME_HEIGHT / 2) / page_height
        short = within(name, pitch / DOTS_PER_INCH, size=7)
        figure.text(x, y, short, ha="center", va="center", fontsize=7, parse_math=False)
        if image is None:
            y = 1 - (below - height / 2) / page_height
            figure.text(x, y, "cannot\nbe drawn", ha="center", va="center", fontsize=7, color="#b00020")
    length = min(sheet.shape[0], 500)
    left, bottom = (page_width - _RIGHT + 4) / page_width, 1 - (_TOP + length) / page_height
    add_bar(figure, scale, (left, bottom, 12 / page_width, length / page_height), length=length)
    add_legend(figure, [one for one in PixelClass if one in kinds], columns=max(1, page_width // LEGEND_ENTRY))
    save(figure, path, dpi=DOTS_PER_INCH)


def draw_film(
    frames: Iterable[tuple[str, Block]],
    path: Path,
    /,
    *,
    per_second: float,
    panel_width: float,
    kinds: Collection[PixelClass],
) -> None:
    """Draw frames one after the other as GIF or MP4. From frame to frame, only the map and the title change.

    `frames` are titles and blocks of the same size and scale, drawn as they come: MP4 keeps one frame in memory, GIF keeps all.
    `panel_width` is in pixels of the film, and `kinds` are the classes of pixels that the legend names.
    """
    waiting = iter(frames)
    first = next(waiting)
    pictures = _pictures(itertools.chain((first,), waiting), panel_width, kinds)
    with atomic_write(path) as temporary:
        if path.suffix.lower() == ".gif":
            _write_gif(pictures, temporary, _palette(first[1]), per_second)
        else:
            _write_mp4(pictures, temporary, per_second)


def require_film(path: Path, /, *, overwrite: bool) -> None:
    """Raise OutputError if the file of a film exists and may not be replaced, SettingsError if MP4 lacks imageio-ffmpeg."""
    require_new(path, overwrite=overwrite)
    if path.suffix.lower() == ".mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise SettingsError(
            f"{path}: MP4 needs imageio-ffmpeg, which is not installed: pip install 'cadtof[video]', or write a .gif"
        )


def _pictures(
    frames: Iterable[tuple[str, Block]], panel_width: float, kinds: Collection[PixelClass]
) -> Iterator[Image]:
    """Yield the frames as pictures, RGB, (Y, X, 3). The figure is made once; for later frames, map and title are replaced."""
    figure: Figure | None = None
    for title, block in frames:
        if figure is None:
            figure = page_figure(((block,),), title=title, kinds=kinds, panel_width=panel_width)
            canvas: Any = FigureCanvasAgg(figure)
            figure.set_dpi(DOTS_PER_INCH)
            room = figure.get_figwidth() - 0.2
        else:
            figure.texts[0].set_text(within(title, room, size=11))
            figure.axes[0].images[0].set_data(block.painted(block.panels[0]))
        canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _write_gif(pictures: Iterator[Image], path: Path, colours: Image, per_second: float) -> None:
    """Write a GIF. Its frames share a palette, so that a value has the same colour in all frames."""
    from PIL import Image as Pillow

    palette = Pillow.new("P", (1, 1))
    palette.putpalette(colours.tobytes())

    def quantised(picture: Image) -> Pillow.Image:
        return Pillow.fromarray(picture).quantize(palette=palette, dither=Pillow.Dither.NONE)

    first, *others = map(quantised, pictures)
    # GIF counts in hundredths of a second: for other rates, the durations of frames differ by one
    ends = [round(place * 100.0 / per_second) for place in range(len(others) + 2)]
    milliseconds = [10 * (end - begin) for begin, end in itertools.pairwise(ends)]
    first.save(path, format="GIF", save_all=True, append_images=others, duration=milliseconds, loop=0, optimize=False)


def _palette(block: Block) -> Image:
    """Return 256 colours, RGB, (256, 3): those of pixel classes, those of the scale, and greys for letters."""
    greys = np.linspace(0, 255, 32).round().astype(np.uint8)[:, None].repeat(3, axis=1)
    classes = np.stack([kind.rgba[:3] for kind in PixelClass])
    name = block.scale.colours if block.scale else "gray"
    scale = mpl.colormaps[name](np.linspace(0.0, 1.0, 256 - len(greys) - len(classes)), bytes=True)[:, :3]
    return np.concatenate([classes, scale, greys])


def _write_mp4(pictures: Iterator[Image], path: Path, per_second: float) -> None:
    """Write an MP4 (H.264, 4:2:0), which every player can show. The format needs an even width and height."""
    import imageio_ffmpeg

    first = next(pictures)
    height, width = (side + side % 2 for side in first.shape[:2])
    even = np.full((height, width, 3), 255, np.uint8)
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=per_second, quality=8, codec="libx264", macro_block_size=2,
        ffmpeg_log_level="error", output_params=["-f", "mp4", "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    try:
        for picture in itertools.chain((first,), pictures):
            even[: picture.shape[0], : picture.shape[1]] = picture
            writer.send(even.tobytes())
    finally:
        writer.close()
