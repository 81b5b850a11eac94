"""`cadtof`, and `python -m cadtof_cli`."""

import atexit
import os
import signal
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line. Ctrl-C during its import, when no work has begun, ends the process without a traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    statuses: list[int] = []
    # functions that are registered first run last
    atexit.register(_leave, statuses)
    from cadtof_cli import cli

    try:
        cli.main()
    except SystemExit as ending:
        statuses.append(ending.code if isinstance(ending.code, int) else 1)
        raise


def _leave(statuses: list[int]) -> None:
    """End the process as soon as everything is written and closed: to free each object takes a tenth of a short run.

    Args:
        statuses: the exit status; empty if Python has an error to show.
    """
    if statuses:
        os._exit(statuses[0])


if __name__ == "__main__":
    main()
