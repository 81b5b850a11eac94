"""OME-XML, the description of an OME-TIFF: channel names read from it, and the description of our maps."""

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

from cadtof_cli.files.maps import SOURCE, MapsAbout

_OURS = "cadtof"
_UNIT = "unit of "
"""How annotations are marked as ours, and how those begin that give the unit of a channel's values."""

_SCHEMA = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def channel_names(xml: str, /) -> tuple[str, ...]:
    """Return the names of all channels in their order, empty for one without a name; none of them where it is not XML."""
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError:
        # tifffile remarks on it, and its remark is an error here
        return ()
    return tuple(element.get("Name", "") for element in root.iter() if element.tag.rpartition("}")[2] == "Channel")


def annotations(xml: str, /) -> dict[str, str]:
    """Return the facts that `ome_xml` has put in; nothing where it is not ours, or not XML."""
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError:
        return {}
    ours = (element for element in root.iter(f"{{{_SCHEMA}}}MapAnnotation") if element.get("Namespace") == _OURS)
    pairs = ((pair.get("K", ""), pair.text or "") for one in ours for pair in one.iter(f"{{{_SCHEMA}}}M"))
    return {name: text for name, text in pairs if not name.startswith(_UNIT)}


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def marked_source(about: MapsAbout, /) -> bytes:
    """Return how the name of the recorded frame stands in both kinds of XML, with the mark before it and after."""
    return f'source">{_ascii(_escaped(about.facts.get(SOURCE, "")))}<'.encode("ascii")


def gdal_xml(name: str, unit: str, facts: Mapping[str, str], /) -> str:
    """Return GDAL's metadata of one band: its name, its unit, and facts about the file."""
    root = ElementTree.Element("GDALMetadata")
    for key, text in facts.items():
        ElementTree.SubElement(root, "Item", {"name": key}).text = text
    for key, text in (("description", name), ("unittype", unit)):
        if text:
            ElementTree.SubElement(root, "Item", {"name": key.upper(), "sample": "0", "role": key}).text = text
    return _ascii(ElementTree.tostring(root, encoding="unicode"))


def _ascii(xml: str) -> str:
    """Return XML with all that TIFF has no letters for as references."""
    return xml.encode("ascii", "xmlcharrefreplace").decode("ascii")


def ome_xml(names: Sequence[str], /, *, size: tuple[int, ...], about: MapsAbout) -> str:
    """Return OME-XML of one image of float pages, of `size` (Y, X) each, with a name for each, their units and facts."""
    root = ElementTree.Element(
        "OME",
        {
            "xmlns": _SCHEMA,
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:schemaLocation": f"{_SCHEMA} {_SCHEMA}/ome.xsd",
            "Creator": about.facts["software"],
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
        channel = {"ID": f"Channel:0:{index}", "Name": name, "SamplesPerPixel": "1"}
        ElementTree.SubElement(pixels, "Channel", channel)
    ElementTree.SubElement(pixels, "TiffData")
    said = {name: text for name, text in about.facts.items() if name != "software"}
    said |= {f"{_UNIT}{name}": unit for name, unit in about.units.items() if unit}
    if said:
        ElementTree.SubElement(image, "AnnotationRef", {"ID": "Annotation:0"})
        held = ElementTree.SubElement(root, "StructuredAnnotations")
        note = ElementTree.SubElement(held, "MapAnnotation", {"ID": "Annotation:0", "Namespace": _OURS})
        value = ElementTree.SubElement(note, "Value")
        for name, text in said.items():
            ElementTree.SubElement(value, "M", {"K": name}).text = text
    # the serialiser escapes ">" wherever else it stands; without the blanks our files keep the bytes they had
    text = ElementTree.tostring(root, encoding="unicode").replace(" />", "/>")
    return f'<?xml version="1.0" encoding="UTF-8"?>{_ascii(text)}'
