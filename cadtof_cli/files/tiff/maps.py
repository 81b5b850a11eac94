"""Depth maps as OME-TIFF: one float32 page a layer, each named, the status bits as whole numbers in the last."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

from cadtof_cli.maps.layers import STATUS, DepthMaps


def write_tiff(path: Path, maps: DepthMaps, /, *, software: str) -> None:
    """Write the maps to `path`. The same maps give the same bytes: no date and no random identifier goes in."""
    import tifffile

    maps.pages[-1] = maps.status
    tifffile.imwrite(
        path,
        maps.pages,
        photometric="minisblack",
        description=_ome_xml((*maps.names, STATUS), maps.pages.shape, software),
        software=software,
        metadata=None,
    )


def _ome_xml(names: tuple[str, ...], shape: tuple[int, ...], software: str) -> str:
    channels = "".join(
        f'<Channel ID="Channel:0:{index}" Name={quoteattr(name)} SamplesPerPixel="1"/>'
        for index, name in enumerate(names)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
        'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xsi:schemaLocation="http://www.openmicroscopy.org/Schemas/OME/2016-06 '
        'http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd" '
        f"Creator={quoteattr(software)}>"
        '<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYCZT" Type="float" BigEndian="false" '
        f'SizeX="{shape[2]}" SizeY="{shape[1]}" SizeC="{shape[0]}" SizeZ="1" SizeT="1">'
        f"{channels}<TiffData/></Pixels></Image></OME>"
    )
