"""A picture of a calibration: offsets, noise, phases, gains and field curvature; each of these kinds has one scale."""

from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Float, plane_name
from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.figures.page import Block, Panel, draw_page
from cadtof_cli.figures.scales import Scale


def draw_calibration(calibration: Calibration, path: Path, /, *, title: str) -> None:
    """Draw all parts of a calibration. In its dark part, bad pixels have the colour of pixels without an answer."""
    rows: list[list[Block]] = []
    if calibration.dark is not None:
        rows += _dark_rows(calibration.dark)
    if calibration.response is not None:
        rows.append(_response_row(calibration.response))
    if calibration.petzval is not None:
        offset = 100.0 * calibration.petzval.range_offset_m
        scale = Scale.of_differences(offset, share=100.0)
        block = Block((Panel("field curvature", offset),), "added to the range, cm", scale)
        if rows and sum(len(one.panels) for one in rows[-1]) < 4:
            rows[-1].append(block)
        else:
            rows.append([block])
    draw_page(rows, path, title=title)


def _dark_rows(dark: DarkCalibration) -> list[list[Block]]:
    """Return a row for each harmonic: the offsets of both channels, and the noise of one frame in both channels."""
    offset, noise = 1000.0 * dark.offset_v.astype(np.float64), 1000.0 * dark.noise_v.astype(np.float64)
    offset[..., dark.hot], noise[..., dark.hot] = np.nan, np.nan
    of_offset, of_noise = Scale.of_layer("dark.offset", offset), Scale.of_layer("dark.noise", noise)
    return [
        [
            Block(_channels("dark offset", harmonic, offset[row]), "mV", of_offset),
            Block(_channels("dark noise", harmonic, noise[row]), "of a frame, mV", of_noise),
        ]
        for row, harmonic in enumerate(dark.origin.harmonics)
    ]


def _channels(what: str, harmonic: int, planes: Float) -> tuple[Panel, ...]:
    return tuple(
        Panel(f"{what} {plane_name(harmonic, channel)}", plane) for channel, plane in enumerate(planes, start=1)
    )


def _response_row(response: ResponseCalibration) -> list[Block]:
    """Return a row: for each harmonic, the phase that each pixel adds, and the gain by which it multiplies."""
    harmonics = response.origin.harmonics
    phase, gain = np.degrees(response.phase_rad.astype(np.float64)), response.gain.astype(np.float64)
    of_phase = tuple(Panel(f"phase H{h}", plane) for h, plane in zip(harmonics, phase, strict=True))
    of_gain = tuple(Panel(f"gain H{h}", plane) for h, plane in zip(harmonics, gain, strict=True))
    return [
        Block(of_phase, "added by the pixel, °", Scale.of_differences(phase, share=99.5)),
        Block(of_gain, "times", Scale.of_layer("gain", gain)),
    ]
