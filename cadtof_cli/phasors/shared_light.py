"""Light or an offset that all pixels of a frame share: fog, a dirty window, light that the lens scatters, offsets that drifted.

A surface gives the phasors a·exp(ihx). Light that the lens scatters over the picture adds the same q_h to every pixel, and so
does an offset of all pixels. In a pixel alone, this looks like a second path. Where depths differ, the phasors of many pixels
tell q_h: least squares over all pixels find it.
"""

import numpy as np

from cadtof_cli.arrays import Complex, Float, Stored, even_step, median
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.plausible import FEWEST
from cadtof_cli.phasors.voltages import PhasorMap, phasors_from_stored, sound_pixels

_LOOKED_AT = 512
"""Pixels that are looked at, at least."""

_BRIGHT, _LONGEST = 0.3, 4.0
"""Pixels that are darker than this share of the median say too little, and those with a longer phasor hold no light."""

_STEPS, _HOPELESS = 12, 4
"""Steps, and from which of them on the frame must tell something. The misfit must then be as many times smaller as there were
steps."""

_EXPLAINED = 10.0
"""How many times smaller the median squared misfit of one path becomes if what all pixels share is taken out."""

_TOLD, _FLAT = 40.0, 200.0
"""Largest condition of the least squares at which the frame tells anything, and that from which it is hopeless. Views of several
depths have 20 at most, flat walls and corners 500 and more."""

_MATTERS, _MOST = 0.01, 1.0
"""Least share of the light that is doubted: it moves depths by a centimetre. More than the light of the surfaces is also found in
sound views of one depth, such as `simulate --scene card` with three periods."""

_TAIL_RAD = 2.5
"""What comes up to this phase after the surfaces is not doubted: in small rooms, most MPI is the same in all pixels. In 15 of 90
rooms it is, by `_EXPLAINED`, and comes .6 to 2.2 rad late. `resolve` predicts it."""


def shared_light_in_words(stored: Stored, metadata: CaptureMetadata, phasor_map: PhasorMap, /) -> str | None:
    """Return a message if all pixels of a frame, (H, 2, Y, X), share light or an offset; else None.

    `phasor_map` makes phasors of the stored values. NaN and saturated pixels are left out. Triangle waves tell nothing.
    """
    if metadata.modulation.waveform != "sine":
        # the further terms of a triangle differ from pixel to pixel
        return None
    planes = stored.reshape(*stored.shape[:2], -1)
    every = slice(None, None, even_step(planes.shape[2], stored.shape[3], count=_LOOKED_AT))
    some = planes[:, :, every]
    phasors = phasors_from_stored(some, phasor_map[every])
    phasors = phasors[:, sound_pixels(some, metadata.voltage.saturated_counts)]
    share = shared_light(phasors, metadata.modulation.harmonics)
    if share is None:
        return None
    parts = ", ".join(
        f"{abs(part):.2g} at H{h}" for h, part in zip(metadata.modulation.harmonics, share.tolist(), strict=True)
    )
    return (
        f"all pixels share light or an offset ({parts}; the light of the surfaces is 1): depths may be wrong by far more than "
        "sigma says. Fog, a dirty window or pane, or light that the lens scatters: --return strongest takes what is behind. "
        "Offsets that drifted, or a wrong zero_counts: run calibrate dark"
    )


@np.errstate(over="ignore", invalid="ignore")
def shared_light(phasors: Complex, harmonics: tuple[int, ...], /) -> Complex | None:
    """Return what all pixels share at each harmonic, complex (H,), over the median |p_1| of the rest; None: nothing is found.

    Args:
        phasors: complex (H, n). NaN and dark pixels are left out.
        harmonics: the numbers of the harmonics.
    """
    phasors = phasors[:, (np.abs(phasors) < _LONGEST).all(axis=0)]
    length = np.abs(phasors[0])
    if len(harmonics) < 2 or length.size < FEWEST:
        return None
    phasors = phasors[:, length > _BRIGHT * median(length)]
    if phasors.shape[1] < FEWEST:
        return None
    h = np.array(harmonics, np.float64)[:, np.newaxis]
    shared = np.zeros((len(h), 1), np.complex128)
    misfits, condition = list[float](), np.inf
    for _ in range(_STEPS):
        turned, back = _turned_by_phase(phasors - shared, h)
        change, misfit, condition = _least_squares(turned, back, h)
        misfits.append(misfit)
        if len(misfits) >= _HOPELESS and (condition > _FLAT or misfits[0] < min(len(misfits), _EXPLAINED) * misfit):
            return None
        shared = shared + change
    surfaces = (phasors - shared)[0]
    share = shared[:, 0] / median(np.abs(surfaces))
    if not (misfits[0] > _EXPLAINED * misfits[-1] and condition < _TOLD and _MATTERS < np.abs(share).max() < _MOST):
        return None
    late = float(np.angle(share[0] * np.conj(np.sum(surfaces / np.abs(surfaces)))))
    return None if 0.0 < late < _TAIL_RAD else share


def _turned_by_phase(phasors: Complex, h: Float) -> tuple[Complex, Complex]:
    """Return phasors, (H, n), turned back by the phase x of the one path that fits each pixel, and exp(−ihx)."""
    phase = np.angle(phasors[0])
    for _ in range(2):
        turned = phasors * np.exp(-1j * h * phase)
        slope, bend = (h * turned.imag).sum(axis=0), (h * h * turned.real).sum(axis=0)
        phase = phase + np.clip(
            np.where(bend > 0.0, slope / np.where(bend > 0.0, bend, 1.0), np.sign(slope)), -0.3, 0.3
        )
    back = np.exp(-1j * h * phase)
    return phasors * back, back


def _least_squares(turned: Complex, back: Complex, h: Float) -> tuple[Complex, float, float]:
    """Return the change of what all pixels share, (H, 1), the median squared misfit before it, and the condition.

    Amplitude and phase of the path take up the mean of the real parts and what is in proportion to h of the imaginary parts.
    The rest is the misfit. Pixels with a large one, such as those with MPI, count less.
    """
    count = len(h)
    kept = np.eye(count) - 1.0 / count, np.eye(count) - h * h.T / (h * h).sum()
    rest = kept[0] @ turned.real, kept[1] @ turned.imag
    squares = rest[0] ** 2 + rest[1] ** 2
    squares = squares.sum(axis=0)
    misfit = float(median(squares))
    weight = 1.0 / (1.0 + squares / max(misfit, 1e-30))
    # of the real and of the imaginary parts of what is shared
    parts = np.stack([back.real, -back.imag], axis=1), np.stack([back.imag, back.real], axis=1)
    square, right = np.zeros((2 * count, 2 * count)), np.zeros((count, 2))
    for part, projection, left in zip(parts, kept, rest, strict=True):
        rows = part.reshape(2 * count, -1)
        square += (rows * weight) @ rows.T * np.kron(projection, np.ones((2, 2)))
        right += (part * (weight * left)[:, np.newaxis]).sum(axis=2)
    found, _, _, singular = np.linalg.lstsq(square, right.ravel(), rcond=1e-9)
    change = found.reshape(count, 2)
    return change[:, :1] + 1j * change[:, 1:], misfit, float(singular[0] / max(singular[-1], 1e-30))
