"""Depth maps → one file, in the format that its name ends with."""

from pathlib import Path

from cadtof_cli import __version__
from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import whole_file
from cadtof_cli.files.exr.maps import write_exr
from cadtof_cli.files.tiff.maps import write_tiff
from cadtof_cli.maps.layers import DepthMaps

SOFTWARE = f"cadtof {__version__}"


def write_maps(path: Path, maps: DepthMaps, /, *, token: str = "") -> None:
    """Write maps as OpenEXR where `path` ends with .exr, else as OME-TIFF; the file appears whole or not at all.

    Raises:
        OutputError: the file cannot be written, for lack of space or permission.
    """
    write = write_exr if path.suffix == ".exr" else write_tiff
    with whole_file(path, token=token) as temporary:
        write(temporary, maps, software=SOFTWARE)
        if not temporary.exists():
            raise OutputError(f"{path}: cannot be written")
