"""The search for map files in a folder."""

from collections.abc import Callable, Iterator
from pathlib import Path

from cadtof_cli.capture.discovery import OUTPUT_FILES, OnUnlisted, fail
from cadtof_cli.errors import UnlistedError
from cadtof_cli.files.formats import MAP_SUFFIXES
from cadtof_cli.files.reading import is_folder, natural_key, real_path
from cadtof_cli.workflows.resolve.run_json import RUN_FILE

OnRun = Callable[[Path], object]
"""Called with each folder below that holds a run of its own; the search goes on with the other folders."""


def map_files(maps: Path, /, *, on_unlisted: OnUnlisted = fail, on_run: OnRun = lambda _: None) -> tuple[Path, ...]:
    """Return the map files in a folder in natural order, as frames are taken, then those in folders below it; of a file, itself.

    An empty folder with the name of a map counts as a map: reading it fails, with a message that names it. By default, a folder
    below that cannot be listed raises the error, and one that holds a run of its own is left out.
    """
    return tuple(each_map_file(maps, on_unlisted=on_unlisted, on_run=on_run))


def each_map_file(maps: Path, /, *, on_unlisted: OnUnlisted = fail, on_run: OnRun = lambda _: None) -> Iterator[Path]:
    """Yield what `map_files` returns; a folder is listed when its files are asked for."""
    return _map_files(maps, set(), on_unlisted, on_run) if is_folder(maps) else iter((maps,))


def _map_files(folder: Path, seen: set[str], on_unlisted: OnUnlisted, on_run: OnRun) -> Iterator[Path]:
    """Yield the map files in a folder and below it. Folders in `seen` are left out, because links may lead in a circle."""
    seen.add(real_path(folder))
    files, below = list[Path](), list[Path]()
    for path in _listed(folder):
        try:
            inside = [one.name for one in _listed(path)] if is_folder(path) else []
        except UnlistedError as error:
            on_unlisted(path, error)
            continue
        if path.suffix in MAP_SUFFIXES and not inside:
            files.append(path)
        elif inside and OUTPUT_FILES.isdisjoint(inside):
            below.append(path)
        elif RUN_FILE in inside:
            on_run(path)
    yield from files
    for one in below:
        if real_path(one) not in seen:
            yield from _map_files(one, seen, on_unlisted, on_run)


def _listed(folder: Path) -> list[Path]:
    try:
        paths = (path for path in folder.iterdir() if not path.name.startswith("."))
        return sorted(paths, key=lambda path: natural_key(path.name))
    except OSError as error:
        raise UnlistedError(f"{folder}: cannot be listed: {error.strerror}") from error
