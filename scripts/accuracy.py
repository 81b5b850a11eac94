"""Print the accuracy of cadtof: residuals of the closed form, Table 1 of the paper, and errors of captures with truth."""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from with_truth import capture_truth

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture, read_stored, single_frames
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.phasors.noise import MAD_PER_SIGMA, noise_model
from cadtof_cli.phasors.response import pulse_response
from cadtof_cli.pipeline.first_phasor import first_phasor_depth
from cadtof_cli.pipeline.frame import resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.two_path.closed_form import TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.two_path.uncertainty import two_path_sigmas

ROOT = Path(__file__).resolve().parent.parent
T1_NS = 40.0
TOP_ROWS = 40

RUNS, N_AV, ASR, MPI_RATIO, DIRECT_NS = 400, 1e5, 5.0, 0.3, 5.0
"""The light of Table 1, and how often it is recorded."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "captures", nargs="*", type=Path, help="captures with truth.exr [default: those of sample_data]"
    )
    arguments = parser.parse_args()
    with np.errstate(all="ignore"):
        closed_form()
        table_1()
        print("\n| capture | first phasor, median cm | direct, median cm | direct, RMSE cm | σ predicted / seen |")
        print("|---|---|---|---|---|")
        folders = arguments.captures or sorted(p for p in (ROOT / "sample_data").iterdir() if p.is_dir())
        captures = [find_captures([folder])[0] for folder in folders]
        for capture in captures:
            depth_errors(capture)
        for capture in captures:
            if capture.root.name == "card":
                rows_without_mpi(capture)


def closed_form() -> None:
    rng = np.random.default_rng(2015)
    n = 200_000
    phases = rng.uniform(0, 2 * np.pi, (2, n))
    a, b = rng.random((2, n))
    near = 10.0 ** rng.uniform(-16, 0, n)
    cases: dict[str, tuple[Complex, Complex]] = {
        "random paths": paths_to_phasors(a, phases[0], b, phases[1]),
        "arbitrary phasors": (normal(rng, n), normal(rng, n)),
        "b → 0": paths_to_phasors(a, phases[0], near, phases[1]),
        "x → y": paths_to_phasors(a, phases[0], b, phases[0] + near),
        "p1 → 0": (near * np.exp(1j * phases[0]), a * np.exp(1j * phases[1])),
        "antipodal": paths_to_phasors(a, phases[0], b, phases[0] + np.pi),
        "one path": paths_to_phasors(a, phases[0], 0 * b, phases[1]),
    }
    print(f"| closed form, {n:,} pairs each | largest residual | least amplitude |")
    print("|---|---|---|")
    for name, (p1, p2) in cases.items():
        found = two_paths(fundamental_frame(p1, p2))
        x, y = rotors(found)
        residual = np.maximum(abs(found.a * x + found.b * y - p1), abs(found.a * x**2 + found.b * y**2 - p2))
        print(f"| {name} | {residual.max():.1e} | {min(found.a.min(), found.b.min()):.1e} |")


def normal(rng: np.random.Generator, n: int) -> Complex:
    values: Complex = rng.normal(size=n) + 1j * rng.normal(size=n)
    return values


def paths_to_phasors(a: Float, x: Float, b: Float, y: Float) -> tuple[Complex, Complex]:
    return a * np.exp(1j * x) + b * np.exp(1j * y), a * np.exp(2j * x) + b * np.exp(2j * y)


def rotors(paths: TwoPaths) -> tuple[Complex, Complex]:
    return paths.cos_x + 1j * paths.sin_x, paths.cos_y + 1j * paths.sin_y


def table_1() -> None:
    print("\n| Table 1: ASR 5, MPI 0.3, n_av 1e5 | direct std, ns | second std, ns | σ predicted / seen |")
    print("|---|---|---|---|")
    noise = noise_model(CaptureMetadata(), integration_length=N_AV, quantised=False)
    rng = np.random.default_rng(1)
    published = {16.0: ".05 / .16", 25.0: ".03 / .12", 11.0: ".17 / .52"}
    bounds = {16.0: ".049 / .165", 25.0: ".032 / .107", 11.0: ".157 / .510"}
    for second_ns, paper in published.items():
        paths = two_paths(fundamental_frame(*noisy(rng, second_ns)))
        x, y = (np.mod(np.angle(r), 2 * np.pi) * T1_NS / (2 * np.pi) for r in rotors(paths))
        sigma_x, sigma_y = (s * T1_NS / (2 * np.pi) for s in two_path_sigmas(paths, noise=noise))
        strong = paths.a > paths.b
        direct, second = np.where(strong, x, y), np.where(strong, y, x)
        ratios = (
            np.median(np.where(strong, sigma_x, sigma_y)) / direct.std(),
            np.median(np.where(strong, sigma_y, sigma_x)) / second.std(),
        )
        print(
            f"| 5, {second_ns:g} ns: paper {paper}; bound {bounds[second_ns]} | {direct.std():.3f} | {second.std():.3f} "
            f"| {ratios[0]:.2f}, {ratios[1]:.2f} |"
        )


def noisy(rng: np.random.Generator, second_ns: float) -> Iterator[Complex]:
    """Yield pulse-corrected phasors of both harmonics with the exact covariance of the average (docs/physics.md)."""

    def moment(k: int) -> complex:
        turns = np.exp(2j * np.pi * k * np.array([DIRECT_NS, second_ns]) / T1_NS)
        mixed = (turns[0] + MPI_RATIO * turns[1]) / (1 + MPI_RATIO + ASR)
        return complex(pulse_response(k, fwhm_ns=1.7, period_ns=T1_NS) * mixed)

    for h in (1, 2):
        m, m2 = moment(h), moment(2 * h)
        c, s = m.real, m.imag
        covariance = np.array(
            [[(1 + m2.real) / 2 - c * c, m2.imag / 2 - c * s], [m2.imag / 2 - c * s, (1 - m2.real) / 2 - s * s]]
        ) / (2 * N_AV - 1)
        drawn = rng.multivariate_normal([c, s], covariance, size=RUNS)
        yield np.asarray(drawn[:, 0] + 1j * drawn[:, 1], np.complex128) / pulse_response(
            h, fwhm_ns=1.7, period_ns=T1_NS
        )


def depth_errors(capture: Capture) -> None:
    truth = capture_truth(capture.root)
    plan = FramePlan(metadata=capture.source.metadata)
    first, direct, scores = [], [], []
    for source in single_frames(capture):
        stored = read_stored(source, capture.layout)
        maps = resolve_frame(stored, plan=plan).maps
        error = maps.layer(DIRECT_DEPTH) - truth
        first.append(100 * (first_phasor_depth(stored, plan=plan) - truth))
        direct.append(100 * error)
        scores.append(error / maps.layer(DIRECT_SIGMA))
    first_cm, direct_cm, score = (
        np.concatenate([e[np.isfinite(e)] for e in errors]) for errors in (first, direct, scores)
    )
    spread = np.median(np.abs(score)) / MAD_PER_SIGMA
    print(
        f"| {capture.root.name} | {np.median(abs(first_cm)):.2f} | {np.median(abs(direct_cm)):.2f} "
        f"| {np.sqrt(np.mean(direct_cm**2)):.2f} | {1 / spread:.2f} |"
    )


def rows_without_mpi(capture: Capture) -> None:
    """Print the errors in the card's rows without MPI, as ratios to those of the one-path fit: the cost of the order test."""
    truth = capture_truth(capture.root)[:TOP_ROWS]
    plan = FramePlan(metadata=capture.source.metadata)
    alone = replace(plan, settings=MapSettings(resolver=ResolverSettings(solver="one-path")))
    errors: dict[str, list[Float]] = {"auto": [], "one": []}
    false = []
    for source in single_frames(capture):
        stored = read_stored(source, capture.layout)
        auto = resolve_frame(stored, plan=plan).maps
        errors["auto"].append(auto.layer(DIRECT_DEPTH)[:TOP_ROWS] - truth)
        errors["one"].append(resolve_frame(stored, plan=alone).maps.layer(DIRECT_DEPTH)[:TOP_ROWS] - truth)
        false.append(np.mean((auto.status[:TOP_ROWS] & StatusBit.TWO_PATHS) != 0))
    ours, best = (np.concatenate(errors[name]).ravel() for name in ("auto", "one"))
    median = np.median(abs(ours)) / np.median(abs(best))
    rmse = np.sqrt(np.mean(ours**2) / np.mean(best**2))
    print(f"\n{capture.root}: top {TOP_ROWS} rows, which have no MPI, beside the one-path fit:")
    print(f"median |error| {median:.3f} ×, RMSE {rmse:.2f} ×, two paths in {np.mean(false):.2%} of pixels")


if __name__ == "__main__":
    main()
