"""`cadtof`, and `python -m cadtof_cli`."""

import signal
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line. Ctrl-C during its import, when no work has begun, ends the process without a traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from cadtof_cli import cli

    cli.main()


if __name__ == "__main__":
    main()
