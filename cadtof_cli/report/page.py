"""The page of a run as one file: template, style, scripts and data, with a policy that lets no other script run."""

import hashlib
import json
from base64 import b64encode
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from cadtof_cli.arrays import Float32
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.files.atomic import write_text
from cadtof_cli.report.colours import Limits, palette
from cadtof_cli.report.frames import EmbeddedFrame
from cadtof_cli.report.markup import Markup, element, joined, text
from cadtof_cli.report.sections import (
    PageText,
    embedded_section,
    failures,
    frame_list,
    frame_table,
    settings,
    status_words,
    summary,
)
from cadtof_cli.resolver.status import StatusBit, bit_words
from cadtof_cli.units import printable
from cadtof_cli.version import __version__

SCRIPTS = ("decode.js", "colours.js", "map.js", "scale.js", "profile.js", "cloud.js", "panels.js", "main.js")
"""The scripts of the page. A script stands before all scripts that use it."""


@dataclass(frozen=True)
class ShownFrame:
    """A frame that the viewer shows, with the kind of its depths, range or z.

    `small_m` are its depths for a thumbnail, (Y, X). `truth` is the place of its truth among the truths of the page; None: no
    truth is known.
    """

    name: str
    embedded: EmbeddedFrame
    small_m: Float32
    optics: Optics
    depth: str
    truth: int | None = None

    def as_json(self, number: int, /) -> dict[str, Any]:
        """Return the frame in the form that the scripts of the page read; `number` is its place in the viewer."""
        optics, focal = None, self.optics.focal_length_px
        if focal is not None:
            column, row = self.optics.principal_point(self.embedded.shape)
            optics = {"focal_length_px": focal, "column": column, "row": row}
        return {
            "name": printable(self.name),
            "data": f"frame-{number}",
            "depth": self.depth,
            "optics": optics,
            "truth": self.truth,
            **self.embedded.as_json(),
        }


def write_page(
    path: Path,
    page: PageText,
    /,
    *,
    frames: Collection[ShownFrame],
    truth: Collection[EmbeddedFrame],
    limits: Mapping[str, Limits],
) -> None:
    """Write a page, whole or not at all; raises OutputError if the file cannot be written.

    The viewer shows `frames`. `truth` is that of each capture with the steps of its frames; empty: no truth is known. `limits`
    are those of each layer over the run, in the unit of the layer.
    """
    run = json.dumps(_document(frames, truth, limits), allow_nan=False, separators=(",", ":"))
    # no browser finds an end or a begin of an element in the data
    run = run.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
    style, script = _file("page.css"), "\n".join(_file(name) for name in SCRIPTS)
    markup = Template(_file("page.html")).substitute(
        policy=text(_policy(style, script)),
        version=text(__version__),
        title=text(page.title),
        subtitle=text(page.subtitle),
        summary=summary(page),
        failures=failures(page),
        strip=frame_list(page),
        words=status_words(),
        settings=settings(page),
        table=frame_table(page),
        embedded=embedded_section([frame.embedded for frame in frames], truth),
        run=run,
        data=_payloads(frames, truth),
        style=style,
        script=script,
    )
    write_text(path, markup)


def _file(name: str) -> str:
    return files("cadtof_cli.report").joinpath("page", name).read_text(encoding="utf-8")


def _policy(style: str, script: str) -> str:
    """Return the content security policy. It allows the page's own script, style and pictures, and no network."""
    script_digest, style_digest = (
        b64encode(hashlib.sha256(source.encode()).digest()).decode() for source in (script, style)
    )
    return (
        f"default-src 'none'; script-src 'sha256-{script_digest}'; style-src 'sha256-{style_digest}'; img-src data:; "
        "base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
    )


def _document(
    frames: Collection[ShownFrame], truth: Collection[EmbeddedFrame], limits: Mapping[str, Limits]
) -> dict[str, Any]:
    """Return the data that the scripts need, without the maps."""
    colours, bits = palette(), []
    for bit in StatusBit:
        meaning, colour = bit.meaning.replace("`", ""), colours["status"][bit.name]
        bits.append({"name": bit_words(bit), "value": int(bit), "meaning": meaning, "colour": colour})
    return {
        "frames": [frame.as_json(number) for number, frame in enumerate(frames)],
        "truth": [{"data": f"truth-{number}", **one.as_json()} for number, one in enumerate(truth)],
        "limits": {name: list(values) for name, values in limits.items()},
        "bits": bits,
        "palette": {name: colours[name] for name in ("sequential", "diverging", "no_answer")},
    }


def _payloads(frames: Collection[ShownFrame], truth: Collection[EmbeddedFrame]) -> Markup:
    named = [(f"frame-{number}", frame.embedded) for number, frame in enumerate(frames)]
    named += [(f"truth-{number}", one) for number, one in enumerate(truth)]
    return joined(element("script", Markup(one.data), type="text/plain", id=name) for name, one in named)
