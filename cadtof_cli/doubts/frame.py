"""All that is likely wrong with a frame, in words: as it was recorded, before a run, and in a run."""

import numpy as np

from cadtof_cli.arrays import Bool, Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.doubts.camera import cut_off, other_offsets, stepped, striped, stuck_bit, unequal_harmonics
from cadtof_cli.doubts.other_noise import other_noise
from cadtof_cli.doubts.pixels import FEWEST, LOOKED_AT
from cadtof_cli.doubts.planes import mistaken_order, share_of_one_path, sheared, wrong_planes
from cadtof_cli.doubts.shared_light import shared_in_words, wrong_zero_in_words
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA, MISFIT
from cadtof_cli.phasors.voltages import ideal_phasor_map, spread_over
from cadtof_cli.pipeline.frame import stages_of
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.status import StatusCounts
from cadtof_cli.units import unambiguous_range_m

_FITTING, _QUICK_LOOK = 0.8, 512
"""Planes and their order are not doubted if more than this share of so many pixels looks like one path. With wrong planes it is
.69 at most in five scenes."""

_FEW_OF_ONE_PATH = 0.125
"""Planes of a frame are looked at if no more of its answers than this share are one path: wrong planes leave hardly any."""

_UNEXPLAINED = 8.0
"""How far the median χ² of a frame may exceed the number of values that two paths leave over. Where paths explain the light,
it is about this number."""

_AT_THE_END, _KNOWN = 0.02, 0.01
"""Neighbours lie on both sides of the end of the range if they are nearer to it than the first share of the range, and if both
have a sigma below the second: pixels without light have a larger one."""


def doubts(
    stored: Stored, metadata: CaptureMetadata, /, *, has_light: bool = True, of_order: bool = True
) -> tuple[str, ...]:
    """Return in words all that is likely wrong with a frame, (H, 2, Y, X), as it was recorded.

    Args:
        stored: the frame's stored values.
        metadata: of the capture.
        has_light: whether the frame shows a scene. If not, only values that are cut off are looked for.
        of_order: whether to look for planes in another order, and for a wrong zero. This is never done if some planes hold
            noise alone, or show the same.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    if not has_light:
        return _told(cut_off(stored, metadata))
    planes, stuck = wrong_planes(stored, metadata), stuck_bit(stored, metadata)
    mistaken = _zero_or_order(stored, metadata) if of_order and not planes and not stuck else None
    return _told(sheared(stored, metadata), planes, stuck, mistaken, cut_off(stored, metadata))


def camera_doubts(stored: Stored, metadata: CaptureMetadata, /) -> tuple[str, ...]:
    """Return in words which errors of the camera a frame, (H, 2, Y, X), shows that is not calibrated.

    Nothing of this shows in a pixel alone. NaN and saturated pixels are left out.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        stripes = _told(*(striped(stored, metadata, lines) for lines in ("rows", "columns")))
        return _told(
            other_noise(stored, metadata),
            *stripes,
            # each row or column with an offset of its own makes a step in the middle, too
            None if stripes else stepped(stored, metadata),
            unequal_harmonics(stored, metadata),
            shared_in_words(stored, metadata, ideal_phasor_map(metadata, stored.dtype)),
        )


def doubts_before_run(stored: Stored, plan: FramePlan, /) -> tuple[str, ...]:
    """Return in words all that is likely wrong with a frame, (H, 2, Y, X), that stands for its capture, before a run by the plan.

    Raises:
        SettingsError: see `volts_per_count`.
        MetadataError: see `FramePlan.read_calibration`.
    """
    metadata, use = plan.metadata, plan.calibration
    # a calibration shows that the planes are in order
    found = doubts(stored, metadata, of_order=use is None)
    # what `read_frames` reads, for one path, may be calibrated later
    if found or plan.resolver.max_paths < 2:
        return found
    if use is None:
        return camera_doubts(stored, metadata)
    calibration = plan.read_calibration()
    dark = calibration.dark if calibration else None
    if dark and stored.shape == dark.offset_v.shape:
        found = _told(other_offsets(stored, metadata, dark.sound_offset_v, dark.offset_stderr_v()))
    if found or not use.sine:
        return found
    correction, n_av = stages_of(stored, plan, calibration).correction, metadata.pixel.mean_length
    # sigma holds the noise of the calibration, too; where this is larger than that of the frame, it is all that neighbours show
    own = correction.noise
    is_frames = own is None or n_av is None or max(own.dark) + max(own.response) < 0.5 / n_av
    noise = other_noise(stored, metadata, correction.phasor_map) if is_frames else None
    return _told(noise, shared_in_words(stored, metadata, correction.phasor_map))


def frame_doubts(stored: Stored | None, maps: DepthMaps, counts: StatusCounts, plan: FramePlan, /) -> tuple[str, ...]:
    """Return in words what is likely wrong with a frame of a run, or with its maps. Most frames take microseconds.

    `stored` holds the frame's stored values, (H, 2, Y, X); None for a mean of frames, whose values are not looked at.
    """
    answers = counts.one_path + counts.two_paths + counts.more_paths + counts.diffuse
    stuck = None if stored is None else stuck_bit(stored, plan.metadata)
    planes, several = None, plan.resolver.order == "auto" and counts.one_path <= _FEW_OF_ONE_PATH * answers
    if stored is not None and several and not stuck:
        planes = doubt_of_planes(stored, plan)
    return _told(_wrapped_in_words(maps, plan), _misfit_in_words(maps, plan), stuck, planes)


def doubt_of_planes(stored: Stored, plan: FramePlan, /) -> str | None:
    """Return what `doubts` says of the planes of a frame, (H, 2, Y, X), and their order, found quickly from fewer pixels."""
    metadata, of_order = plan.metadata, plan.calibration is None
    if of_order and share_of_one_path(spread_over(stored, _QUICK_LOOK), metadata) > _FITTING:
        return None
    planes = wrong_planes(stored, metadata, count=_QUICK_LOOK) and wrong_planes(stored, metadata)
    return planes or (_zero_or_order(stored, metadata, count=_QUICK_LOOK) if of_order else None)


def _told(*doubts: str | None) -> tuple[str, ...]:
    return tuple(doubt for doubt in doubts if doubt)


def _zero_or_order(stored: Stored, metadata: CaptureMetadata, *, count: int = LOOKED_AT) -> str | None:
    # a wrong zero turns phases, and another order may then fit better by chance
    several = share_of_one_path(spread_over(stored, _QUICK_LOOK), metadata) <= _FITTING
    zero = wrong_zero_in_words(stored, metadata, ideal_phasor_map(metadata, stored.dtype)) if several else None
    return zero or mistaken_order(stored, metadata, count=count)


def _misfit_in_words(maps: DepthMaps, plan: FramePlan) -> str | None:
    """Return in words that the paths of a frame do not explain its light; None: they do, or one path was asked for."""
    if MISFIT not in maps.names or plan.resolver.max_paths < 2:
        return None
    layer, most = maps.layer(MISFIT), _UNEXPLAINED + 2 * (len(plan.metadata.modulation.harmonics) - 2)
    misfit = layer[np.isfinite(layer)]
    # counted, not sorted: a median takes longer than many a frame
    if misfit.size < FEWEST or 2 * np.count_nonzero(misfit > most) <= misfit.size:
        return None
    return (
        f"its paths do not explain the light (median chi_squared above {most:.0f}), so errors are larger than sigma: was there "
        "motion or diffuse MPI, or is the camera not calibrated?"
    )


def _wrapped_in_words(maps: DepthMaps, plan: FramePlan) -> str | None:
    """Return in words that surfaces go on beyond the range, as many neighbours at 0 and at its end show; else None."""
    end = unambiguous_range_m(plan.metadata.modulation.periods_ns[0])
    depth, sigma = maps.layer(DIRECT_DEPTH), maps.layer(DIRECT_SIGMA)
    near = depth < _AT_THE_END * end
    # nearly all frames end here: no view shows much that is so near
    if np.count_nonzero(near) < FEWEST:
        return None
    known = sigma < _KNOWN * end
    near, far = near & known, (depth > (1.0 - _AT_THE_END) * end) & known
    if sum(_beside(*pair) for pair in ((near, far), (far, near), (near.T, far.T), (far.T, near.T))) < FEWEST:
        return None
    return (
        f"depths go on at 0 where surfaces are {end:.3g} m away, the range of periods_ns: what is farther comes out "
        f"{end:.3g} m too near"
    )


def _beside(left: Bool, right: Bool) -> int:
    """Return how many pixels of one mask, (Y, X), lie to the left of one of the other."""
    return int(np.count_nonzero(left[:, :-1] & right[:, 1:]))
