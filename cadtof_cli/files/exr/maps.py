"""Depth maps as OpenEXR: one named channel a layer, float, and the status bits as an unsigned integer channel."""

from pathlib import Path

from cadtof_cli.maps.layers import STATUS, DepthMaps


def write_exr(path: Path, maps: DepthMaps, /, *, software: str) -> None:
    """Write the maps to `path`, uncompressed: compressing noise takes ten times as long as resolving it."""
    import OpenEXR

    channels = {name: maps.layer(name) for name in maps.names} | {STATUS: maps.status}
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage, "software": software}
    file = OpenEXR.File(header, channels, num_threads=0)
    try:
        file.write(str(path))
    except RuntimeError as error:
        # the library has no other kind of error, and its message names the temporary file
        raise OSError(str(error).rpartition('"')[2].strip(" .")) from error
