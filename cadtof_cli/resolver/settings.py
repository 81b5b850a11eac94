"""The settings of the resolver that a user can choose: one frozen record that checks itself."""

from typing import Literal, get_args

from cadtof_cli.errors import SettingsError
from cadtof_cli.records import dataclass, setting
from cadtof_cli.units import counted

SolverName = Literal["two-path", "one-path", "lm"]
Return = Literal["first", "strongest", "last"]
MpiModel = Literal["auto", "discrete", "diffuse"]

SOLVERS: tuple[SolverName, ...] = get_args(SolverName)
CLOSED_FORM = "two_path.solver"
"""The module of the closed form, which the compiled kernel does too."""

ORDERS: tuple[str, ...] = ("auto", "1", "2")
"""Allowed values of `order` with two paths. With more paths, all numbers up to the number of paths are allowed."""

RETURNS: tuple[Return, ...] = get_args(Return)
MPI_MODELS: tuple[MpiModel, ...] = get_args(MpiModel)

MOST_PATHS, MOST_STARTS = 100, 10**9
"""Upper limits, far beyond useful values: 100 paths need 100 periods, and 10⁹ starts take days."""

SECONDS_IN_CLOSED_FORM = 2e-7
SECONDS_BY_LIKELIHOOD = 4e-6
SECONDS_BY_MANY_PATHS = 4e-5
SECONDS_BY_LM = 3e-5
"""Rough time per pixel, in s. It only serves to decide whether a frame is worth more than one process."""


@dataclass(frozen=True, kw_only=True)
class ResolverSettings:
    """How phasors become paths.

    `false_alarm` is an upper limit for the share of pixels without MPI that get a second path, because a second path
    must also be worth its scatter. Pixels whose first phasor is shorter than `min_confidence`, in units of the phasors,
    get no answer. If it is None, pixels without a signal above the noise get no answer.
    """

    mpi_model: MpiModel = setting(
        "auto",
        "Model of the MPI. discrete: separate paths. diffuse: a tail of light, predicted from the geometry of the scene. "
        "auto: chosen for each frame. --return last, and a --solver, --order or --paths other than the default, mean "
        "discrete.",
    )
    solver: SolverName = setting(
        "two-path",
        "How to find the paths. two-path: closed form with two periods, maximum likelihood with more periods or --paths. "
        "one-path: maximum likelihood. lm: the paper's Levenberg–Marquardt from random starts.",
    )
    paths: int = setting(
        2,
        "Largest number of paths per pixel. More than 2 need as many periods, and add the layers path3.depth and so on.",
        metavar="K",
    )
    order: str = setting(
        "auto",
        "Number of paths per pixel, for every solver. auto: tested in each pixel. A number: always that many "
        "(--solver lm --order 2 is the method as the paper published it).",
        metavar="auto|1|…|K",
    )
    starts: int = setting(10, "Number of random starts of --solver lm.")
    seed: int = setting(
        0,
        "Seed of the random starts of --solver lm. A pixel's starts depend on the seed and its position only.",
    )
    false_alarm: float = setting(
        0.01,
        "Probability that noise alone is taken for a signal. Also the probability that a pixel with one path fails the "
        "test for one path because of noise; about a third of the pixels that fail are then resolved as two paths.",
        metavar="P",
    )
    returns: Return = setting("first", "Which path to report as the direct one.", option="--return")
    min_return_ratio: float = setting(
        0.1, "Smallest amplitude of a first or last return, relative to the strongest path.", metavar="R"
    )
    min_confidence: float | None = None

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("--mpi-model", self.mpi_model, MPI_MODELS),
            ("--solver", self.solver, SOLVERS),
            ("--return", self.returns, RETURNS),
        ):
            if value not in allowed:
                raise SettingsError(f"{name}: found {value!r}, expected one of {', '.join(allowed)}")
        if not 0.0 < self.false_alarm < 1.0:
            raise SettingsError(f"--false-alarm: found {self.false_alarm}, expected a probability between 0 and 1")
        if not 0.0 <= self.min_return_ratio <= 1.0:
            raise SettingsError(f"--min-return-ratio: found {self.min_return_ratio}, expected 0 to 1")
        for option, number, most in (("--paths", self.paths, MOST_PATHS), ("--starts", self.starts, MOST_STARTS)):
            if not 1 <= number <= most:
                raise SettingsError(f"{option}: found {number}, expected 1 to {most}")
        if self.seed < 0:
            raise SettingsError(f"--seed: found {self.seed}, expected 0 or more")
        if self.solver == "lm" and self.paths > 2:
            raise SettingsError(f"--solver lm finds two paths, not --paths {self.paths}: use --solver two-path")
        most = 1 if self.solver == "one-path" else self.paths
        orders = ("auto", *map(str, range(1, most + 1)))
        if self.order not in orders:
            raise SettingsError(
                f"--order: found {self.order!r}, expected one of {', '.join(orders)} "
                f"with --solver {self.solver} and --paths {self.paths}"
            )

    @property
    def max_paths(self) -> int:
        """Largest number of paths that a pixel may get."""
        if self.order != "auto":
            return int(self.order)
        return 1 if self.solver == "one-path" else self.paths

    def may_be_diffuse(self, harmonics: tuple[int, ...], /) -> bool:
        """Whether a frame's MPI may be taken for diffuse: default solver, paths and order, and not the last return.

        A tail is predicted from harmonics 1 and 2, and from higher harmonics if there are any.
        """
        free = (self.solver, self.paths, self.order) == ("two-path", 2, "auto") and self.returns != "last"
        return free and self.mpi_model != "discrete" and harmonics[:2] == (1, 2)

    def solver_module(self, harmonics: tuple[int, ...], /, *, sine: bool) -> str:
        """Return the module of the resolver whose `solver` fits the paths; `sine`: the response is a pure sine.

        Raises:
            SettingsError: there are fewer harmonics than paths; or there are as many, but they are neither 1, 2, … nor
                1, 2, 4, so that several answers fit them; or diffuse MPI is asked for without harmonics 1 and 2; or the
                response is no pure sine, and the solver is `lm`.
        """
        found = f"found harmonics {', '.join(map(str, harmonics))}"
        if self.max_paths > len(harmonics):
            raise SettingsError(
                f"modulation.periods_ns: found {counted(len(harmonics), 'period')}; {self.max_paths} paths need at least "
                f"{self.max_paths} periods: lower --paths or --order, or use --solver one-path"
            )
        first = range(1, len(harmonics) + 1)
        # with 1, 2, 4, most pixels have a single answer, too, and the search finds it
        if self.max_paths == len(harmonics) and harmonics not in (tuple(first), (1, 2, 4)):
            raise SettingsError(
                f"modulation.periods_ns: {found} of the first period; with {len(harmonics)} periods, {self.max_paths} paths have "
                f"a unique solution only if these are harmonics {', '.join(map(str, first))}, such as "
                f"{[round(40.0 / h, 3) for h in first]}: record another period, lower --paths or --order, or use --solver "
                "one-path"
            )
        if self.mpi_model == "diffuse" and self.may_be_diffuse((1, 2)) and not self.may_be_diffuse(harmonics):
            raise SettingsError(
                f"--mpi-model diffuse: {found} of the first period; diffuse MPI is predicted from harmonics 1 and 2: "
                "record half of the first period, too, or leave the option out"
            )
        in_closed_form = harmonics == (1, 2) and self.solver != "lm"
        if sine:
            by_search = "paper.solver" if self.solver == "lm" and self.max_paths == 2 else "likelihood.solver"
            return CLOSED_FORM if in_closed_form else by_search
        if self.solver == "lm":
            raise SettingsError(
                "--solver lm: Eq. (9) is that of a sine, and the waveform or calibrated response is not a pure sine: leave the "
                "option out"
            )
        return "response.solver" if harmonics == (1, 2) else "response.more_harmonics"

    def seconds_per_pixel(self, harmonics: int, /) -> float:
        """Return roughly how long one core takes for a pixel, in s, as measured by `scripts/benchmark_solvers.py`."""
        if self.solver == "lm" and self.max_paths == 2:
            return SECONDS_BY_LM
        if self.max_paths > 2:
            return SECONDS_BY_MANY_PATHS
        return SECONDS_IN_CLOSED_FORM if harmonics == 2 else SECONDS_BY_LIKELIHOOD
