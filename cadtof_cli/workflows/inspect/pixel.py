"""`cadtof inspect`: everything about one pixel of a recorded frame, resolved as `cadtof resolve` does it."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture, FrameSource
from cadtof_cli.errors import CadtofError, SettingsError, require
from cadtof_cli.files.documents import plain
from cadtof_cli.files.frames import NotAFrameError
from cadtof_cli.files.maps import STATUS, DepthMaps
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.phasors.voltages import volts_per_count
from cadtof_cli.pipeline.frame import prepare_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.one_pixel import OrderTest, PixelEvidence, pixel_evidence
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.diffuse.choice import DiffuseChoice
from cadtof_cli.resolver.status import ANSWERED, StatusBit, describe_status
from cadtof_cli.units import counted
from cadtof_cli.workflows.progress import NO_PROGRESS, Progress
from cadtof_cli.workflows.resolve.plans import CapturePlan, plan_captures, use_calibration
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from cadtof_cli.workflows.run_folder import read_run

NEIGHBOURS = 2
"""How many neighbours to each side are shown with their depths."""


@dataclass(frozen=True)
class InspectedPixel:
    """Everything about a pixel. `document` has the keys of `--json`, with None for NaN; `evidence` is for the diagram."""

    document: dict[str, Any]
    evidence: PixelEvidence


def inspect_pixel(
    frame: Path, pixel: tuple[int, int], /, *, place: int, settings: ResolveSettings, progress: Progress
) -> InspectedPixel:
    """Resolve a frame as `cadtof resolve` does, and return everything about one of its pixels, column x and row y from 0.

    `frame` is a frame, a stack of them, or a capture folder; `place` is the number, from 0, of the map among those that a run on
    it would write. Raises CadtofError if the frame cannot be read or resolved, or has no such pixel.
    """
    planned, sources, notes = _recorded(frame, place, settings)
    source = str(sources[0])
    try:
        recording = planned.reader.read(sources)
    except NotAFrameError as error:
        raise _with_recorded_frame(error, sources[0].paths[0]) from error
    for note in notes:
        progress.say(note)
    if recording.left_out:
        progress.say(recording.left_out)
    stored, plan = recording.frame, planned.plan
    stages = stages_of(stored, plan, plan.read_calibration())
    pixels = prepare_frame(stored, stages)
    height, width = pixels.size
    x, y = pixel
    expected = f"a column 0 … {width - 1} and a row 0 … {height - 1} of {source}"
    require(0 <= x < width and 0 <= y < height, "--pixel", f"{x},{y}", expected)
    maps = resolve_pixels(pixels, stages)
    evidence = pixel_evidence(pixels, y * width + x, stages)
    recorded = stored.stored if isinstance(stored, FrameMean) else stored
    voltage = plan.metadata.voltage
    volts = (recorded[:, :, y, x].astype(np.float64) - voltage.zero) * volts_per_count(voltage, pixels.dtype)
    status = int(maps.status[y, x])
    document = {
        "frame": source,
        "pixel": [x, y],
        "voltages_v": volts.tolist(),
        "phasors": [[float(p.real), float(p.imag)] for p in evidence.phasors],
        "noise": _noise(evidence, plan),
        "one_path": None if evidence.one is None else asdict(evidence.one[0]) | {"chi_squared": evidence.one[1]},
        "two_paths": dict(zip(("direct", "mpi"), map(asdict, evidence.two), strict=True)) if evidence.two else None,
        "order_test": _order_test(evidence.test, status),
        "diffuse": _diffuse(pixels.choice, evidence, status),
        "chosen": {name: float(maps.layer(name)[y, x]) for name in maps.names} | {STATUS: status},
        "status": list(describe_status(status)),
        "neighbours_m": _neighbours(maps, x, y),
    }
    return InspectedPixel(plain(document), evidence)


def _recorded(
    frame: Path, place: int, settings: ResolveSettings
) -> tuple[CapturePlan, tuple[FrameSource, ...], tuple[str, ...]]:
    """Return the plan that a run would have for a capture, the frames of one of its maps, and notes on what it assumes."""
    # one input, without the folders below it, is one capture
    captures = find_captures([frame], overrides=settings.overrides, settings_file=settings.settings_file)
    calibration = use_calibration(settings.calibration, captures) if settings.calibration else None
    (plan,) = plan_captures(captures, settings, calibration)
    maps = 0
    for sources in plan.groups():
        if maps == place:
            return plan, sources, (*plan.notes(), *(calibration.notes if calibration else ()))
        maps += 1
    written = f"a run on {frame} would write {counted(maps, 'map')}"
    raise SettingsError(f"--frame: found {place}, expected 0 … {maps - 1}: {written}")


def _with_recorded_frame(error: NotAFrameError, file: Path) -> NotAFrameError:
    """Return an error that names the recorded frame to inspect, if the record of the map's run tells it; else the error."""
    try:
        run = read_run(file)
        capture, recorded, _ = run.recorded_frames(NO_PROGRESS.say)[run.name(file)]
    except (CadtofError, LookupError):
        return error
    what = "the recorded frame" if len(recorded) == 1 else f"the first of the {len(recorded)} recorded frames"
    corner = f"; pixel 0,0 of the maps is {run.roi[0]},{run.roi[1]} there" if run.roi else ""
    return NotAFrameError(f"{error}; inspect {what}: {_as_argument(capture, recorded[0])}{corner}")


def _as_argument(capture: Capture, source: FrameSource) -> str:
    """Return a frame as it is named on the command line."""
    if len(source.paths) > 1:
        return f"{capture.root} --frame {capture.frames.index(source)}"
    return f"{source.paths[0]}" + ("" if source.index is None else f" --frame {source.index}")


def _noise(evidence: PixelEvidence, plan: FramePlan) -> dict[str, Any]:
    noise, volts = evidence.noise, plan.metadata.modulation.amplitude_v
    return {
        "integration_length": noise.integration_length,
        "estimated": noise.estimated,
        "averaged_pixels": 1.0 if noise.samples is None else float(noise.samples[0]),
        "sigma_v": [[volts * float(np.sqrt(one[i, i])) for i in (0, 1)] for one in evidence.covariance],
    }


def _order_test(test: OrderTest | None, status: int) -> dict[str, Any] | None:
    """Return the numbers of the order test, and its verdict in words."""
    if test is None:
        return None
    if status & StatusBit.DIFFUSE_MPI:
        verdict = "not tested: the MPI is a tail"
    elif not status & ANSWERED:
        verdict = "not tested: the pixel has no answer"
    elif test.chi_squared <= test.threshold:
        verdict = "one path explains the phasors within their noise"
    elif test.worth_another:
        verdict = "one path does not explain the phasors, and a second one reduces the error of the direct path"
    elif status & (StatusBit.TWO_PATHS | StatusBit.MORE_PATHS):
        # a solver leaves one path out if its χ² is certainly above the limit
        verdict = "one path is far from explaining the phasors: a second one is taken, whatever noise it adds"
    else:
        more = "a second one adds more error to the direct path than it removes"
        verdict = f"one path does not explain the phasors, but {more}"
    return asdict(test) | {"verdict": verdict}


def _diffuse(choice: DiffuseChoice | None, evidence: PixelEvidence, status: int) -> dict[str, Any] | None:
    """Return the model of the frame's MPI with its reasons, and the tail at the pixel: H₁, recorded over direct light."""
    if choice is None:
        return None
    tail, paths = None, evidence.resolved.paths
    if status & StatusBit.DIFFUSE_MPI:
        lag = float(np.angle(evidence.phasors[0] * np.exp(-1j * paths.phase_rad[0, 0])))
        tail = {
            "amplitude_ratio": float(np.abs(evidence.phasors[0]) / paths.amplitude[0, 0]),
            "lag_rad": lag,
            "pulled_back_m": lag * evidence.metres_per_radian,
            "chi_squared": float(evidence.resolved.chi_squared[0]),
        }
    return {"model": choice.taken, **asdict(choice), "in_separate_patch": evidence.in_separate_patch, "tail": tail}


def _neighbours(maps: DepthMaps, x: int, y: int) -> list[list[float]]:
    """Return the direct depths around the pixel, rows from the top; NaN: no answer, or beyond the edge of the frame."""
    around = np.pad(maps.layer(DIRECT_DEPTH), NEIGHBOURS, constant_values=np.nan)
    side = 2 * NEIGHBOURS + 1
    values: list[list[float]] = around[y : y + side, x : x + side].tolist()
    return values
