from cadtof_cli.arrays import Bool, Float, Index

def solve(
    level: str,
    kind: int,
    paths: int,
    most_steps: int,
    relative: float,
    first_damping: float,
    harmonics: Index,
    re: Float,
    im: Float,
    weights: Float | None,
    starts: Float,
    worth: Float,
    points: Float,
    cost: Float,
    matrix: Float,
    converged: Bool,
    steps: Index,
    /,
) -> None: ...
def scan(
    level: str,
    rows: int,
    places: int,
    pairs: bool,
    factors: Float,
    lags: Float,
    re: Float,
    im: Float,
    first: Index,
    lag: Index,
    peak: Float,
    other: Float,
    /,
) -> None: ...
def weigh(level: str, paths: int, harmonics: Index, noise: Float, points: Float, weights: Float, /) -> None: ...
def levels() -> list[str]: ...
