"""The depths of the first phasor alone of the recorded frames of a run, for comparison with its maps.

A pixel that has no answer in the maps has no answer here either.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.frames import Capture
from cadtof_cli.errors import CadtofError
from cadtof_cli.files.reading import real_path
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.pipeline.first_phasor import first_phasor_depth
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.workflows.inspect.run_map import RunMap
from cadtof_cli.workflows.recording import FrameReader
from cadtof_cli.workflows.resolve.run_json import NOT_OF_A_RUN
from cadtof_cli.workflows.run_folder import NOT_EVALUATED, RecordedFrames, Run


@dataclass(frozen=True)
class FirstPhasors:
    """The recorded frames of a run, with the plans by which `cadtof resolve` read them, by the folders of their captures.

    `say` is called with notes for the user.
    """

    run: Run
    recorded: RecordedFrames
    plans: Mapping[Path, FramePlan]
    say: Callable[[str], None]

    def depth(self, one: RunMap, /) -> Float | None:
        """Return the first phasor's depth of a map's frame, float64 (Y, X) in m; NaN where the direct depth of the map is NaN.

        None if no frame is known. None, with a note, if this frame is not known, cannot be read any more, or has changed.
        Raises CaptureError if the map has no direct depth.
        """
        direct, file, name = one.layer(DIRECT_DEPTH), one.file, self.run.name(one.file)
        if name not in self.recorded:
            if self.recorded:
                self.say(f"{file}: run.json names no recorded frame of it, {NOT_EVALUATED}")
            return None
        capture, sources, digest = self.recorded[name]
        plan = self.plans[capture.root]
        try:
            recording = FrameReader(capture.layout, plan.metadata).read(sources)
            if digest not in {None, recording.digest}:
                self.say(f"{file}: its recorded frame has changed since the run, {NOT_EVALUATED}")
                return None
            depth = self.run.cropped(
                first_phasor_depth(recording.frame, plan=plan, calibration=plan.read_calibration())
            )
        except CadtofError as error:
            self.say(f"{file}: its recorded frame cannot be read any more, {NOT_EVALUATED}: {error}")
            return None
        if depth.shape != direct.shape:
            self.say(f"{file}: its recorded frame has another size now, {NOT_EVALUATED}")
            return None
        return np.where(np.isfinite(direct), depth, np.nan)


def first_phasors(run: Run, say: Callable[[str], None], /) -> FirstPhasors:
    """Return the first phasors of a run's frames. If frames or calibration are unknown or gone, say so and return none."""
    recorded, none = run.recorded_frames(say), FirstPhasors(run, {}, {}, say)
    if run.record is None or not recorded:
        return none
    try:
        settings, calibration = run.record.map_settings(), run.record.calibration(run.folder)
        known, by_root = run.record["captures"], dict[Any, list[Mapping[str, Any]]]()
        for one in known:
            by_root.setdefault(one.get("resolved_root"), []).append(one)
        plans = dict[Path, FramePlan]()
        for root, capture in {one.root: one for one, *_ in recorded.values()}.items():
            # captures that were moved together with the run are compared with all captures of the run
            if changed := _changed_setting(capture, by_root.get(real_path(root), known)):
                say(f"{root}: {changed} since the run, {NOT_EVALUATED}")
                return none
            plans[root] = FramePlan(metadata=capture.source.metadata, settings=settings, calibration=calibration)
    except (CadtofError, *NOT_OF_A_RUN) as error:
        say(f"the settings of the run cannot be taken from its record, {NOT_EVALUATED}: {error}")
        return none
    try:
        next(iter(plans.values())).read_calibration()
    except CadtofError as error:
        say(f"the calibration of the run has changed or is gone, {NOT_EVALUATED}: {error}")
        return none
    return FirstPhasors(run, recorded, plans, say)


def _changed_setting(capture: Capture, known: Sequence[Mapping[str, Any]], /) -> str | None:
    """Return in words which setting of a capture is another one than in the `known` captures of a run; None: one has them all."""
    now, found = json.loads(json.dumps(asdict(capture.source.metadata), default=str)), None
    for one in known:
        changes = (
            f"{table}.{key} has changed from {value!r} to {now[table][key]!r}"
            for table, keys in one["metadata"].items()
            for key, value in keys.items()
            if key in now.get(table, ()) and now[table][key] != value
        )
        change = next(changes, None)
        if change is None:
            return None
        found = found or change
    return found
