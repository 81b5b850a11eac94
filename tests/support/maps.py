"""Files of maps, as a run leaves them."""

from pathlib import Path

from cadtof_cli.files.layers import stage_maps
from cadtof_cli.files.maps import DepthMaps, MapHeader

_NO_FACTS = MapHeader()


def write_maps(path: Path, maps: DepthMaps, /, *, header: MapHeader = _NO_FACTS) -> None:
    """Write maps in the format that `path` ends with."""
    partial, _ = stage_maps(path, maps, header=header)
    partial.commit()
