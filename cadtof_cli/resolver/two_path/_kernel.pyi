from typing_extensions import Buffer

def resolve(
    level: str,
    order: int,
    returns: int,
    bits: int,
    start: int,
    stop: int,
    constants: Buffer,
    stored: Buffer,
    own: Buffer | None,
    other: Buffer | None,
    constant: Buffer | None,
    samples: Buffer | None,
    metres: Buffer | None,
    shift: Buffer | None,
    layers: Buffer,
    status: Buffer,
    /,
) -> None: ...
def levels() -> list[str]: ...
def constant_names() -> list[str]: ...
