"""Measure the effect of a net in a room on the prediction of diffuse MPI, and of the prediction on the net's depth.

`python scripts/diffuse_nets.py ROOM... --without FOLDER` takes captures of `scripts/render_rooms.py --net-fill S`.
FOLDER holds the same rooms without a net, which tells where the net is. The script also prints what the prediction
gives if it does not look for nets.

`python scripts/diffuse_nets.py ROOM...` takes captures without a net, and adds a net before the middle of the view. The
net sends back 60 % of the light of its pixels, hangs as far before the wall as each row says, and has no MPI of its
own. Errors are medians in cm.
"""

import argparse
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from with_truth import capture_truth, first_stored, resolved

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.response import pulse_response
from cadtof_cli.phasors.voltages import volts_from_stored
from cadtof_cli.resolver.diffuse import predict
from cadtof_cli.resolver.settings import MpiModel
from cadtof_cli.units import C_M_PER_NS, metres_per_radian

DELAYS_NS = (4.0, 6.0, 9.0, 12.0, 14.0)

SHARE = 0.6
"""Share of a pixel's light that an added net sends back."""

NEAREST_M = 0.4

HIDDEN_M = 0.05
"""A pixel shows the net if its range is shorter than without the net by more than this."""

HEADS = "net: two paths | as taken; share within 1, 2 sigma | elsewhere: two paths | as taken | patches found"


@dataclass(frozen=True)
class Row:
    """Median errors of a frame in cm, each of two paths and of `auto`.

    Attributes:
        net: in the pixels of the net.
        elsewhere: in all other pixels.
        within: shares of the errors of `auto` in the net within 1 and 2 sigma.
        found: number of patches in which something was found that lets light through.
        unsearched: errors of `auto` in the net and elsewhere if it does not look for nets.
    """

    net: tuple[float, float]
    elsewhere: tuple[float, float]
    within: tuple[float, float]
    found: int
    unsearched: tuple[float, float]

    def line(self) -> str:
        """The cells of the row in the table."""
        (two, taken), (two_else, taken_else), (one, more) = self.net, self.elsewhere, self.within
        errors = f"{two:.1f} | {taken:.1f}; {one:.2f}, {more:.2f} | {two_else:.1f} | {taken_else:.1f}"
        return f"{errors} | {self.found}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path, nargs="+", help="folders of captures with truth.exr")
    parser.add_argument("--without", type=Path, help="folder of the same captures without a net")
    chosen = parser.parse_args()
    captures = find_captures(chosen.captures)
    if chosen.without:
        print(f"| room | net before what is behind, ns | {HEADS} |\n|---|---|---|---|---|---|---|")
        rows = [rendered(capture, chosen.without / capture.root.name) for capture in captures]
        together(rows)
        return
    print(f"| net before the wall, ns | {HEADS} |\n|---|---|---|---|---|---|")
    for delay_ns in DELAYS_NS:
        hung = [row for capture in captures if (row := with_net(capture, delay_ns)) is not None]
        if not hung:
            raise SystemExit(f"none of the captures has room for a net {delay_ns:g} ns before its wall")
        print(f"| {delay_ns:g} | {_median(hung).line()} |", flush=True)


def rendered(capture: Capture, without: Path) -> Row:
    """Print and return the row of a room that was rendered with a net."""
    net_m, behind_m = (capture_truth(folder) for folder in (capture.root, without))
    covered = net_m < behind_m - HIDDEN_M
    row = _row(capture_volts(capture), replace(capture.source.metadata, voltage=Voltage()), net_m, covered)
    delay_ns = 2 / C_M_PER_NS * float(np.nanmedian((behind_m - net_m)[covered]))
    print(f"| {capture.root.name} | {delay_ns:.1f} | {row.line()} |", flush=True)
    return row


def together(rows: Sequence[Row]) -> None:
    """Print a summary of all rooms."""
    two, taken = (np.array([row.net[i] for row in rows]) for i in (0, 1))
    unsearched, rest_unsearched = (np.array([row.unsearched[i] for row in rows]) for i in (0, 1))
    rest = np.array([row.elsewhere[1] for row in rows])
    found = np.array([row.found > 0 for row in rows])
    print(
        f"\n{len(rows)} rooms, a net found in {found.sum()}; geometric means of the medians, cm\n"
        f"net: two paths {_mean(two):.2f}, as taken {_mean(taken):.2f}, not looked for {_mean(unsearched):.2f}; "
        f"as taken better than two paths in {np.count_nonzero(taken < two)}\n"
        f"elsewhere: as taken {_mean(rest):.2f}, not looked for {_mean(rest_unsearched):.2f}"
    )
    if found.any():
        one, more = np.median([row.within for row in rows if row.found], axis=0)
        print(
            f"nets found: two paths {_mean(two[found]):.2f}, as taken {_mean(taken[found]):.2f}; share within 1, 2 sigma, "
            f"median {one:.2f}, {more:.2f}; better than not looked for in {np.count_nonzero((taken < unsearched)[found])}"
        )


def _mean(errors: Float) -> float:
    """Return the geometric mean."""
    return float(np.exp(np.mean(np.log(errors))))


def with_net(capture: Capture, delay_ns: float) -> Row | None:
    """Return the errors of a room with an added net; None if the room has no place for the net."""
    truth = capture_truth(capture.root)
    net_m = truth - 0.5 * C_M_PER_NS * delay_ns
    covered = np.zeros(truth.shape, np.bool_)
    height, width = truth.shape
    covered[height // 5 : -(height // 5), width // 3 : -(width // 3)] = True
    covered &= net_m > NEAREST_M
    if not covered.any():
        return None
    metadata = replace(capture.source.metadata, voltage=Voltage())
    volts = behind_net(capture_volts(capture), metadata, net_m, covered)
    return _row(volts, metadata, np.where(covered, net_m, truth), covered)


def behind_net(volts: Float, metadata: CaptureMetadata, net_m: Float, covered: Bool) -> Float:
    """Return the volts of a frame with an added net: in covered pixels, most of the light comes from the net."""
    phasors = volts[:, 0] + 1j * volts[:, 1]
    fwhm_ns, period_ns = metadata.pulse.fwhm_ns, metadata.modulation.periods_ns[0]
    left = [pulse_response(h, fwhm_ns=fwhm_ns, period_ns=period_ns) for h in metadata.modulation.harmonics]
    amplitude = np.abs(phasors[0]) / left[0]
    phase = net_m / metres_per_radian(period_ns)
    for phasor, share, h in zip(phasors, left, metadata.modulation.harmonics, strict=True):
        net = SHARE * amplitude * share * np.exp(1j * h * phase)
        phasor[covered] = ((1.0 - SHARE) * phasor + net)[covered]
    return np.stack([phasors.real, phasors.imag], axis=1)


def _row(volts: Float, metadata: CaptureMetadata, range_m: Float, covered: Bool) -> Row:
    errors: list[Float] = []
    found = 0
    models: Sequence[tuple[MpiModel, AbstractContextManager[object]]] = (
        ("discrete", nullcontext()),
        ("auto", patch.object(predict, "find_nets", lambda *_, **__: None)),
        ("auto", nullcontext()),
    )
    for model, search in models:
        with search:
            frame = resolved(volts, metadata, model=model)
        errors.append(np.abs(frame.maps.layer(DIRECT_DEPTH) - range_m))
        sigma = frame.maps.layer(DIRECT_SIGMA)
        found = frame.mpi.net_patches if frame.mpi else 0
    score = np.asarray(errors[-1] / sigma, np.float64)[covered]
    net, elsewhere = ([100 * float(np.nanmedian(error[where])) for error in errors] for where in (covered, ~covered))
    return Row(
        (net[0], net[2]),
        (elsewhere[0], elsewhere[2]),
        (float(np.mean(score < 1.0)), float(np.mean(score < 2.0))),
        found,
        (net[1], elsewhere[1]),
    )


def _median(rows: Sequence[Row]) -> Row:
    """Return the medians over rows."""
    net, elsewhere, within, unsearched = (
        tuple(float(value) for value in np.median([getattr(row, name) for row in rows], axis=0))
        for name in ("net", "elsewhere", "within", "unsearched")
    )
    found = int(np.median([row.found for row in rows]))
    return Row(
        (net[0], net[1]), (elsewhere[0], elsewhere[1]), (within[0], within[1]), found, (unsearched[0], unsearched[1])
    )


def capture_volts(capture: Capture) -> Float:
    """Return the first frame of a capture in V, (H, 2, Y, X)."""
    return volts_from_stored(first_stored(capture), capture.source.metadata.voltage)


if __name__ == "__main__":
    main()
