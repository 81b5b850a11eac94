"""The registry of status bits: the code, the decoder and the documentation all use this one list."""

from enum import IntFlag

import numpy as np

from cadtof_cli.arrays import Bool, Status
from cadtof_cli.records import dataclass


class StatusBit(IntFlag):
    """How a pixel was resolved, or why it has no answer.

    A pixel without `ONE_PATH`, `TWO_PATHS`, `MORE_PATHS` and `DIFFUSE_MPI` has no answer: NaN in every depth layer.
    """

    SATURATED = 1
    NOT_FINITE = 2
    LOW_CONFIDENCE = 4
    ONE_PATH = 8
    TWO_PATHS = 16
    ILL_CONDITIONED = 32
    CALIBRATED = 64
    NOT_CONVERGED = 128
    HOT_PIXEL = 256
    MORE_PATHS = 512
    POOLED = 1024
    DIFFUSE_MPI = 2048
    IMPOSSIBLE = 4096


MEANING: dict[StatusBit, str] = {
    StatusBit.SATURATED: "a stored value lies at or beyond `saturated_counts`; no answer",
    StatusBit.NOT_FINITE: "a stored value is NaN or infinite; no answer",
    StatusBit.LOW_CONFIDENCE: "no signal above the noise, or confidence below `--min-confidence`; no answer",
    StatusBit.ONE_PATH: "resolved as one path; MPI layers are NaN",
    StatusBit.TWO_PATHS: "resolved as two paths",
    StatusBit.ILL_CONDITIONED: "doubtful, and sigma is a lower bound: a predicted standard deviation exceeds a quarter of the "
    "paths' separation, or the amplitude of a single path falls with frequency as that of two close paths does (one pixel in "
    "ten without MPI)",
    StatusBit.CALIBRATED: "a calibration was applied",
    StatusBit.NOT_CONVERGED: "a search ran out of steps (no answer), or left the equations of a calibrated response open "
    "(best attempt)",
    StatusBit.HOT_PIXEL: "the dark calibration found the pixel hot, noisy or dead; no answer",
    StatusBit.MORE_PATHS: "resolved as three paths or more",
    StatusBit.POOLED: "averaged over frames or neighbours: layer `effective_pixels` says over how many",
    StatusBit.DIFFUSE_MPI: "the MPI is a tail predicted from the scene's geometry; MPI layers are its phasor at the fundamental",
    StatusBit.IMPOSSIBLE: "the amplitudes exceed what the modulation can record by more than noise, or all pixels of the "
    "frame hold the same values; no answer",
}


def has_answer(status: Status, /) -> Bool:
    """Return which pixels of a status map have an answer."""
    bits = StatusBit.ONE_PATH | StatusBit.TWO_PATHS | StatusBit.MORE_PATHS | StatusBit.DIFFUSE_MPI
    answered: Bool = (status & np.uint32(bits)) != 0
    return answered


@dataclass(frozen=True)
class StatusCounts:
    """Numbers of pixels of a frame with one path, two paths, more paths, diffuse MPI, and without an answer."""

    one_path: int
    two_paths: int
    more_paths: int
    diffuse: int
    invalid: int


def why_no_answer(status: Status, /) -> str:
    """Return why no pixel of a status map has an answer: the bits that are set, with their shares of the pixels."""
    bits = (
        StatusBit.SATURATED,
        StatusBit.NOT_FINITE,
        StatusBit.HOT_PIXEL,
        StatusBit.LOW_CONFIDENCE,
        StatusBit.NOT_CONVERGED,
        StatusBit.IMPOSSIBLE,
    )
    shares = {bit: float(np.mean((status & bit) != 0)) for bit in bits}
    found = [f"{share:.1%} {bit_words(bit)}" for bit, share in shares.items() if share]
    weak = "; if there was light, check integration_length, amplitude_v, --min-confidence and --false-alarm"
    impossible = (
        "; impossible means: amplitudes above what the modulation can record, or the same values in all pixels; check "
        "amplitude_v, volts_per_count and fwhm_ns"
    )
    hints = (weak if shares[StatusBit.LOW_CONFIDENCE] else "") + (impossible if shares[StatusBit.IMPOSSIBLE] else "")
    return f"no pixel has an answer ({', '.join(found)}){hints}"


def bit_words(bit: StatusBit, /) -> str:
    """Return the name of a bit in words, such as 'diffuse MPI'."""
    words = str(bit.name).lower().replace("_", " ")
    return words.replace("mpi", "MPI").replace("ill ", "ill-")


def describe_status(value: int) -> tuple[str, ...]:
    """Return the names of the bits that are set, such as ('two paths', 'ill-conditioned')."""
    return tuple(bit_words(bit) for bit in StatusBit if value & bit)
