"""`cadtof compare`: what differs between two runs, or between a run and truth, layer by layer and bit by bit."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from cadtof_cli.errors import CaptureError
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import STATUS
from cadtof_cli.maps.comparison import BitChange, LayerDifference, MagnitudeTally, changed_bits, difference
from cadtof_cli.maps.layers import DIRECT_DEPTH, MPI_DEPTH
from cadtof_cli.optics import planar_per_range
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS
from cadtof_cli.resolver.status import bit_words
from cadtof_cli.workflows.inspect.run_map import (
    GivenOptics,
    Layers,
    in_kind,
    require_same_depth,
    require_same_part,
    require_same_size,
)
from cadtof_cli.workflows.inspect.truth import without_holes
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import read_run

WORST = 5
"""How many frames are named: those that differ most."""


@dataclass(frozen=True)
class FrameDifference:
    """How much a frame differs: |A − B| of its leading layer, and pixels with another status; None: A or B has none."""

    frame: str
    p90_abs: float | None
    max_abs: float | None
    status_changed: int | None


@dataclass
class AnswerChange:
    """How many pixels have a value in A only, and in B only."""

    only_a: int = 0
    only_b: int = 0


@dataclass
class Comparison:
    """The differences between two sets of maps, A and B. The fields are the keys of `--json`.

    Attributes:
        frames: number of frames that were compared.
        layers: differences of each layer that both have, by the name of the layer and in its unit.
        status_changed: number of pixels in which any status bit differs; None if A or B has no status.
        status_bits: changes of each status bit that differs anywhere, by the bit in words.
        answers: for each layer in which some pixels have a value in A or B only, how many.
        only_a, only_b: frames and layers that are in A only, and in B only.
        worst: the frames that differ most in `worst_by`; the frame that differs most is the first.
        worst_by: layer that ranks the frames, by the 90 % quantile of its |A − B|.
    """

    frames: int = 0
    layers: dict[str, LayerDifference] = field(default_factory=dict)
    status_changed: int | None = None
    status_bits: dict[str, BitChange] = field(default_factory=dict)
    answers: dict[str, AnswerChange] = field(default_factory=dict)
    only_a: dict[str, list[str]] = field(default_factory=dict)
    only_b: dict[str, list[str]] = field(default_factory=dict)
    worst: list[FrameDifference] = field(default_factory=list)
    worst_by: str | None = None


@dataclass(frozen=True)
class FramePair:
    """The layers of a frame in A and in B, of the same size."""

    name: str
    first: Layers
    second: Layers

    @property
    def shared(self) -> tuple[str, ...]:
        """The layers, besides the status, that both have."""
        return tuple(name for name in self.first if name in self.second and name != STATUS)


class MapPairs:
    """The frames that A and B, folders or files of maps, share by name. A lone file, such as truth, goes with every frame.

    If A and B hold different kinds of depth, the depths of B become those of A.

    Raises:
        CaptureError: A or B has no maps, or they share no frame.
        SettingsError: they show different parts of the frames.
    """

    def __init__(self, first: Path, second: Path, /) -> None:
        self.a, self.b = read_run(first), read_run(second)
        # a lone file is one of the last two with every frame
        self._read = lru_cache(maxsize=2)(_values)
        if self.a.roi and self.b.roi:
            require_same_part(self.a, self.b)
        one, other = ({run.name(file): file for file in run.require_maps()} for run in (self.a, self.b))
        if one.keys().isdisjoint(other):
            if second.is_file():
                other = dict.fromkeys(one, second)
            elif first.is_file():
                one = dict.fromkeys(other, first)
            else:
                # the folder of one capture in a run of several: its name is not in the names of another run's maps
                one = {file.relative_to(first).with_suffix("").as_posix(): file for file in one.values()}
                other = {file.relative_to(second).with_suffix("").as_posix(): file for file in other.values()}
        self.files = {name: (one[name], other[name]) for name in one if name in other}
        self.only: tuple[list[str], list[str]] = ([], [])
        if not first.is_file() and not second.is_file():
            self.only = ([name for name in one if name not in other], [name for name in other if name not in one])
        if not self.files:
            found = ", ".join(list(one)[:3]), ", ".join(list(other)[:3])
            raise CaptureError(f"{first} and {second} share no frame: found {found[0]} … and {found[1]} …")

    def pair(self, name: str, /) -> FramePair:
        """Return a frame's layers in A and in B.

        Raises:
            CadtofError: they cannot be read, differ in size, or hold different kinds of depth and the optics are unknown.
        """
        files = self.files[name]
        whole = self._read(files[0]), self._in_kind_of_a(files, self._read(files[1]))
        first, second = (
            {key: self.b.cropped(self.a.cropped(plane)) for key, plane in layers.items()} for layers in whole
        )
        one, other = (next(iter(layers.values())) for layers in (first, second))
        require_same_size(other, one.shape, files[1], files[0])
        return FramePair(name, first, second)

    def _in_kind_of_a(self, files: tuple[Path, Path], layers: Layers) -> Layers:
        """Return the layers of the second file, its depths of the kind that A holds."""
        if self.a.depth_kind == self.b.depth_kind:
            return layers
        height, width = next(iter(layers.values())).shape
        optics = GivenOptics().optics(self.b, files[1])
        if optics.focal_length_px is None:
            # truth has no record: of whole frames, its pixels count as those of A's recorded frames do
            roi = self.a.roi
            whole = roi is not None and (height, width) != (roi[3] - roi[1], roi[2] - roi[0])
            optics = self.a.optics(files[0]) if whole else GivenOptics().optics(self.a, files[0])
        if optics.focal_length_px is None:
            require_same_depth(self.a, self.b)
        return in_kind(layers, self.a.depth_kind, planar_per_range(optics, (height, width)))


def _values(file: Path) -> Layers:
    """Return the layers of a file. Without a status it is no map of a run but truth, whose depths of 0 and less are no values."""
    layers = read_layers(file)
    if STATUS in layers:
        return layers
    return {name: without_holes(plane) if name.endswith(".depth") else plane for name, plane in layers.items()}


def compare_maps(pairs: MapPairs, /, *, progress: Progress) -> Comparison:
    """Return the differences between the frames that two runs, or a run and truth, share.

    Raises:
        CadtofError: maps cannot be read, differ in size, or have no layer in common.
    """
    found, tallies = Comparison(), dict[str, MagnitudeTally]()
    frames, only_a, only_b = list[FrameDifference](), set[str](), set[str]()
    for run in {run.maps: run for run in (pairs.a, pairs.b)}.values():
        run.tell_if_unfinished(progress.say)
    if pairs.a.depth_kind != pairs.b.depth_kind:
        kinds = (DEPTH_IN_WORDS[run.depth_kind] for run in (pairs.b, pairs.a))
        progress.say("{} holds {}: converted into {}, as {} holds".format(pairs.b.maps, *kinds, pairs.a.maps))
    progress.advance(0, total=len(pairs.files))
    for pair in map(pairs.pair, pairs.files):
        found.frames += 1
        leading, of_frame = _leading(pair.shared), MagnitudeTally()
        for layer in pair.shared:
            one, other = pair.first[layer], pair.second[layer]
            change = difference(one, other)
            tallies.setdefault(layer, MagnitudeTally()).add(change)
            if layer == leading:
                of_frame.add(change)
            in_a, in_b = np.isfinite(one), np.isfinite(other)
            if (in_a != in_b).any():
                answers = found.answers.setdefault(layer, AnswerChange())
                answers.only_a += int(np.count_nonzero(in_a & ~in_b))
                answers.only_b += int(np.count_nonzero(in_b & ~in_a))
        only_a |= pair.first.keys() - pair.second
        only_b |= pair.second.keys() - pair.first
        worst = of_frame.summary()
        frames.append(FrameDifference(pair.name, worst.p90_abs, worst.max_abs, _count_bits(found, pair)))
        progress.advance()
    found.layers = {name: tally.summary() for name, tally in tallies.items()}
    found.only_a = {"layers": sorted(only_a), "frames": pairs.only[0]}
    found.only_b = {"layers": sorted(only_b), "frames": pairs.only[1]}
    if not found.layers and found.status_changed is None:
        raise CaptureError(
            f"{pairs.a.maps} and {pairs.b.maps} have no layer in common: found {', '.join(sorted(only_a))} in A and "
            f"{', '.join(sorted(only_b))} in B; give two runs, or a run and its truth"
        )
    found.worst_by = _leading(tuple(found.layers))
    frames.sort(key=lambda one: (one.p90_abs or 0.0, one.max_abs or 0.0, one.status_changed or 0), reverse=True)
    found.worst = frames[:WORST]
    return found


def _count_bits(found: Comparison, pair: FramePair) -> int | None:
    """Count the pixels that gain and lose each status bit; return how many differ in any bit, None if A or B has no status."""
    bits, others = pair.first.get(STATUS), pair.second.get(STATUS)
    if bits is None or others is None:
        return None
    for bit, here in changed_bits(bits, others).items():
        if here.gained or here.lost:
            change = found.status_bits.setdefault(bit_words(bit), BitChange(0, 0))
            change.gained += here.gained
            change.lost += here.lost
    changed = int(np.count_nonzero(bits != others))
    found.status_changed = (found.status_changed or 0) + changed
    return changed


def _leading(layers: tuple[str, ...]) -> str | None:
    return DIRECT_DEPTH if DIRECT_DEPTH in layers else next(iter(layers), None)


def draw_worst(pairs: MapPairs, found: Comparison, out: Path, /) -> None:
    """Draw the frame that differs most: A and B on one scale, their difference, and the paths of each pixel."""
    from cadtof_cli.figures.layers import Shown
    from cadtof_cli.figures.maps import draw_comparison

    pair = pairs.pair(found.worst[0].frame)
    named = [name for name in (DIRECT_DEPTH, MPI_DEPTH) if name in pair.shared] or list(pair.shared[:2])
    title = f"{pair.name}: A = {pairs.a.maps}, B = {pairs.b.maps}"
    # `MapPairs` makes the depths of B those of A
    depth = DEPTH_IN_WORDS[pairs.a.depth_kind]
    one, other = (Shown.of(letter, layers, depth=depth) for letter, layers in (("A", pair.first), ("B", pair.second)))
    draw_comparison(one, other, named, out, title=title)
