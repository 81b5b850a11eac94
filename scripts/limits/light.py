"""Measure the depth where light or the camera behaves otherwise than as separate paths: fog, wax, stray light, drift."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from cadtof_cli import Frame, resolve
from cadtof_cli.doubts.frame import camera_doubts, doubts
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.units import C_M_PER_NS
from limits.drawn import markdown, write_csv
from tests.support.mixtures import C, F

ASR, N_AV, FWHM_NS, AMPLITUDE_V, T1_NS = 2.0, 1e5, 1.7, 0.2746, 40.0
FOCAL_PX, STEP_M = 140.0, 0.02


@dataclass(frozen=True)
class Light:
    """What the camera sees, and what it does with it: every default is that of a sound camera in clear air.

    Attributes:
        laser: phasor of the laser's photons at k times the fundamental while harmonic h is recorded, (Y, X); the median of its
            direct light is 1.
        ambient: ambient light while harmonic h is recorded, in the same unit.
        power: of the laser while harmonic h is recorded.
        offset_v: added to SC1 + i·SC2, V.
        sc2: factor on SC2.
        skew_rad: angle by which SC1 and SC2 are not a quarter of a period apart.
        third: share of the third harmonic in the modulation.
    """

    laser: Callable[[int, int], C]
    ambient: Callable[[int], F | float] = field(default=lambda _h: ASR)
    power: Callable[[int], float] = field(default=lambda _h: 1.0)
    offset_v: complex = 0.0
    sc2: float = 1.0
    skew_rad: float = 0.0
    third: float = 0.0


@dataclass(frozen=True)
class Seen:
    """Errors of one condition, in cm; shares of pixels; the median misfit of three periods; whether there is a warning."""

    harmonics: int
    strongest: bool
    median_cm: float
    most_cm: float
    sigma_cm: float
    beyond: float
    doubted: float
    chi_squared: float
    warned: bool


def scene(size: tuple[int, int]) -> tuple[F, F, F]:
    """Return range in m and direct light, (Y, X), and view directions, (Y, X, 3): wall, floor, three balls."""
    focal = FOCAL_PX * size[0] / 120.0
    row, column = np.indices(size)
    rays = np.stack([(column - size[1] / 2) / focal, (row - size[0] / 2) / focal, np.ones(size)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    leaning = np.array([0.17, 0.0, -1.0]) / np.hypot(0.17, 1.0)
    far_m, normal = (leaning @ [0.0, 0.0, 3.2]) / (rays @ leaning), np.broadcast_to(leaning, rays.shape)
    albedo = np.full(size, 0.7)
    floor_m = 0.9 / np.maximum(rays[..., 1], 1e-3)
    lower = floor_m < far_m
    far_m, albedo = np.where(lower, floor_m, far_m), np.where(lower, 0.35, albedo)
    normal = np.where(lower[..., np.newaxis], np.array([0.0, -1.0, 0.0]), normal)
    for centre, radius, share in (
        ((-0.5, 0.3, 1.9), 0.42, 0.8),
        ((0.75, 0.5, 1.5), 0.3, 0.3),
        ((0.5, -0.5, 2.4), 0.35, 0.6),
    ):
        along = rays @ np.array(centre)
        square = along**2 - np.dot(centre, centre) + radius**2
        ball_m = np.where(square > 0.0, along - np.sqrt(np.maximum(square, 0.0)), np.inf)
        nearer = ball_m < far_m
        far_m, albedo = np.where(nearer, ball_m, far_m), np.where(nearer, share, albedo)
        hit = rays * np.where(nearer, ball_m, 0.0)[..., np.newaxis]
        normal = np.where(nearer[..., np.newaxis], (hit - centre) / radius, normal)
    direct = (
        albedo * (1.0 + 0.15 * np.sin(column / 7.0) * np.sin(row / 5.0)) * np.abs((rays * normal).sum(-1)) / far_m**2
    )
    return far_m, direct / np.median(direct), rays


def echo(range_m: F | float, amplitude: F | float, k: int, _h: int = 1) -> C:
    """Return the phasor of light that comes back from a range."""
    return np.asarray(amplitude * np.exp(4j * np.pi * k * np.asarray(range_m) / C_M_PER_NS / T1_NS))


def _in_second(usual: float, factor: float, h: int) -> float:
    """Return what is usual, times a factor while the second harmonic is recorded."""
    return usual * factor if h == 2 else usual


def _with_echo(clear: Callable[[int], C], range_m: float, amplitude: float, k: int, _h: int) -> C:
    """Return light with an echo of all pixels."""
    return clear(k) + echo(range_m, amplitude, k)


def _scattered(clear: Callable[[int], C], part: float, mean_ns: float, k: int, _h: int) -> C:
    """Return light of which a part leaves the surface later, by times that fall off exponentially."""
    return clear(k) * (1.0 - part + part / (1.0 - 2j * np.pi * k * mean_ns / T1_NS))


def conditions(range_m: F, direct: F, rays: F) -> Iterator[tuple[str, Light]]:
    """Yield all conditions, with what they are."""
    clear = partial(echo, range_m, direct)
    yield "clear air, a sound camera", Light(clear)
    for name, back, loss, nearest, farthest in (
        ("fog: {:.2g} of the light of the surfaces", 0.01, 0.02, 0.0, 9.0),
        ("fog: {:.2g}", 0.05, 0.05, 0.0, 9.0),
        ("smoke between .8 and 1.2 m: {:.2g}", 0.5, 0.1, 0.8, 1.2),
    ):
        steps_m = np.arange(STEP_M, 6.0, STEP_M)
        # the beam of a lamp beside the lens comes into view at .15 m
        share = (
            back * STEP_M * np.exp(-2.0 * loss * steps_m) / steps_m**2 * (1.0 - np.exp(-((steps_m / 0.15) ** 2))) ** 2
        )
        share = np.where((steps_m >= nearest) & (steps_m <= farthest), share, 0.0)
        last = np.minimum((range_m / STEP_M).astype(int), len(steps_m)) - 1
        left = direct * np.exp(-2.0 * loss * range_m)

        def fogged(k: int, _h: int, left: F = left, share: F = share, steps: F = steps_m, last: F = last) -> C:
            return np.asarray(echo(range_m, left, k) + np.cumsum(echo(steps, share, k))[last])

        yield name.format(share.sum() / np.median(left)), Light(fogged)
    for name, where_m, share_of in (
        ("fogged window at 2 cm: .02", 0.02, 0.02),
        ("fogged window at 2 cm: .1", 0.02, 0.1),
        ("stray light of a reflector at 1.5 m: .02", 1.5, 0.02),
        ("stray light of a reflector at 1.5 m: .1", 1.5, 0.1),
    ):
        yield name, Light(partial(_with_echo, clear, where_m, share_of))
    yield "skin: .3 of the light .1 ns later", Light(partial(_scattered, clear, 0.3, 0.1))
    yield "wax: .5, .3 ns", Light(partial(_scattered, clear, 0.5, 0.3))
    yield "milk: .8, 1 ns", Light(partial(_scattered, clear, 0.8, 1.0))
    other_m = 0.5 * (np.linalg.norm(range_m[..., np.newaxis] * rays - [1.0, 0.0, 0.0], axis=-1) + range_m)
    for name, part, left_over in (
        ("lamp of another camera as strong, beats average out", 1.0, 0.0),
        ("lamp of another camera as strong, .02 of it is left", 1.0, 0.02),
        ("lamp of another camera a tenth as strong, its phase drifts from period to period", 0.1, 1.0),
    ):

        def with_other(k: int, h: int, part: float = part, left_over: float = left_over) -> C:
            drift = (1.0 if k == 0 else left_over * (k <= 2 * h)) * np.exp(2.4j * h * h * (k > 0))
            return np.asarray(clear(k) + drift * echo(other_m, part * direct, k))

        yield name, Light(with_other)
    yield "sun: ASR 20", Light(clear, ambient=lambda _h: 10.0 * ASR)
    yield (
        "lamps of 100 Hz: a tenth more ambient light for the second period",
        Light(clear, ambient=partial(_in_second, ASR, 1.1)),
    )
    yield "laser .1 weaker for the second period", Light(clear, power=partial(_in_second, 1.0, 0.9))
    yield "offsets of .3 mV", Light(clear, offset_v=3e-4 - 3e-4j)
    yield "offsets of 1 mV", Light(clear, offset_v=1e-3 - 1e-3j)
    yield "offsets of 5 mV", Light(clear, offset_v=5e-3 - 5e-3j)
    yield "SC2 .02 stronger than SC1", Light(clear, sc2=1.02)
    yield "SC2 .1 stronger than SC1", Light(clear, sc2=1.1)
    yield "SC1 and SC2 88° apart", Light(clear, skew_rad=np.radians(2.0))
    yield "third harmonic in the modulation: .01", Light(clear, third=0.01)
    yield "third harmonic in the modulation: .05", Light(clear, third=0.05)


def recorded(light: Light, harmonics: int, rng: np.random.Generator) -> F:
    """Return the volts of one frame, (H, 2, Y, X)."""
    frame = []
    for h in range(1, harmonics + 1):
        photons = light.power(h) * light.laser(0, h).real + light.ambient(h)
        pulse = (2.0 * np.pi * h * FWHM_NS / 2.354820045 / T1_NS) ** 2 / 2.0
        one, two, three = (light.power(h) * np.exp(-k * k * pulse) * light.laser(k * h, h) / photons for k in (1, 2, 3))
        c, s, q = one.real, one.imag, 1.0 / (2.0 * N_AV - 1.0)
        spread = np.sqrt(q * ((1.0 + two.real) / 2.0 - c * c))
        both = q * (two.imag / 2.0 - c * s) / spread
        rest = np.sqrt(np.maximum(q * ((1.0 - two.real) / 2.0 - s * s) - both**2, 0.0))
        noise = rng.standard_normal((2, *one.shape))
        mean = one + light.third * np.conj(three)
        sc1 = mean.real + spread * noise[0]
        sc2 = (
            mean.imag * np.cos(light.skew_rad) + mean.real * np.sin(light.skew_rad) + both * noise[0] + rest * noise[1]
        )
        frame.append([AMPLITUDE_V * sc1 + light.offset_v.real, light.sc2 * AMPLITUDE_V * sc2 + light.offset_v.imag])
    return np.array(frame)


def seen(light: Light, truth_m: F, harmonics: int, strongest: bool) -> Seen:
    """Record and resolve one frame."""
    volts = recorded(light, harmonics, np.random.default_rng(7))
    known = {
        "modulation.periods_ns": [T1_NS / h for h in range(1, harmonics + 1)],
        "modulation.amplitude_v": AMPLITUDE_V,
        "pixel.integration_length": N_AV,
        "pulse.fwhm_ns": FWHM_NS,
        "optics.focal_length_px": FOCAL_PX * truth_m.shape[0] / 120.0,
    }
    frame = Frame.from_array(volts, known)
    maps = resolve(frame, returns="strongest" if strongest else "first")
    error, sigma = 100.0 * np.abs(maps["direct.depth"] - truth_m), 100.0 * maps["direct.sigma"]
    answered = np.isfinite(error)
    warned = bool(doubts(volts, frame.metadata) or camera_doubts(volts, frame.metadata))
    return Seen(
        harmonics,
        strongest,
        float(np.median(error[answered])),
        float(np.quantile(error[answered], 0.9)),
        float(np.median(sigma[answered])),
        float((error > 3.0 * sigma)[answered].mean()),
        float((maps.status & StatusBit.ILL_CONDITIONED > 0).mean()),
        float(np.nanmedian(maps["chi_squared"])) if "chi_squared" in maps else float("nan"),
        warned,
    )


def light(out: Path, *, rows: int) -> str:
    """Measure all conditions, write the table, and return the page."""
    range_m, direct, rays = scene((rows, rows * 4 // 3))
    lines, table = [], []
    for number, (name, condition) in enumerate(conditions(range_m, direct, rays)):
        found = [seen(condition, range_m, *how) for how in ((2, False), (2, True), (3, False))]
        first, strongest, three = found
        lines += [{"condition": number} | asdict(one) for one in found]
        table.append(
            [
                name,
                _errors(first),
                f"{first.beyond:.0%}",
                f"{first.doubted:.0%}",
                "yes" if first.warned else "no",
                _errors(strongest),
                _errors(three),
                f"{_two_digits(three.chi_squared)}, {'yes' if three.warned else 'no'}",
            ]
        )
    write_csv(out / "light.csv", lines)
    head = ["what", "error, sigma", "beyond 3 sigma", "bit 32", "warned", "`--return strongest`", "three periods"]
    head.append("`chi_squared`, warned")
    return PAGE.format(rows=rows, columns=rows * 4 // 3, table=markdown(head, table))


def _errors(one: Seen) -> str:
    return "{} / {}, {}".format(*map(_two_digits, (one.median_cm, one.most_cm, one.sigma_cm)))


def _two_digits(number: float) -> str:
    return f"{number:.2g}" if number < 10.0 else f"{number:.0f}"


PAGE = """# Light that is no separate path

For everyone who records through fog or a dirty window, looks at wax or skin, or shares the room with lamps and other
cameras: how wrong the depths are, whether sigma holds it, and whether a warning tells.

Made by `scripts/measure_limits light`: one frame of {columns} × {rows} pixels per condition, in [light.csv](light.csv). The
view is a yard: a leaning wall at 3 m, a floor and three balls. There is no other MPI. ASR 2, n_av 1e5 per harmonic, no
calibration; the script renders the frames itself.

How to read the table:

- **error, sigma**: median / 90 % of |error| and median sigma of the direct depth, cm, with two periods and all defaults;
- **beyond 3 sigma**: share of the pixels that are wrong by more than three sigma;
- **bit 32**: share of the pixels that are called ill-conditioned (without MPI a tenth);
- **warned**: whether `resolve` warns on stderr;
- the last two columns are the same with a third period; `chi_squared` is the median of that layer (2 to 5 where one path
  or two explain the light).

Numbers such as .1 in the first column are shares of the median light of the surfaces.

{table}

**What all pixels share** (fog, smoke, a dirty window, stray light, offsets). In each pixel alone it looks like a second
path, and if it comes before the surface with a tenth of the light or more, it is the first return: the depth is that of
the fog or window, metres too near, with a sigma of millimetres. If depths differ over the view, the pixels together tell
that they share something. `resolve` then warns: `all pixels share light or an offset`. `--return strongest` takes what is
behind, as long as the surface is brighter than the fog. Not noticed are

- less than a hundredth of the light of the surfaces;
- a view of one depth, such as a flat wall;
- what comes up to 16 ns after the surfaces: the MPI of small rooms is like that. (An offset may look so, too.)
- fog so thick that hardly any surface is seen through it;
- anything with triangle waves, or with a calibration that found further terms of the response;
- a view of which most is sky or foliage. There the sky itself shows the fog or the offset, and all pixels without a surface
  get nearly the same small depth;
- anything if one path is asked for (`--order 1`, `--solver one-path`).

**Light that leaves a surface later** (wax, skin, milk, leaves). Nothing tells: light that is late by much less than a
nanosecond looks like a surface that lies deeper. The depth is too far by half the way of the mean delay, and no number of
periods, no sigma and no bit says so. From a nanosecond on, bit 32 is set in most pixels if two periods are recorded.

**Lamps and other cameras.** Ambient light that does not change adds noise, and sigma holds it. Its changes matter: each
period is recorded at another time, and a lamp of 100 Hz does not average out within the .8 ms of n_av 1e5. If it is brighter
for one period, the amplitudes of the harmonics differ as they do with a weaker laser. If they differ alike everywhere,
`resolve` warns: `harmonic 2 is 0.95 times as strong`. No calibration helps if it changes from frame to frame; `--order 1`
does where MPI is weak. If only a part of the view is lit by such lamps, nothing tells. The lamp of another camera with the
same periods, or with beats slower than the average forgets, is taken for paths or for a tail, and nothing tells reliably:
depths of a still scene that differ from frame to frame by more than sigma show it. With other periods it averages out.

**The camera itself.** Gains, phases and further harmonics that `calibrate response` was not asked to measure make errors of
millimetres to centimetres that sigma does not hold, and with two periods no warning tells. With three, `chi_squared` is above
5 in most of these cases: look at it with `cadtof preview MAPS -o chi.png --layer chi_squared`. If its median is above 10,
`resolve` says that the paths of the frame do not explain the light, and `frames.jsonl` has the words, too.
"""
