"""What all pixels of a frame share: light, as in fog, behind a dirty window or scattered by the lens; an offset; another zero.

A surface gives the phasors a·exp(ihx) at the harmonics h. If the same q_h is added to every pixel, it looks like a second path in
a pixel alone. Where depths differ, the phasors of many pixels tell q_h: least squares over all pixels find it.

Another zero adds one number to all stored values. The right one is that with which one path explains most pixels far better.
"""

import numpy as np

from cadtof_cli.arrays import Complex, Float, Stored, even_step, median
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.doubts.pixels import FEWEST, left_over, left_over_projections, squared_misfits, turned_by_phase
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

_MOVED = 4.0
"""What all pixels share must explain so many times more than a delay of each harmonic, such as motion between their recordings
makes. In views of few depths the two look much the same."""

_FARTHEST, _TRIED, _WORTHWHILE = 0.7, 51, 4.0
"""Longest phasor of a wrong zero that is tried, either way, how many are, and how many times smaller the misfit must be with the
best of them."""

_ZERO_EXPLAINS, _ZERO_ALONE = 50.0, 0.15
"""How many times smaller the misfit becomes with the right zero, and what all pixels may share then, over what the zero was off.
Of 2930 sound frames, those beyond the first number have .23 and more of the second: strong MPI in views of one depth. Those
within the second have 16 at most of the first."""


def shared_in_words(stored: Stored, metadata: CaptureMetadata, phasor_map: PhasorMap, /) -> str | None:
    """Return a message if all pixels of a frame, (H, 2, Y, X), share another zero, light or an offset; else None.

    `phasor_map` makes phasors of the stored values. NaN and saturated pixels are left out. Triangle waves tell nothing.
    """
    modulation = metadata.modulation
    if modulation.waveform != "sine":
        # the further terms of a triangle differ from pixel to pixel
        return None
    phasors, unit = _spread_phasors(stored, metadata, phasor_map)
    if (off := wrong_zero(phasors, unit, modulation.harmonics)) is not None:
        return _zero_in_words(off, metadata.voltage)
    if (share := shared_light(phasors, modulation.harmonics)) is None:
        return None
    parts = ", ".join(f"{abs(part):.2g} at H{h}" for h, part in zip(modulation.harmonics, share.tolist(), strict=True))
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
    delays = median(np.angle(turned_by_phase(phasors, h)[0]))[:, np.newaxis]
    for _ in range(_STEPS):
        turned, back = turned_by_phase(phasors - shared, h)
        change, misfit, condition = _least_squares_step(turned, back, h)
        misfits.append(misfit)
        if len(misfits) >= _HOPELESS and (condition > _FLAT or misfits[0] < min(len(misfits), _EXPLAINED) * misfit):
            return None
        shared = shared + change
    surfaces = (phasors - shared)[0]
    share = shared[:, 0] / median(np.abs(surfaces))
    if not (misfits[0] > _EXPLAINED * misfits[-1] and condition < _TOLD and _MATTERS < np.abs(share).max() < _MOST):
        return None
    if float(median(squared_misfits(phasors * np.exp(-1j * delays), h))) < _MOVED * misfits[-1]:
        return None
    late = float(np.angle(share[0] * np.conj(np.sum(surfaces / np.abs(surfaces)))))
    return None if 0.0 < late < _TAIL_RAD else share


def wrong_zero_in_words(stored: Stored, metadata: CaptureMetadata, phasor_map: PhasorMap, /) -> str | None:
    """Return that message of `shared_in_words` which tells of another zero; None: there is none."""
    if metadata.modulation.waveform != "sine":
        return None
    off = wrong_zero(*_spread_phasors(stored, metadata, phasor_map), metadata.modulation.harmonics)
    return None if off is None else _zero_in_words(off, metadata.voltage)


def _zero_in_words(off: float, voltage: Voltage) -> str:
    return (
        f"all stored values seem to be {off:+.5g} off, 0 V is probably {voltage.zero + off:.6g} instead of {voltage.zero:g}: "
        "correct zero_counts, or run calibrate dark if the offsets of the camera drift. Until then depths are wrong by "
        "decimetres to metres, and sigma does not say so"
    )


def wrong_zero(phasors: Complex, unit: Complex, harmonics: tuple[int, ...], /) -> float | None:
    """Return how many times `unit` was added to phasors, both complex (H, n), of one path each; None: nothing is found.

    `unit` is what a step of 1 in all stored values adds.
    """
    sound = (np.abs(phasors) < _LONGEST).all(axis=0)
    phasors, unit = phasors[:, sound], unit[:, sound]
    if len(harmonics) < 2 or phasors.shape[1] < FEWEST:
        return None
    h = np.array(harmonics, np.float64)[:, np.newaxis]
    step = 2.0 * _FARTHEST / (_TRIED - 1) / float(np.abs(unit[0]).max())
    steps = np.arange(_TRIED, dtype=np.float64) - _TRIED // 2
    some = slice(None, None, max(1, phasors.shape[1] // FEWEST))
    misfits = _misfits(phasors[:, some], unit[:, some], h, step * steps)
    # nearly all sound frames end here
    if float(misfits[_TRIED // 2]) <= _WORTHWHILE * float(misfits.min()):
        return None
    off = step * float(steps[np.argmin(misfits)])
    for _ in range(2):
        step *= 2.0 / (_TRIED - 1)
        off += step * float(steps[np.argmin(_misfits(phasors, unit, h, off + step * steps))])
    before, after = _misfits(phasors, unit, h, np.array([0.0, off])).tolist()
    if before < _ZERO_EXPLAINS * after:
        return None
    surfaces = phasors - off * unit
    bright = np.abs(surfaces[0]) > _BRIGHT * median(np.abs(surfaces[0]))
    if np.count_nonzero(bright) < FEWEST:
        return None
    left, _, _ = _least_squares_step(*turned_by_phase(surfaces[:, bright], h), h)
    other = float(np.abs(left).max() / np.abs(off * unit).max())
    return float(off) if other < _ZERO_ALONE else None


def _misfits(phasors: Complex, unit: Complex, h: Float, tried: Float) -> Float:
    """Return the median squared misfit of one path over the median power, (m,), without the numbers tried, (m,), times `unit`."""
    light = phasors[:, np.newaxis] - tried[:, np.newaxis] * unit[:, np.newaxis]
    flat = light.reshape(len(light), -1)
    power = median((np.abs(light) ** 2).sum(axis=0))
    return median(np.reshape(squared_misfits(flat, h), light.shape[1:])) / np.maximum(power, 1e-30)


def _spread_phasors(stored: Stored, metadata: CaptureMetadata, phasor_map: PhasorMap, /) -> tuple[Complex, Complex]:
    """Return phasors of sound pixels, spread over a frame, and what a step of 1 in all their stored values adds, both (H, n)."""
    planes = stored.reshape(*stored.shape[:2], -1)
    every = slice(None, None, even_step(planes.shape[2], stored.shape[3], count=_LOOKED_AT))
    some = planes[:, :, every]
    sound = sound_pixels(some, metadata.voltage.saturated_counts)
    here = phasor_map[every]
    phasors = phasors_from_stored(some, here)
    return phasors[:, sound], (phasors_from_stored(some.astype(np.float64) + 1.0, here) - phasors)[:, sound]


def _least_squares_step(turned: Complex, back: Complex, h: Float, /) -> tuple[Complex, float, float]:
    """Return the change of what all pixels share, (H, 1), the median squared misfit before it, and the condition.

    Amplitude and phase of the path take up the mean of the real parts and what is in proportion to h of the imaginary parts.
    The rest is the misfit. Pixels with a large one, such as those with MPI, count less.
    """
    count, kept, rest = len(h), left_over_projections(h), left_over(turned, h)
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
