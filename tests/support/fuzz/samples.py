"""Sound samples of everything that is read; they are so small that thousands of spoiled ones are tried in a minute."""

import io
import json
import lzma
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.calibration.store import save_part
from cadtof_cli.capture.toml import load_metadata
from tests.files.forms import CODEC_FORMS, EXR_FORMS, PLANE_FORMS, TIFF_FORMS, Form, known_frame, planes_of
from tests.support.calibrations import made_up_calibration
from tests.support.captures import TOML, counts_of, record, write_exr
from tests.support.forward import step_frame, step_truth

CORPUS = Path(__file__).parents[2] / "corpus"

SHAPE = (24, 32)

CALIBRATION_FILES = ("dark.toml", "dark.exr", "response.toml", "response.exr", "petzval.toml")


def make_sound(place: Path, run: Callable[[Sequence[object]], str], /) -> Path:
    """Record a capture of two frames in an empty folder, resolve it, and make up truth and calibration; return the folder.

    `run` runs a command line of `cadtof` in that folder.
    """
    place.mkdir()
    record(place / "cap", frames=2)
    (place / "cal").mkdir()
    metadata = load_metadata(place / "cap" / "capture.toml").metadata
    for part in made_up_calibration(metadata, SHAPE, ("dark", "response", "petzval")).parts:
        save_part(place / "cal", part)
    truth = step_truth().astype(np.float32)
    write_exr(place / "truth.exr", {"direct.depth": truth, "direct.amplitude": truth, "direct.sigma": truth})
    before = Path.cwd()
    os.chdir(place)
    try:
        run(("resolve", "cap", "-o", "out", "-j", 1, "-q"))
        run(("resolve", "cap", "-o", "exr", "-j", 1, "-q", "--format", "exr"))
    finally:
        os.chdir(before)
    return place


def _written(form: Form) -> list[bytes]:
    """Return the file of a form; if a frame has several files, the first one."""
    with tempfile.TemporaryDirectory() as folder:
        source = form.write(Path(folder) / "frame", known_frame(form.dtype, shape=(20, 24)))
        return [source.paths[0].read_bytes()]


def _corpus(suffix: str) -> list[bytes]:
    return [lzma.decompress(path.read_bytes()) for path in sorted(CORPUS.glob(f"*{suffix}.xz"))]


def _tiff_of(pages: NDArray[Any], **options: Any) -> bytes:
    stream = io.BytesIO()
    tifffile.imwrite(stream, pages, photometric="minisblack", **options)
    return stream.getvalue()


@cache
def tiffs() -> list[bytes]:
    """Frames in TIFF files of every form, and the counts and volts of a camera."""
    volts = step_frame(np.random.default_rng(1))
    frames = [
        _tiff_of(counts_of(volts), metadata=None),
        _tiff_of(volts.astype(np.float32), metadata={"axes": "HCYX"}),
        _tiff_of(volts.astype(np.float32), metadata=None, compression="zlib", predictor=True),
    ]
    return frames + [content for form in TIFF_FORMS + CODEC_FORMS for content in _written(form)] + _corpus(".tif")


@cache
def stacks() -> list[bytes]:
    """Three frames in a TIFF file."""
    frames = np.stack([counts_of(step_frame(np.random.default_rng(seed))).reshape(2, 2, *SHAPE) for seed in range(3)])
    return [
        _tiff_of(frames.reshape(-1, *SHAPE), metadata=None),
        _tiff_of(frames, metadata={"axes": "THCYX"}),
        _tiff_of(frames.reshape(3, 4, *SHAPE), ome=True, metadata={"axes": "TCYX"}),
        _tiff_of(frames, metadata={"axes": "THCYX"}, compression="zlib", bigtiff=True),
    ]


@cache
def exrs() -> list[bytes]:
    """Frames in EXR files of every form and compression."""
    return [content for form in EXR_FORMS for content in _written(form)] + _corpus(".exr")


@cache
def planes(suffix: str) -> list[bytes]:
    """A plane in a file."""
    plane = planes_of(known_frame("u2", shape=SHAPE))[0]
    if suffix == ".png":
        return [bytes(imagecodecs.png_encode(one)) for one in (plane, (plane >> 8).astype(np.uint8))]
    if suffix == ".npy":
        return [_npy(plane)]
    return [content for form in PLANE_FORMS if ("exr" in form.name) == (suffix == ".exr") for content in _written(form)]


def _npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


@cache
def npys() -> list[bytes]:
    """Frames and stacks that numpy saved."""
    frame = known_frame("u2", shape=SHAPE)
    volts = step_frame(np.random.default_rng(2))
    return [
        _npy(frame),
        _npy(planes_of(frame)),
        _npy(np.stack([frame, frame])),
        _npy(volts),
        _npy(np.asfortranarray(volts)),
    ]


@cache
def raws() -> list[bytes]:
    """Dumps without a header."""
    return [known_frame("u2", shape=SHAPE).tobytes(), known_frame("u2", shape=SHAPE).tobytes() * 3]


def file_of(place: Path, name: str) -> list[bytes]:
    """Return the content of one sound file."""
    return [(place / name).read_bytes()]


@cache
def tomls() -> list[bytes]:
    """Settings of captures, which together have all tables."""
    every = TOML["tif"] + "[target]\ndistance_m = 2.5\n[layout]\nframes = 1\n"
    layouts = (
        '[layout]\npattern = "{frame}_h{harmonic}_c{channel}.tif"\nchannel = ["1", "2"]\nharmonic = { "1" = 1, "2" = 2 }\n',
        '[layout.raw]\ndtype = "uint16"\nshape = [2, 2, 24, 32]\noffset_bytes = 0\n',
    )
    triangle = TOML["tif"].replace('"sine"', '"triangle"')
    old = [content.decode() for content in _corpus(".toml")]
    return [text.encode() for text in (every, triangle, *(TOML["tif"] + layout for layout in layouts), *old)]


@cache
def command_lines() -> list[bytes]:
    """Command lines with options, one word per line."""
    return [
        text.replace(" ", "\n").encode()
        for text in (
            "resolve cap -o new -j 1 --periods-ns 40,20 --waveform sine --amplitude-v 0.2746 --fwhm-ns 1.7",
            "resolve cap -o new -j 1 --integration-length 1e5 --volts-per-count 6e-5 --quiet",
            "resolve cap -o new -j 1 --solver lm --paths 2 --seed 3 --order auto --false-alarm 0.01 --return first --pool 3",
            "resolve cap -o new -j 1 --roi 2,3,10,12 --frames 0:1 --average 2 --min-return-ratio 0.1 --min-confidence 0.001",
            "resolve cap -o new -j 1 --depth z --focal-length-px 28 --principal-point-px 15,10 --format exr --json --dry-run",
            "resolve cap -o new -j 1 --mpi-model diffuse --calibration cal --saturated-counts 0,16383 --stack-frames 1",
            "info cap -j 1 --json --zero-counts 8192 --volts-per-count 6e-5 --raw-dtype uint16 --raw-shape 2,2,24,32",
            "info cap out cal -j 1",
            "inspect cap --pixel 3,4 --frame 1 --json --waveform triangle",
            "evaluate out --truth truth.exr --json --max-median 5",
            "export out -o new.ply --focal-length-px 28 --layer direct.depth --depth z",
            "compare out exr --json",
            "calibrate dark cap -o new",
            "calibrate response cap -o new --distance-m 2.5",
        )
    ]


@cache
def lists_of_paths() -> list[bytes]:
    """Paths, as they come on stdin."""
    return [b"cap/frame_0.tif\ncap/frame_1.tif\n", b"cap\n", b"cap/frame_0.tif\n" + b"cap/" + b"a" * 250 + b".tif\n"]


def run_records(place: Path) -> list[bytes]:
    """Records of runs."""
    (record_of,) = file_of(place, "out/run.json")
    document = json.loads(record_of)
    document["arguments"] |= {"roi": [0, 0, 32, 24], "frames": [0, 2], "average": 1, "settings": None}
    return [record_of, json.dumps(document).encode()]


def copy_of(place: Path, target: Path, /) -> Path:
    """Copy a folder of sound files."""
    shutil.copytree(place, target, dirs_exist_ok=True, symlinks=True)
    return target
