"""OME-XML, the description of an OME-TIFF: channel names read from it, and the description of our maps."""

from collections.abc import Sequence
from xml.etree import ElementTree

_SCHEMA = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def channel_names(xml: str, /) -> tuple[str, ...]:
    """Return the names of all channels in their order, empty for one without a name; none of them where it is not XML."""
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError:
        # tifffile remarks on it, and its remark is an error here
        return ()
    return tuple(element.get("Name", "") for element in root.iter() if element.tag.rpartition("}")[2] == "Channel")


def ome_xml(names: Sequence[str], /, *, size: tuple[int, int], software: str) -> str:
    """Return OME-XML of one image of float pages, of `size` (Y, X) each, with a name for each."""
    root = ElementTree.Element(
        "OME",
        {
            "xmlns": _SCHEMA,
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:schemaLocation": f"{_SCHEMA} {_SCHEMA}/ome.xsd",
            "Creator": software,
        },
    )
    image = ElementTree.SubElement(root, "Image", {"ID": "Image:0"})
    lengths = {"SizeX": size[1], "SizeY": size[0], "SizeC": len(names), "SizeZ": 1, "SizeT": 1}
    pixels = ElementTree.SubElement(
        image,
        "Pixels",
        {"ID": "Pixels:0", "DimensionOrder": "XYCZT", "Type": "float", "BigEndian": "false"}
        | {axis: str(length) for axis, length in lengths.items()},
    )
    for index, name in enumerate(names):
        about = {"ID": f"Channel:0:{index}", "Name": name, "SamplesPerPixel": "1"}
        ElementTree.SubElement(pixels, "Channel", about)
    ElementTree.SubElement(pixels, "TiffData")
    # the serialiser escapes ">" wherever else it stands; without the blanks our files keep the bytes they had
    text = ElementTree.tostring(root, encoding="unicode").replace(" />", "/>")
    return f'<?xml version="1.0" encoding="UTF-8"?>{text}'
