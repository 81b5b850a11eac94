"""Work that another kernel than the usual one does."""

import os
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from cadtof_cli.resolver.kernels import CHOICE, chosen_kernel

Given = ParamSpec("Given")
Result = TypeVar("Result")


def by_kernel(
    name: str | None, function: Callable[Given, Result], /, *given: Given.args, **options: Given.kwargs
) -> Result:
    """Return the result of a function that the kernel of this name (None: the usual one) computes."""
    before = os.environ.pop(CHOICE, None)
    if chosen := name or before:
        os.environ[CHOICE] = chosen
    chosen_kernel.cache_clear()
    try:
        return function(*given, **options)
    finally:
        os.environ.pop(CHOICE, None)
        if before is not None:
            os.environ[CHOICE] = before
        chosen_kernel.cache_clear()
