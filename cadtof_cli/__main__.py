"""`cadtof`, and `python -m cadtof_cli`."""

import atexit
import os
import signal
from typing import NoReturn

FRAME_PLACES = 8192
"""Places for values in the frame of `main`, 8 bytes each.

CPython keeps the frames of calls in chunks of 16 kB. If a call does not fit, it asks the system for another chunk, and
returns it when the call ends. If imports lie at that depth, this happens a thousand times and costs a twentieth of a
short run. A frame that is larger than a chunk gets a large one, in which the frames of all later calls have place.
"""


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


main.__code__ = main.__code__.replace(co_stacksize=FRAME_PLACES)

if __name__ == "__main__":
    main()
