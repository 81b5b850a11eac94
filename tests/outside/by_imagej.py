"""Cases that ImageJ writes, run by Java without a window."""

from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Stored
from tests.outside.cases import SHUFFLED, Case, MissingWriterError, Writer, planes_of, run, shuffled_planes

_JAR = Path("/usr/share/java/ij.jar")


_PIXELS = """\
values = split(File.openAsString("values.txt"), "\\n");
newImage("frame", "{kind} black", {width}, {height}, 4);
for (i = 0; i < values.length; i++) {{
    if (i % ({width} * {height}) == 0) setSlice(1 + i / ({width} * {height}));
    setPixel(i % {width}, floor(i / {width}) % {height}, parseFloat(values[i]));
}}
"""


def _macro(*commands: str, shuffled: bool = False) -> Writer:
    """Return a writer that draws the planes as a stack, runs the commands of a macro and saves it as TIFF."""

    def write(folder: Path, frame: Stored) -> Path:
        if not _JAR.exists():
            raise MissingWriterError(f"ImageJ ({_JAR}) is not installed")
        planes = np.stack(shuffled_planes(frame) if shuffled else planes_of(frame))
        (folder / "values.txt").write_text("\n".join(map(str, planes.ravel().tolist())))
        height, width = planes.shape[1:]
        kind = f"{8 * planes.dtype.itemsize}-bit"
        drawn = _PIXELS.format(kind=kind, width=width, height=height)
        (folder / "macro.ijm").write_text("\n".join([drawn, *commands, 'saveAs("Tiff", "frame.tif");']))
        # names without folders, and this one is no Path: it runs in the folder, which may have letters that Java's locale lacks
        run("java", "-Djava.awt.headless=true", "-jar", str(_JAR), "-batch", folder / "macro.ijm")
        return folder / "frame.tif"

    return write


_HYPERSTACK = "Stack.setDimensions(2, 2, 1);"
_LABELS = [f'setSlice({place}); setMetadata("Label", "{name}");' for place, name in enumerate(SHUFFLED, start=1)]

CASES = [
    Case("ImageJ", "stack of four slices", _macro()),
    Case("ImageJ", "stack, 32-bit", _macro(), "f4"),
    Case("ImageJ", "hyperstack of 2 channels, 2 slices", _macro(_HYPERSTACK)),
    Case("ImageJ", "slice labels in another order", _macro(*_LABELS, shuffled=True)),
]
