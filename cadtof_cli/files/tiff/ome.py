"""OME-XML, the description of the pages in the first page of an OME-TIFF: what other software says in it, and what we do."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from cadtof_cli.files.maps import SOFTWARE, MapHeader
from cadtof_cli.files.named_planes import channel_in_words, is_of_a_plane, says_a_harmonic

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_NAMESPACE = "cadtof"
_UNIT = "unit of "
"""Namespace of our annotations, and prefix of the names of annotations that give the unit of a layer."""

_SCHEMA = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def parsed(xml: str) -> "Element":
    """Return the root of an XML text; an empty element if the text is no XML."""
    from xml.etree import ElementTree

    try:
        return ElementTree.fromstring(xml)
    except ElementTree.ParseError:
        # if it should be OME-XML, tifffile logs an error for this, which `reading_tiff` turns into a FrameError
        return ElementTree.Element("none")


def elements(root: "Element", tag: str) -> list["Element"]:
    """Return all elements with this tag, with or without a namespace."""
    return [element for element in root.iter() if element.tag.rpartition("}")[2] == tag]


def channel_names(xml: str, /) -> tuple[str, ...]:
    """Return the names of all channels in OME-XML (an empty text: no name); empty if the text is no XML.

    If the text describes several images, the names of the images count as well: see `_name_in_image`.
    """
    root = parsed(xml)
    images = elements(root, "Image")
    if len(images) > 1:
        return tuple(
            _name_in_image(image.get("Name", ""), channel.get("Name", ""))
            for image in images
            for channel in elements(image, "Channel")
        )
    return tuple(channel.get("Name", "") for channel in elements(root, "Channel"))


def _name_in_image(image: str, channel: str) -> str:
    """Return the name of a channel in a file of several images, whose names may say which plane they hold.

    An image H2 with the channel SC1 holds H2.SC1. The name of an image counts as a whole if its channel has none, or
    has one that says nothing of planes.
    """
    if is_of_a_plane(channel):
        joins = says_a_harmonic(image) and not channel_in_words(image) and not says_a_harmonic(channel)
        return f"{image}.{channel}" if joins else channel
    return image if not channel or is_of_a_plane(image) else channel


def ome_xml(names: Sequence[str], /, *, size: tuple[int, ...], header: MapHeader) -> str:
    """Return OME-XML of one image: float pages of `size` (Y, X) with their names and units, and facts."""
    from xml.etree import ElementTree

    root = ElementTree.Element(
        "OME",
        {
            "xmlns": _SCHEMA,
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:schemaLocation": f"{_SCHEMA} {_SCHEMA}/ome.xsd",
            "Creator": SOFTWARE,
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
    facts = dict(header.facts) | {f"{_UNIT}{name}": unit for name, unit in header.units.items() if unit}
    if facts:
        ElementTree.SubElement(image, "AnnotationRef", {"ID": "Annotation:0"})
        annotations = ElementTree.SubElement(root, "StructuredAnnotations")
        annotation = ElementTree.SubElement(
            annotations, "MapAnnotation", {"ID": "Annotation:0", "Namespace": _NAMESPACE}
        )
        value = ElementTree.SubElement(annotation, "Value")
        for name, text in facts.items():
            ElementTree.SubElement(value, "M", {"K": name}).text = text
    # the serialiser escapes every other ">", so this changes only tags; without the blank, files keep the bytes they
    # had
    text = ElementTree.tostring(root).decode().replace(" />", "/>")
    return f'<?xml version="1.0" encoding="UTF-8"?>{text}'


def facts_in(xml: str, /) -> dict[str, str]:
    """Return the facts about the maps that OME-XML of ours holds, by name."""
    root = parsed(xml)
    ours = (element for element in root.iter(f"{{{_SCHEMA}}}MapAnnotation") if element.get("Namespace") == _NAMESPACE)
    pairs = ((pair.get("K", ""), pair.text or "") for one in ours for pair in one.iter(f"{{{_SCHEMA}}}M"))
    return {name: text for name, text in pairs if not name.startswith(_UNIT)}
