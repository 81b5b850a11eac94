"""`cadtof profile`: maps along a row, a column or any line, beside the first phasor and truth."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Index
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.files.atomic import require_new, write_text
from cadtof_cli.files.documents import csv_text
from cadtof_cli.maps.layers import DIRECT_DEPTH, layer_unit
from cadtof_cli.maps.profile import Curve, Profile
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS
from cadtof_cli.records import setting
from cadtof_cli.workflows.inspect.first_phasors import first_phasors
from cadtof_cli.workflows.inspect.run_map import RunMap, require_same_depth, require_same_part, require_same_size
from cadtof_cli.workflows.inspect.truth import require_truth, true_layer
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import Run, read_run

TABLE = ".csv"


@dataclass(frozen=True, kw_only=True)
class ProfileSettings:
    """What a user can choose about a profile. Exactly one of row, column and line is given."""

    row: int | None = setting(None, "Along this row of pixels; 0 is the top.", metavar="Y")
    column: int | None = setting(None, "Along this column; 0 is the left.", metavar="X")
    line: tuple[int, int, int, int] | None = setting(
        None, "Along a line from pixel X0,Y0 to pixel X1,Y1, in any direction."
    )
    layer: str = setting(DIRECT_DEPTH, "Layer to show.", metavar="NAME")
    frame: int = setting(0, "Which map of each folder; 0 is the first.")
    first_phasor: bool | None = setting(
        None,
        "Whether to show the depth of the first phasor alone beside direct.depth.  [default: if the recorded frames are there]",
        option="--first-phasor/--no-first-phasor",
        show_default=False,
    )
    truth: Path | None = setting(
        None, "File with the true values of the layer, depths as radial range; they and the errors are drawn too."
    )
    overwrite: bool = setting(False, "Replace the file if it exists.")

    def __post_init__(self) -> None:
        require(self.frame >= 0, "--frame", self.frame, "0 or more")
        given = [one for one in (self.row, self.column, self.line) if one is not None]
        if len(given) != 1:
            raise SettingsError(f"found {len(given)} of --row, --column and --line, expected one of them")

    @property
    def line_in_words(self) -> str:
        """Where the line is, for a title."""
        if self.line is not None:
            return "from pixel {},{} to {},{}".format(*self.line)
        return f"row {self.row}" if self.row is not None else f"column {self.column}"

    def pixels(self, height: int, width: int, /) -> tuple[Index, Index]:
        """Return rows and columns of the pixels on the line, (n,) each; raises SettingsError if the line leaves the map."""
        if self.row is not None:
            ends, option, found = (0, self.row, width - 1, self.row), "--row", f"{self.row}"
        elif self.column is not None:
            ends, option, found = (self.column, 0, self.column, height - 1), "--column", f"{self.column}"
        else:
            assert self.line is not None
            ends, option, found = self.line, "--line", ",".join(map(str, self.line))
        x0, y0, x1, y1 = ends
        inside = {x0, x1} <= set(range(width)) and {y0, y1} <= set(range(height))
        require(inside, option, found, f"columns 0 … {width - 1} and rows 0 … {height - 1}")
        share = np.linspace(0.0, 1.0, max(abs(x1 - x0), abs(y1 - y0)) + 1)
        rows, columns = (np.rint(a + share * (b - a)).astype(np.intp) for a, b in ((y0, y1), (x0, x1)))
        return rows, columns


def read_profile(maps: Sequence[Path], /, *, settings: ProfileSettings, progress: Progress) -> Profile:
    """Return the values of maps of the same size, in folders of runs or single files, along a line.

    Raises:
        CadtofError: maps or truth cannot be read, lack the layer or differ in size; some maps hold range and some planar depth;
            or they show different parts of the recorded frames.
    """
    runs = [read_run(path) for path in maps]
    for run in runs:
        run.tell_if_unfinished(progress.say)
    for run in runs[1:]:
        require_same_depth(runs[0], run)
        # maps of other programs, which have neither a record nor a header, may show any part
        if all(one.record is not None or one.roi for one in (runs[0], run)):
            require_same_part(runs[0], run)
    files = [_chosen(run, settings) for run in runs]
    first = RunMap.read(runs[0], files[0])
    size = first.layer(settings.layer).shape
    rows, columns = where = settings.pixels(*size)
    others = (RunMap.read(run, file) for run, file in zip(runs[1:], files[1:], strict=True))
    found: list[Curve] = []
    for one, name in zip(itertools.chain((first,), others), _names(runs, files), strict=True):
        require_same_size(one.layer(settings.layer), size, one.file, first.file)
        found.append(_curve(one, name, where, settings=settings, say=progress.say))
    known = None
    if settings.truth:
        require_truth(settings.truth)
        known = true_layer(first, settings.layer, settings.truth)[rows, columns]
    # the legend names the folder, which is enough if it holds only one map
    of_frame = f" of {runs[0].name(files[0])}" if len(runs[0].files) > 1 else ""
    axis = "row" if settings.column is not None else "along the line" if settings.row is None else "column"
    return Profile(
        layer=settings.layer,
        unit=layer_unit(settings.layer),
        line=settings.line_in_words + of_frame,
        axis=axis,
        rows=rows,
        columns=columns,
        depth=DEPTH_IN_WORDS[runs[0].depth_kind],
        curves=tuple(found),
        truth=known,
    )


def _chosen(run: Run, settings: ProfileSettings) -> Path:
    files = run.require_maps()
    expected = f"0 … {len(files) - 1}: {run.maps} has {len(files)} maps"
    require(settings.frame < len(files), "--frame", settings.frame, expected)
    return files[settings.frame]


def _curve(
    one: RunMap, name: str, where: tuple[Index, Index], *, settings: ProfileSettings, say: Callable[[str], None]
) -> Curve:
    """Return a map along the line, whose pixels are `where`; with the first phasor if it is wanted and there is a record."""
    first = None
    wanted = one.run.record is not None if settings.first_phasor is None else settings.first_phasor
    if settings.layer == DIRECT_DEPTH and wanted:
        first = first_phasors(one.run, say).depth(one)
    values = one.layer(settings.layer)[where].astype(np.float64)
    beside = (one.sigma(settings.layer), first)
    return Curve(name, values, *(None if plane is None else plane[where].astype(np.float64) for plane in beside))


def _names(runs: Sequence[Run], files: Sequence[Path]) -> list[str]:
    """Return different names for the curves: those of the folders, else folders with maps, else numbers with files."""
    for names in (
        [run.folder.absolute().name for run in runs],
        [f"{run.folder.absolute().name}/{run.name(file)}" for run, file in zip(runs, files, strict=True)],
    ):
        if len(set(names)) == len(names):
            return names
    return [f"{number}: {file}" for number, file in enumerate(files, start=1)]


def profile_table(profile: Profile, /) -> str:
    """Return the profile as CSV: a line for each pixel. Between two commas there is nothing if there is no value."""
    columns: dict[str, NDArray[np.number]] = {"x": profile.columns, "y": profile.rows}
    if profile.truth is not None:
        columns["truth"] = profile.truth
    for one in profile.curves:
        named = {"": one.values, " sigma": one.sigma, " first phasor": one.first_phasor}
        columns |= {f"{one.name}{what}": values for what, values in named.items() if values is not None}
    known = [np.where(np.isfinite(values), values, np.nan) for values in columns.values()]
    return csv_text(columns, zip(*known, strict=True), digits=9)


def write_profile(profile: Profile, out: Path, /, *, overwrite: bool) -> None:
    """Write the profile as a table or a picture, as the suffix of `out` says; raises OutputError if it names neither."""
    if out.suffix.lower() == TABLE:
        require_new(out, overwrite=overwrite)
        write_text(out, profile_table(profile))
        return
    from cadtof_cli.figures.kinds import require_picture
    from cadtof_cli.figures.profile import draw_profile

    require_picture(out, overwrite=overwrite, more=(TABLE,))
    draw_profile(profile, out)
