"""Map files and truth files → named layers."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from numpy.typing import NDArray

from cadtof_cli.errors import FrameError
from cadtof_cli.files.damage import damage_as_frame_error
from cadtof_cli.files.exr.library_output import library_output
from cadtof_cli.files.formats import container_of

MAP_SUFFIXES = (".exr", ".tif", ".tiff")


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the layers of a map or truth file by name, (Y, X) each, as they are stored.

    Layers are the channels of an EXR file's first part, or the named channels of an OME-TIFF.

    Raises:
        FrameError: the file cannot be read, is damaged, or is a TIFF whose channels have no names.
    """
    container, _ = container_of(path)
    return _exr_layers(path) if container == "exr" else _tiff_layers(path)


def _exr_layers(path: Path) -> dict[str, NDArray[Any]]:
    import OpenEXR

    with (
        damage_as_frame_error(path, "EXR"),
        library_output() as said,
        OpenEXR.File(str(path), separate_channels=True, num_threads=0) as file,
    ):
        layers = {name: channel.pixels.copy() for part in file.parts[:1] for name, channel in part.channels.items()}
    if said or not layers:
        raise FrameError(f"{path}: damaged EXR: {'; '.join(said) or 'found no channels'}")
    return layers


def _tiff_layers(path: Path) -> dict[str, NDArray[Any]]:
    import tifffile

    from cadtof_cli.files.tiff.images import reading_tiff, require_no_remarks

    with reading_tiff(path) as remarks, tifffile.TiffFile(path) as file:
        names = _channel_names(file.ome_metadata) if file.ome_metadata else []
        planes = [page.asarray() for page in file.pages]
    require_no_remarks(path, remarks)
    if not names or len(names) != len(planes):
        raise FrameError(
            f"{path}: found {len(planes)} pages and {len(names)} channel names, expected an OME-TIFF of named maps"
        )
    return dict(zip(names, planes, strict=True))


def _channel_names(xml: str) -> list[str]:
    return [
        element.get("Name", "") for element in ElementTree.fromstring(xml).iter() if element.tag.endswith("}Channel")
    ]
