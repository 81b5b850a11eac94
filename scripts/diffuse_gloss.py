"""Measure the prediction of diffuse MPI in rooms whose surfaces are all glossy.

`python scripts/diffuse_gloss.py ROOM...` takes captures of `scripts/render_rooms.py`, and adds to every pixel the light
that its surface mirrors: the lamp's direct light on the surface in the mirror's direction, spread over a lobe, times
each share of the table. A waxed floor mirrors .04 to .1 of this light, a lacquered cupboard up to .3. Errors are
medians over the rooms of the median error, in cm.
"""

import argparse
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from diffuse_nets import capture_volts
from with_truth import capture_truth, resolved

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture
from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.files.layers import read_layers
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.response import pulse_response
from cadtof_cli.resolver.settings import MpiModel
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.simulation.scene.rooms.view import View
from cadtof_cli.units import C_M_PER_NS

SHARES = (0.0, 0.03, 0.1, 0.3)
"""Shares of the light from the mirror's direction that surfaces send on."""

LOBE_RAD = 0.06
"""Standard deviation of each component of the mirrored direction."""

RAYS = 8
"""Number of directions in a lobe."""

START_M = 1e-3

LEAST_LIT = 0.02
"""Least direct light of a pixel, as a share of the median. Darker pixels get no mirrored light, because mirrored
light is computed as a multiple of the pixel's direct light."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path, nargs="+", help="folders of captures with truth.exr")
    captures = find_captures(parser.parse_args().captures)
    print(
        "| mirrored | two paths | as taken; share within 1 sigma | frames taken as tails | … with something seen through |"
    )
    print("|---|---|---|---|---|")
    for share in SHARES:
        rows = np.array([row(capture, share) for capture in captures])
        two, taken, within = np.median(rows[:, :3], axis=0)
        tails, nets = (int(count) for count in rows[:, 3:].sum(axis=0))
        print(f"| {share:g} | {two:.2f} | {taken:.2f}; {within:.2f} | {tails} of {len(rows)} | {nets} |", flush=True)


def row(capture: Capture, share: float) -> tuple[float, float, float, float, float]:
    """Return the results of one frame with this share of mirrored light.

    These are the median errors in cm of two paths and of `auto`, the share of the errors of `auto` within 1 sigma,
    whether a tail was predicted, and whether something was found that lets light through.
    """
    truth, volts = capture_truth(capture.root), capture_volts(capture)
    metadata = replace(capture.source.metadata, voltage=Voltage())
    if share:
        periods, fwhm_ns = metadata.modulation.periods_ns, metadata.pulse.fwhm_ns
        ratios, delays_ns = mirrored(capture)
        amplitude = np.nan_to_num(read_layers(capture.root / "truth.exr")["direct.amplitude"].astype(np.float64))
        for plane, h in zip(volts, metadata.modulation.harmonics, strict=True):
            turn = np.exp(2j * np.pi * h / periods[0] * delays_ns)
            left = pulse_response(h, fwhm_ns=fwhm_ns, period_ns=periods[0])
            light = share * left * amplitude * (ratios * turn).mean(axis=0)
            plane[0], plane[1] = plane[0] + light.real, plane[1] + light.imag
    errors: list[Float] = []
    models: tuple[MpiModel, ...] = ("discrete", "auto")
    for model in models:
        frame = resolved(volts, metadata, model=model)
        errors.append(np.abs(frame.maps.layer(DIRECT_DEPTH) - truth))
    score = np.asarray(errors[1] / frame.maps.layer(DIRECT_SIGMA), np.float64)
    two, taken = (100 * float(np.nanmedian(error)) for error in errors)
    mpi = frame.mpi
    tail, net = (float(mpi.taken == "diffuse"), float(mpi.net_patches > 0)) if mpi else (0.0, 0.0)
    return two, taken, float(np.mean(score[np.isfinite(score)] < 1.0)), tail, net


def mirrored(capture: Capture) -> tuple[Float, Float]:
    """Return the direct light on the surface that each pixel mirrors, and when it arrives in ns, (RAYS, Y, X) each.

    The light is a multiple of the pixel's own direct light.
    """
    found = re.search(r"room_(\d+)", capture.root.name)
    optics, shape = capture.source.metadata.optics, capture_truth(capture.root).shape
    if found is None or optics.focal_length_px is None:
        raise SystemExit(f"{capture.root}: no capture of scripts/render_rooms.py")
    camera = Camera(width=shape[1], height=shape[0], focal_length_px=optics.focal_length_px)
    scene = RandomRoom(seed=int(found[1]))
    view = View(room=scene.room, camera=camera, lamp_offset_m=scene.lamp_offset_m)
    seen = view.meet(camera.rays(slice(None)).reshape(3, -1))
    direct = view.direct(seen) * seen.albedo
    least = LEAST_LIT * float(np.median(direct[direct > 0]))
    position = np.asarray(view.room.position_m, np.float32)[:, None]
    way = (seen.points_m - position) / seen.lengths_m
    mirror = way - 2.0 * (way * seen.normals).sum(axis=0) * seen.normals
    ratios, delays = np.zeros((RAYS, direct.size)), np.zeros((RAYS, direct.size))
    generator = np.random.default_rng(0)
    for ray in range(RAYS):
        turned: Float32 = (mirror + LOBE_RAD * generator.normal(size=mirror.shape)).astype(np.float32)
        turned /= np.linalg.norm(turned, axis=0)
        there = view.room.interior.meet(seen.points_m + np.float32(START_M) * seen.normals, turned)
        outward = (turned * seen.normals).sum(axis=0) > 0
        ratios[ray] = np.where(
            outward & (direct > least), view.direct(there) * there.albedo / np.maximum(direct, least), 0.0
        )
        delays[ray] = (seen.lengths_m + there.lengths_m + view.lamp.distances_m(there.points_m)) / C_M_PER_NS
    return ratios.reshape(RAYS, *shape), delays.reshape(RAYS, *shape)


if __name__ == "__main__":
    main()
