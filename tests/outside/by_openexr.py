"""Cases that OpenEXR's own bindings and tools write."""

from pathlib import Path

import numpy as np
import OpenEXR

from cadtof_cli.arrays import Stored
from tests.outside.cases import Case, Writer, named_planes, planes_of, run
from tests.support.captures import PLANE_NAMES, write_exr


def _named(pattern: str, **header: object) -> Writer:
    """Return a writer of channels named by a pattern; EXR sorts them by name."""

    def write(folder: Path, frame: Stored) -> Path:
        channels = {pattern.format(h=h + 1, c=c + 1): frame[h, c] for h in range(2) for c in range(2)}
        return write_exr(folder / "frame.exr", channels, **header)

    return write


def _colours(names: str) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        return write_exr(folder / "frame.exr", dict(zip(names, planes_of(frame), strict=False)))

    return write


def _parts(folder: Path, frame: Stored) -> Path:
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"SC1": pair[0].copy(), "SC2": pair[1].copy()}, name)
        for name, pair in zip(("H2", "H1"), frame[::-1], strict=True)
    ]
    OpenEXR.File(parts, num_threads=0).write(str(folder / "frame.exr"))
    return folder / "frame.exr"


def _planes(folder: Path, frame: Stored) -> tuple[Path, ...]:
    return tuple(
        write_exr(folder / f"{name}.exr", {"Y": plane})
        for name, plane in zip(PLANE_NAMES, planes_of(frame), strict=True)
    )


def _tiled(*options: str) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        plain = write_exr(folder / "plain.exr", named_planes(frame))
        run("exrmaketiled", *options, plain, folder / "frame.exr")
        return folder / "frame.exr"

    return write


def _combined(folder: Path, frame: Stored) -> Path:
    files = [write_exr(folder / f"H{h + 1}.exr", {"SC1": frame[h, 0], "SC2": frame[h, 1]}) for h in range(2)]
    run("exrmultipart", "-combine", "-i", *files, "-o", folder / "frame.exr", "-override", "1")
    return folder / "frame.exr"


def _standard_attributes(folder: Path, frame: Stored) -> Path:
    plain = write_exr(folder / "plain.exr", named_planes(frame))
    run("exrstdattr", "-owner", "someone", "-comments", "a note", plain, folder / "frame.exr")
    return folder / "frame.exr"


def _deep(folder: Path, frame: Stored) -> Path:
    deep = np.empty(frame.shape[2:], object)
    for index in np.ndindex(deep.shape):
        deep[index] = np.array([1.0], "f4")
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(header, dict.fromkeys(PLANE_NAMES, deep), num_threads=0).write(str(folder / "frame.exr"))
    return folder / "frame.exr"


CASES = [
    Case("OpenEXR (Python)", "channels H1.SC1 …, ZIP", _named("H{h}.SC{c}", compression=OpenEXR.ZIP_COMPRESSION), "f4"),
    Case("OpenEXR (Python)", "channels H1_SC1 …, PIZ", _named("H{h}_SC{c}", compression=OpenEXR.PIZ_COMPRESSION), "f2"),
    Case("OpenEXR (Python)", "channels h1/sc1 …, uint", _named("h{h}/sc{c}"), "u4"),
    Case("OpenEXR (Python)", "channels H1-Sc1 …, RLE", _named("H{h}-Sc{c}", compression=OpenEXR.RLE_COMPRESSION), "f4"),
    Case("OpenEXR (Python)", "channels H1SC1 …, half, PXR24", _named("H{h}SC{c}", compression=OpenEXR.PXR24_COMPRESSION), "f2"),
    Case("OpenEXR (Python)", "a part a harmonic, H2 first", _parts, "f4"),
    Case("OpenEXR (Python)", "a file a plane, channel Y", _planes, "f4"),
    Case("OpenEXR (Python)", "channels R, G, B", _colours("RGB"), "f4", refused="colour picture"),
    Case("OpenEXR (Python)", "channels R, G, B, A", _colours("RGBA"), "f4", refused="colour picture"),
    Case("OpenEXR (Python)", "foreign channels u, v, w", _colours("uvw"), "f4", refused="channels u, v, w"),
    Case("OpenEXR (Python)", "deep samples", _deep, "f4", refused="deep"),
    Case("OpenEXR tools", "exrmaketiled, tiles", _tiled("-o", "-t", "16", "32"), "f4"),
    Case("OpenEXR tools", "exrmaketiled, mipmap", _tiled("-m"), "f2"),
    Case("OpenEXR tools", "exrmaketiled, ripmap, PIZ", _tiled("-r", "-z", "piz"), "f4"),
    Case("OpenEXR tools", "exrmultipart of a file a harmonic", _combined, "f4"),
    Case("OpenEXR tools", "exrstdattr", _standard_attributes, "f4"),
]  # fmt: skip
