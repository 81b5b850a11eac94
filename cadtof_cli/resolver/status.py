"""The registry of status bits: the code, the decoder and the documentation all use this one list."""

from enum import CONFORM, IntFlag
from typing import Self

import numpy as np

from cadtof_cli.arrays import Bool, Status
from cadtof_cli.records import dataclass


class Bit(IntFlag, boundary=CONFORM):
    """A bit of a pixel, with its meaning in words.

    With the usual boundary, ~bit of Python 3.11.2 lacks all higher bits.
    """

    meaning: str

    def __new__(cls, value: int, meaning: str) -> Self:
        """Make the bit of this value, with its meaning in words."""
        bit = int.__new__(cls, value)
        bit._value_, bit.meaning = value, meaning
        return bit


class StatusBit(Bit):
    """How a pixel was resolved, or why it has no answer.

    A pixel without a bit of `ANSWERED` has no answer: NaN in every depth layer.
    """

    SATURATED = 1, "a stored value lies at or beyond `saturated_counts`; no answer"
    NOT_FINITE = 2, "a stored value is NaN or infinite; no answer"
    LOW_CONFIDENCE = 4, "no signal above the noise, or confidence below `--min-confidence`; no answer"
    ONE_PATH = 8, "resolved as one path; MPI layers are NaN"
    TWO_PATHS = 16, "resolved as two paths"
    ILL_CONDITIONED = (
        32,
        "doubtful, and sigma is a lower bound: a predicted standard deviation exceeds a quarter of the paths' separation, or "
        "the amplitude of a single path falls with frequency as that of two close paths does (one pixel in ten without MPI)",
    )
    CALIBRATED = 64, "a calibration was applied"
    NOT_CONVERGED = (
        128,
        "a search ran out of steps (no answer), or left the equations of a calibrated response open (best attempt)",
    )
    HOT_PIXEL = 256, "the dark calibration found the pixel hot, noisy or dead; no answer"
    MORE_PATHS = 512, "resolved as three paths or more"
    POOLED = 1024, "averaged over frames or neighbours: layer `effective_pixels` says over how many"
    DIFFUSE_MPI = (
        2048,
        "the MPI is a tail predicted from the scene's geometry; MPI layers are its phasor at the fundamental",
    )
    IMPOSSIBLE = (
        4096,
        "the amplitudes exceed what the modulation can record by more than noise, or all pixels of the frame hold the same "
        "values; no answer",
    )


ANSWERED = StatusBit.ONE_PATH | StatusBit.TWO_PATHS | StatusBit.MORE_PATHS | StatusBit.DIFFUSE_MPI
"""The bits of pixels with an answer; a pixel has one of them at most."""


def has_answer(status: Status, /) -> Bool:
    """Return which pixels of a status map have an answer."""
    return np.asarray((status & np.uint32(ANSWERED)) != 0)


@dataclass(frozen=True)
class StatusCounts:
    """Numbers of pixels of a frame with one path, two paths, more paths, diffuse MPI, and without an answer."""

    one_path: int
    two_paths: int
    more_paths: int
    diffuse: int
    invalid: int


def why_no_answer(status: Status, /, *, noise_estimated: bool = False) -> str:
    """Return why no pixel of a status map has an answer: the bits that are set, with their shares of the pixels.

    `noise_estimated`: whether the noise was estimated from the frame.
    """
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
    if noise_estimated:
        weak = (
            "; the noise was estimated from the frame, and a scene of fine mesh looks like noise: if there was light, give "
            "--integration-length"
        )
    impossible = (
        "; impossible means: amplitudes above what the modulation can record, or the same values in all pixels; check "
        "amplitude_v, volts_per_count and fwhm_ns; if the view moves fast, try --order 1"
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
