"""What to say if a folder holds no frames: what was looked for, what is there, and what may be missing."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from cadtof_cli.capture.frames import TRUTH
from cadtof_cli.capture.metadata import Layout
from cadtof_cli.capture.planes import hint_of_words
from cadtof_cli.errors import CaptureError
from cadtof_cli.files.formats import FORMATS, RAW, frame_suffixes
from cadtof_cli.files.reading import entries_of, natural_key
from cadtof_cli.units import first_of


def no_frames(root: Path, layout: Layout, /, among: Sequence[str] | None = None) -> CaptureError:
    """Return the error for a folder without frames, or for named files in it (`among`) that are no frames."""
    pattern, looked_for = layout.pattern, expected_names(layout)
    where = "" if among is None else " among the files that were named"
    if among is None:
        among = [name + "/" * is_dir for name, is_dir in entries_of(root, pattern) or entries_of(root)]
    files = [name for name in among if not name.endswith("/")]
    hint = _what_is_missing(root, layout, {Path(name).suffix.lower(): name for name in files})
    if pattern is not None and not hint and (words := hint_of_words(sorted(files, key=natural_key), layout)):
        hint = f"; {words}"
    return CaptureError(f"{root}: no frames{where}: looked for {looked_for}, found {first_names(among)}{hint}")


def _what_is_missing(root: Path, layout: Layout, by_suffix: Mapping[str, str]) -> str:
    """Return a hint what to do so that files of these suffixes become frames; `by_suffix` holds an example of each."""
    # imported here because nearly every folder has frames
    from cadtof_cli.files import named_arrays

    if of_arrays := next(filter(None, map(by_suffix.get, named_arrays.SUFFIXES)), None):
        return f"; `cadtof info {root / of_arrays}` says how to save an array of that file as a frame"
    if layout.raw_dtype is None and (dump := next(filter(None, map(by_suffix.get, RAW.suffixes)), None)):
        return f"; to read raw dumps such as {dump}, give --raw-dtype and --raw-shape, or [layout.raw] in capture.toml"
    planes = [one.title for one in FORMATS if not one.whole and not by_suffix.keys().isdisjoint(one.suffixes)]
    if layout.pattern is None and planes:
        return f"; a {planes[0]} holds one plane: give --pattern, which says how the planes of a frame are named"
    suffixes = frame_suffixes(planes=True, raw=layout.raw_dtype is not None)
    if layout.pattern is not None and not layout.pattern.lower().endswith(suffixes):
        return f"; planes are read from {', '.join(suffixes)} files"
    return ""


def expected_names(layout: Layout, /) -> str:
    """Return in words which files would be frames, or planes of frames."""
    if layout.pattern is None:
        return f"{', '.join(frame_suffixes(planes=False, raw=layout.raw_dtype is not None))} files other than {TRUTH}.*"
    return f"files named {layout.pattern} (layout.pattern)"


def first_names(names: Iterable[str], /) -> str:
    """Return the first names in natural order, for a message."""
    return first_of(sorted(names, key=natural_key), 5) or "nothing"
