"""The words and tables of a page. All of them can be read without scripts."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from cadtof_cli.maps.evaluation import ERROR_TITLES, DepthErrors
from cadtof_cli.report.frames import EmbeddedFrame, EmbeddedLayer
from cadtof_cli.report.markup import EMPTY, Markup, element, joined, table
from cadtof_cli.resolver.status import StatusBit, bit_words
from cadtof_cli.units import counted

BAR_WIDTH, BAR_HEIGHT = 1000, 18

_UNFOLDED = 3
"""Largest number of tables of settings that are all open: those of a run of one capture, with its calibration."""


LISTED_FAILURES = 500
"""Most frames without maps that a page lists: a page of thousands of them would be too large."""


@dataclass(frozen=True)
class FrameLine:
    """A frame of the run, resolved or not.

    Attributes:
        name: of its maps; without maps, of the recorded frame.
        status: `ok`, `failed` or `skipped`; empty: no record says it.
        reason: why it failed or was skipped, or another remark; None: there is none.
        seconds: time that it took; None: not known.
        pixels: number of pixels of each kind, such as "two paths"; empty: not known.
        number: place of the frame in the viewer; None: the page has no maps of it.
        thumbnail: its depths as a data URI; None: it has none.
        size: of the thumbnail, columns and rows.
    """

    name: str
    status: str = ""
    reason: str | None = None
    seconds: float | None = None
    pixels: Mapping[str, int] = field(default_factory=dict)
    number: int | None = None
    thumbnail: str | None = None
    size: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class PageText:
    """The contents of the words and tables of a page.

    Attributes:
        title, subtitle: at the head of the page.
        facts: titles and values of the totals.
        pixels: number of pixels of each kind, such as "two paths", over all frames.
        notes: remarks that the reader should see first.
        errors: errors against truth, by the name of the depths; empty without truth.
        frames: of the run.
        settings: tables by their captions; each row has a name, a value and the origin of the value.
    """

    title: str
    subtitle: str
    facts: Sequence[tuple[str, str]] = ()
    pixels: Mapping[str, int] = field(default_factory=dict)
    notes: Sequence[str] = ()
    errors: Mapping[str, DepthErrors] = field(default_factory=dict)
    frames: Sequence[FrameLine] = ()
    settings: Mapping[str, Sequence[tuple[str, str, str]]] = field(default_factory=dict)

    def lost(self) -> list[FrameLine]:
        """Return the frames without maps: those that failed, then those that were skipped."""
        skipped = [frame for frame in self.frames if frame.status == "skipped" and frame.number is None]
        return [frame for frame in self.frames if frame.status == "failed"] + skipped

    def listed(self) -> list[FrameLine]:
        """Return the frames of thumbnails and table: those in the viewer, and the first `LISTED_FAILURES` without maps."""
        lost = {id(frame) for frame in self.lost()[:LISTED_FAILURES]}
        return [frame for frame in self.frames if frame.number is not None or id(frame) in lost]


def summary(page: PageText, /) -> Markup:
    """Return the notes, the totals, the share of each kind of pixels, and the errors against truth."""
    notes = (element("p", note, class_="note", role="status") for note in page.notes)
    facts = (element("div", element("dt", title), element("dd", value)) for title, value in page.facts)
    errors = EMPTY
    if page.errors:
        rows = [(title, *(shown.replace("%", " %") for shown in one.in_words)) for title, one in page.errors.items()]
        caption = "Depth against truth (median and 90 % of |error|)"
        errors = table(("error, cm", *ERROR_TITLES), rows, caption=caption, numbers=range(1, 8))
    return joined((*notes, element("dl", *facts, class_="facts"), _shares(page.pixels), errors))


def _shares(pixels: Mapping[str, int]) -> Markup:
    """Return a bar of the share of each kind of pixels, with a legend."""
    total = sum(pixels.values())
    if not total:
        return EMPTY
    bars, entries, place = [], [], 0.0
    for number, (title, count) in enumerate(pixels.items()):
        if count:
            width = BAR_WIDTH * count / total
            shape = {"x": f"{place:.2f}", "y": 0, "width": f"{width:.2f}", "height": BAR_HEIGHT}
            bars.append(element("rect", class_=f"share share-{number}", **shape))
            square = element("rect", width=12, height=12, class_=f"share-{number}")
            key = element("svg", square, width=12, height=12, aria_hidden="true")
            entries.append(element("li", key, f" {title}: {_share(count / total)}"))
            place += width
    view = f"0 0 {BAR_WIDTH} {BAR_HEIGHT}"
    bar = element("svg", *bars, viewBox=view, preserveAspectRatio="none", class_="shares", aria_hidden="true")
    return joined((bar, element("ul", *entries, class_="legend")))


def _share(share: float) -> str:
    """Return a share in per cent; a share above 0 is never shown as 0."""
    return "below 0.1 %" if 0.0 < share < 0.001 else f"{share:.1%}".replace("%", " %")


def failures(page: PageText, /) -> Markup:
    """Return the frames without maps, with the reasons."""
    lost = page.lost()
    if not lost:
        return element("p", "Every frame has its maps.")
    rows = [(frame.name, frame.status, frame.reason or "no reason is recorded") for frame in lost[:LISTED_FAILURES]]
    failed = sum(frame.status == "failed" for frame in lost)
    caption = f"{failed} failed, {len(lost) - failed} skipped"
    if len(rows) < len(lost):
        caption += f"; the first {len(rows)} of them"
    return table(("frame", "status", "reason"), rows, caption=caption)


def frame_list(page: PageText, /) -> Markup:
    """Return the thumbnails of the listed frames in their order."""
    listed = page.listed()
    return element("ol", *map(_thumbnail, listed), class_="strip", id="strip", aria_label=_title(page, listed))


def _title(page: PageText, listed: Sequence[FrameLine]) -> str:
    return "All frames" if len(listed) == len(page.frames) else f"{len(listed)} of {len(page.frames)} frames"


def _thumbnail(frame: FrameLine) -> Markup:
    if frame.number is None or frame.thumbnail is None:
        # the name that its maps would have: if this is a file's name, it loses its ending
        named = Path(frame.name)
        short = named.stem if named.suffix[1:].isalnum() else named.name
        mark = element("span", frame.status or "no maps", class_="mark")
        label = element("span", element("bdi", short))
        return element("li", element("div", mark, label, class_="lost", title=frame.reason))
    width, height = frame.size
    picture = element("img", src=frame.thumbnail, width=width, height=height, alt="", loading="lazy", decoding="async")
    path = PurePosixPath(frame.name)
    # frames of several captures often have the same names: the folder gets a line of its own
    lines = ([str(path.parent)] if path.name != frame.name else []) + [path.name]
    labels = [element("span", element("bdi", line)) for line in lines]
    return element("li", element("button", picture, *labels, type="button", data_frame=frame.number, title=frame.name))


def frame_table(page: PageText, /) -> Markup:
    """Return a table with a line for each listed frame: its status, and the share of each kind of pixels."""
    listed = page.listed()
    kinds = list(dict.fromkeys(kind for frame in listed for kind in frame.pixels))
    rows = [
        (
            frame.name,
            frame.status or "–",
            *(_count(frame, kind) for kind in kinds),
            "–" if frame.seconds is None else f"{frame.seconds:.2f}",
            frame.reason or "",
        )
        for frame in listed
    ]
    head = ("frame", "status", *kinds, "seconds", "reason")
    return table(head, rows, caption=_title(page, listed), numbers=range(2, 3 + len(kinds)))


def _count(frame: FrameLine, kind: str) -> str:
    total = sum(frame.pixels.values())
    return _share(frame.pixels.get(kind, 0) / total) if total else "–"


def settings(page: PageText, /) -> Markup:
    """Return tables of the settings of run, captures and calibration; if there are many, only the first is open."""
    many, tables = len(page.settings) > _UNFOLDED, list[Markup]()
    for number, (caption, rows) in enumerate(page.settings.items()):
        # there is a column of origins only if an origin is known
        head = ("setting", "value", "from")[: 3 if any(origin for _, _, origin in rows) else 2]
        shown = [row[: len(head)] for row in rows]
        tables.append(table(head, shown, caption=caption, folded=many and number > 0))
    return joined(element("div", one, class_="settings") for one in tables)


def status_words() -> Markup:
    """Return the meaning of each status bit."""
    return joined(
        piece
        for bit in StatusBit
        for piece in (element("dt", bit_words(bit)), element("dd", bit.meaning.replace("`", "")))
    )


def embedded_section(frames: Collection[EmbeddedFrame], truth: Collection[EmbeddedFrame], /) -> Markup:
    """Return how many pixels of each frame the page holds, and the rounding errors of the codes of frames and truth."""
    if not frames:
        return element("p", "The page holds no maps.")
    layers: dict[str, list[EmbeddedLayer]] = {}
    for frame in (*frames, *truth):
        for layer in frame.layers:
            layers.setdefault(layer.name, []).append(layer)
    kept = {1: "all pixels", 2: "every second row and column", 3: "every third row and column"}
    steps = sorted(Counter(frame.step for frame in frames).items())
    held = "; ".join(f"{kept.get(step, f'every {step}th row and column')} of {count}" for step, count in steps)
    told = (
        f"Of {counted(len(frames), 'frame')}, the page holds {held}. "
        "Every pixel on the page has all its layers; the files of the run hold all pixels of all frames. "
        "Values are rounded to 16-bit steps between the lowest and the highest value of the layer in the frame:"
    )
    rows = [(name, *_loss(known)) for name, known in layers.items()]
    losses = table(("layer", "largest rounding", "steps"), rows, caption="What rounding loses")
    errors = "An error in the viewer is a rounded depth minus the rounded truth, so it has the roundings of both."
    return joined((element("p", told), losses, *([element("p", errors)] if truth else ())))


def _loss(layers: Sequence[EmbeddedLayer]) -> tuple[str, str]:
    """Return the largest rounding error of a layer in any frame, and the kind of its steps, as texts."""
    if layers[0].scale.kind == "table":
        return "none", "bits"
    told, steps = [], []
    if even := [layer.scale.loss for layer in layers if layer.scale.kind == "linear"]:
        unit = layers[0].unit
        largest, prefix = (1000.0 * max(even), "m") if unit in {"m", "V"} else (max(even), "")
        told.append(f"{largest:.2g} {prefix}{unit}".strip())
        steps.append("even")
    if uneven := [layer.scale.loss for layer in layers if layer.scale.kind == "log"]:
        told.append(f"{100.0 * max(uneven):.2g} % of the value")
        steps.append("of the logarithm")
    return ", or ".join(told), ", or ".join(steps)
