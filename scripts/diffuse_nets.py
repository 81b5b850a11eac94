"""What a net inside a room does to the prediction: rendered rooms behind a strong first surface.

`python scripts/diffuse_nets.py ROOM...` hangs a net over the middle of each capture of `scripts/render_rooms.py` (60 % of the
light of its pixels, as far before the wall as each row says) and prints the median error in its pixels, cm.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from diffuse_accuracy import F
from numpy.typing import NDArray

from cadtof_cli.capture.discovery import Capture, find_captures
from cadtof_cli.capture.frames import open_frames, single_frames
from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.files.maps import read_layers
from cadtof_cli.frame_plan import FramePlan, MapSettings
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.phasors.response import pulse_response
from cadtof_cli.pipeline import resolve_frame
from cadtof_cli.resolver.settings import MpiModel, ResolverSettings
from cadtof_cli.units import C_M_PER_NS, metres_per_radian

DELAYS_NS = (4.0, 6.0, 9.0, 12.0, 14.0)

SHARE = 0.6
"""Of the light of a pixel that the net sends back."""

NEAREST_M = 0.4


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path, nargs="+", help="folders of captures with truth.exr")
    captures = find_captures(parser.parse_args().captures)
    print(
        "| net before the wall, ns | two paths, cm | as taken by default, cm | frames taken as tails |\n|---|---|---|---|"
    )
    for delay_ns in DELAYS_NS:
        rows = [row for capture in captures if (row := errors(capture, delay_ns)) is not None]
        (two, taken, _), tails = np.median(rows, axis=0), sum(row[2] for row in rows)
        print(f"| {delay_ns:g} | {two:.1f} | {taken:.1f} | {tails:.0f} of {len(rows)} |", flush=True)


def errors(capture: Capture, delay_ns: float) -> tuple[float, float, float] | None:
    """Return median errors in the pixels of the net, cm, of two paths and as taken, and whether that is a tail."""
    truth = read_layers(capture.root / "truth.exr")[DIRECT_DEPTH].astype(np.float64)
    source = next(iter(single_frames(capture)))
    with open_frames(source, capture.layout) as frames:
        stored = frames.read(source.index or 0)
    net_m = truth - 0.5 * C_M_PER_NS * delay_ns
    covered = np.zeros(truth.shape, np.bool_)
    height, width = truth.shape
    covered[height // 5 : -(height // 5), width // 3 : -(width // 3)] = True
    covered &= net_m > NEAREST_M
    if not covered.any():
        return None
    volts, metadata = behind_net(stored, capture, net_m, covered), replace(capture.source.metadata, voltage=Voltage())
    found = []
    models: Sequence[MpiModel] = ("discrete", "auto")
    for model in models:
        settings = MapSettings(resolver=ResolverSettings(mpi_model=model))
        frame = resolve_frame(volts, plan=FramePlan(metadata=metadata, settings=settings))
        found.append(100 * float(np.nanmedian(np.abs(frame.maps.layer(DIRECT_DEPTH) - net_m)[covered])))
    return found[0], found[1], float(frame.mpi is not None and frame.mpi.taken == "diffuse")


def behind_net(stored: NDArray[np.generic], capture: Capture, net_m: F, covered: NDArray[np.bool_]) -> F:
    """Return the volts of a frame whose covered pixels get most of their light from a net."""
    metadata = capture.source.metadata
    voltage = metadata.voltage
    volts = (stored.astype(np.float64) - (voltage.zero_counts or 0.0)) * (voltage.volts_per_count or 1.0)
    phasors = volts[:, 0] + 1j * volts[:, 1]
    fwhm_ns, period_ns = metadata.pulse.fwhm_ns, metadata.modulation.periods_ns[0]
    left = [pulse_response(h, fwhm_ns=fwhm_ns, period_ns=period_ns) for h in metadata.modulation.harmonics]
    amplitude = np.abs(phasors[0]) / left[0]
    phase = net_m / metres_per_radian(period_ns)
    for phasor, share, h in zip(phasors, left, metadata.modulation.harmonics, strict=True):
        net = SHARE * amplitude * share * np.exp(1j * h * phase)
        phasor[covered] = ((1.0 - SHARE) * phasor + net)[covered]
    return np.stack([phasors.real, phasors.imag], axis=1)


if __name__ == "__main__":
    main()
