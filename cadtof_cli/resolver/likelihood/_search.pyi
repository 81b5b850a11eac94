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
def levels() -> list[str]: ...
