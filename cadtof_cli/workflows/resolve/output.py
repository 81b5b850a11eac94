"""Where the maps of a run go: every frame has a file of its own, inside the folder of the run and not among recorded frames."""

import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import field
from pathlib import Path

from cadtof_cli.capture.frames import Capture
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import OutputError
from cadtof_cli.files.reading import real_path
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.lock import LOCK_FILE
from cadtof_cli.workflows.resolve.run_json import RUN_FILE


@dataclass
class MapNames:
    """The names of the maps of a run, and the recorded file that each map is made from.

    Attributes:
        out: folder of the run.
        files: the first file of each frame, by the name of its map, and by `same` of this name.
        same: gives names of the same file in `out` the same value.
    """

    out: Path
    files: dict[str, Path] = field(default_factory=dict)
    same: Callable[[str], str] = str

    def take(self, name: str, file: Path, /) -> Path:
        """Take a name for the map of a recorded file, and return the file that has it: another one if the name was taken."""
        owner = self.files.setdefault(self.same(name), file)
        return self.files.setdefault(name, owner)

    def taken(self) -> Collection[str]:
        """Return the names that no frame of a stack may get."""
        return self.files.keys()

    def folders(self) -> set[str]:
        """Return the folders of the maps below the folder of the run."""
        return {name.rpartition("/")[0] for name in self.files} - {""}

    def tell_letters_apart(self) -> None:
        """Make sure that names differ also where capital and small letters are the same in names of files.

        The run must hold the lock of the folder.

        Raises:
            OutputError: two frames would be written to one file.
        """
        if (self.out / LOCK_FILE.upper()).exists():
            known, self.files, self.same = self.files, {}, str.lower
            self.require_different(known.items(), ", because capital and small letters are the same there")

    def require_different(self, named: Iterable[tuple[str, Path]], because: str = "", /) -> None:
        """Add names with their recorded files; raises OutputError if two frames would be written to one file."""
        for name, file in named:
            if (other := self.take(name, file)) is not file:
                raise OutputError(
                    f"{other} and {file} would both be written as {self.out}/{name}{because}; "
                    "resolve them into folders of their own, one command each"
                )


def map_names(captures: Sequence[Capture], out: Path, /) -> MapNames:
    """Return the names of the maps of captures, after making sure that each frame has an output file of its own.

    Raises:
        OutputError: the output folder is the folder of a capture; or two frames would be written to one file; or a folder
            below belongs to another run, or is a link that leads out of the output folder.
    """
    if (out / CAPTURE_FILE).exists() or real_path(out) in {real_path(capture.root) for capture in captures}:
        raise OutputError(f"{out}: the maps would be written among recorded frames; choose another folder with -o")
    names = MapNames(out)
    names.require_different((frame.name, frame.paths[0]) for capture in captures for frame in capture.frames)
    for folder in sorted(names.folders()):
        require_inside(out, out / folder)
        if os.path.lexists(out / folder / RUN_FILE):
            raise OutputError(
                f"{out / folder}: holds a run of its own; move it elsewhere, or choose another folder with -o"
            )
    return names


def require_inside(out: Path, folder: Path, /) -> None:
    """Raise OutputError if a folder of maps does not lie in the output folder, because a link below it leads elsewhere."""
    if not Path(real_path(folder)).is_relative_to(real_path(out)):
        raise OutputError(
            f"{folder}: is a link to {real_path(folder)}, and maps are written only inside {out}; remove the link, or choose "
            "another folder with -o"
        )
