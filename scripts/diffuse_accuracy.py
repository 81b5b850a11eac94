"""Measure how well diffuse MPI is predicted: errors of captures with truth, as two paths and by `--mpi-model auto`.

`python scripts/diffuse_accuracy.py CAPTURE...` prints a row per capture and a summary of all captures. `--figure PNG`
draws the errors of the first capture. `--integration-length N` adds the noise of less light. `scripts/render_rooms.py`
renders rooms as captures.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from with_truth import capture_truth, first_stored, resolved

from cadtof_cli.arrays import Float, Stored
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture, read_stored, single_frames
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.figures.page import Block, Panel, draw_page
from cadtof_cli.figures.scales import ERRORS, SIGMAS, Scale
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.noise import noise_model
from cadtof_cli.pipeline.first_phasor import first_phasor_depth
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.settings import MpiModel
from cadtof_cli.resolver.status import StatusBit

SHARES = (0.55, 0.95)
"""Sigma is called true if the share of errors within one predicted sigma lies between these limits. It is 0.68 if
the errors are Gaussian."""

OFFSET_CM = 0.3
"""Added to medians before their logarithm is taken, so that errors below the noise do not get too much weight."""

FAR_OFF, FAR_OFF_M = 6.0, 0.1
"""An error is called gross if it is larger than 6 sigma and than 10 cm."""

FIGURE_CM = 10.0
"""Error at the ends of the colour scale."""

MODELS: tuple[MpiModel, MpiModel] = ("auto", "discrete")
"""The models of MPI that the figure compares."""


@dataclass(frozen=True)
class Row:
    """Errors of the direct depth of a capture in cm, resolved in three ways.

    Attributes:
        name: folder of the capture.
        first: errors of the first phasor.
        two_paths: errors of two paths.
        taken: errors of the chosen model.
        within: shares of the errors of `taken` within 1 and 2 sigma.
        gross: share of them that are gross.
        diffuse: share of pixels that the chosen model takes for diffuse MPI.
    """

    name: str
    first: Float
    two_paths: Float
    taken: Float
    within: tuple[float, float]
    gross: float
    diffuse: float

    @property
    def medians(self) -> tuple[float, float, float]:
        """Medians of |error| of the first phasor, of two paths, and of the chosen model."""
        first, two, taken = (float(np.nanmedian(np.abs(error))) for error in (self.first, self.two_paths, self.taken))
        return first, two, taken

    def line(self) -> str:
        """The row of the table."""
        errors = (self.first, self.two_paths, self.taken)
        cells = [f"{np.nanmedian(abs(e)):.2f} / {np.nanpercentile(abs(e), 90):.1f}" for e in errors]
        cells[-1] += f"; {self.within[0]:.2f}, {self.within[1]:.2f}"
        return f"| {self.name} | {' | '.join(cells)} | {self.diffuse:.0%} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path, nargs="+", help="folders of captures with truth.exr")
    parser.add_argument("--figure", type=Path, help="PNG of the errors of the first capture")
    parser.add_argument(
        "--model", default="auto", choices=("auto", "diffuse"), help="model of MPI that is compared with two paths"
    )
    parser.add_argument(
        "--integration-length",
        type=float,
        help="n_av of two harmonics instead of that of the captures; more harmonics share it, and noise is added",
    )
    chosen = parser.parse_args()
    print("| capture | first phasor, cm: median / 90 % | two paths | as taken; share within 1, 2 sigma | diffuse |")
    print("|---|---|---|---|---|")
    rows = []
    for capture in find_captures(chosen.captures):
        rows.append(measured(capture, chosen.model, chosen.integration_length))
        print(rows[-1].line(), flush=True)
    together(rows)
    if chosen.figure:
        draw(find_captures(chosen.captures[:1])[0], chosen.figure)


def measured(capture: Capture, model: MpiModel, integration_length: float | None = None) -> Row:
    """Resolve all frames of a capture by a model and as two paths; an integration length adds the noise of less light."""
    truth = capture_truth(capture.root)
    first, two, taken, score, gross, status = [], [], [], [], [], []
    for source in single_frames(capture):
        stored, metadata = read_stored(source, capture.layout), capture.source.metadata
        if integration_length is not None:
            stored, metadata = with_less_light(stored, metadata, integration_length)
        found, discrete = (resolved(stored, metadata, model=one).maps for one in (model, "discrete"))
        error = found.layer(DIRECT_DEPTH) - truth
        first.append(100 * (first_phasor_depth(stored, plan=FramePlan(metadata=metadata)) - truth))
        two.append(100 * (discrete.layer(DIRECT_DEPTH) - truth))
        taken.append(100 * error)
        score.append(np.abs(error / found.layer(DIRECT_SIGMA)))
        gross.append((score[-1] > FAR_OFF) & (np.abs(error) > FAR_OFF_M))
        status.append((found.status & StatusBit.DIFFUSE_MPI) > 0)
    scores = np.concatenate(score)[np.isfinite(np.concatenate(score))]
    within = float(np.mean(scores < 1.0)), float(np.mean(scores < 2.0))
    shares = float(np.mean(gross)), float(np.mean(status))
    return Row(capture.root.name, np.stack(first), np.stack(two), np.stack(taken), within, *shares)


def with_less_light(
    stored: Stored, metadata: CaptureMetadata, integration_length: float
) -> tuple[Stored, CaptureMetadata]:
    """Return a frame of counts, (H, 2, Y, X), with added noise, so that it has that of a shorter integration length.

    The added noise along and across each phasor is that of a single path with the phasor's amplitude (docs/physics.md,
    the covariance of Eq. 1).
    """
    length, recorded = float(round(integration_length * 2 / len(stored))), metadata.pixel.mean_length or 0.0
    if length >= recorded:
        raise SystemExit(f"found captures of an integration length of {recorded:g}, expected more than {length:g}")
    before, after = (noise_model(metadata, integration_length=n, quantised=False).each for n in (recorded, length))
    volts_per_count, zero = metadata.voltage.volts_per_count or 1.0, metadata.voltage.zero_counts or 0.0
    counts, generator = stored.astype(np.float64), np.random.default_rng(0)
    for plane, old, new in zip(counts, before, after, strict=True):
        phasor = (plane[0] - zero + 1j * (plane[1] - zero)) * volts_per_count / metadata.modulation.amplitude_v
        size = np.abs(phasor) / old.pulse
        along, across = (
            np.sqrt(np.maximum(more - less, 0.0)) * old.pulse * generator.standard_normal(size.shape)
            for less, more in zip(old.one_path_variances(size), new.one_path_variances(size), strict=True)
        )
        noise = (
            (along + 1j * across) * np.exp(1j * np.angle(phasor)) * metadata.modulation.amplitude_v / volts_per_count
        )
        plane[0] += noise.real
        plane[1] += noise.imag
    noisy = np.rint(counts).astype(stored.dtype)
    return noisy, replace(metadata, pixel=Pixel(integration_length=length))


def together(rows: Sequence[Row]) -> None:
    """Print a summary of all captures."""
    medians = np.array([row.medians for row in rows])
    ratio, within = medians[:, 2] / medians[:, 1], np.array([row.within[0] for row in rows])
    gross = 1e3 * np.array([row.gross for row in rows])
    calibrated = np.count_nonzero((within >= SHARES[0]) & (within <= SHARES[1]))
    print(
        f"\n{len(rows)} captures: median error over that of two paths {np.median(ratio):.2f}, {ratio.max():.2f} at worst; "
        f"within 1 sigma in {SHARES[0]} … {SHARES[1]}: {calibrated}; "
        f"geometric mean of the medians {np.exp(np.mean(np.log(OFFSET_CM + medians[:, 2]))) - OFFSET_CM:.2f} cm, "
        f"of two paths {np.exp(np.mean(np.log(OFFSET_CM + medians[:, 1]))) - OFFSET_CM:.2f} cm; "
        f"gross errors: {gross.mean():.2f} in 1000, {gross.max():.1f} at worst"
    )


def draw(capture: Capture, path: Path) -> None:
    """Draw the errors of a capture's first frame by each model, and the predicted sigma."""
    truth = capture_truth(capture.root)
    stored = first_stored(capture)
    auto, discrete = (resolved(stored, capture.source.metadata, model=model).maps for model in MODELS)
    depths = {
        "first phasor": first_phasor_depth(stored, plan=FramePlan(metadata=capture.source.metadata)),
        "two paths": discrete.layer(DIRECT_DEPTH).astype(np.float64),
        "predicted tail": auto.layer(DIRECT_DEPTH).astype(np.float64),
    }
    errors = tuple(Panel(f"{name}\nerror, cm", 100 * (depth - truth), auto.status) for name, depth in depths.items())
    sigma = Panel("predicted tail\nsigma, cm", 100 * auto.layer(DIRECT_SIGMA), auto.status)
    blocks = (
        Block(errors, "cm", Scale(ERRORS, (-FIGURE_CM, FIGURE_CM))),
        Block((sigma,), "cm", Scale(SIGMAS, (0.0, FIGURE_CM))),
    )
    draw_page((blocks,), path, title=f"{capture.root.name}: direct depth against truth")


if __name__ == "__main__":
    main()
