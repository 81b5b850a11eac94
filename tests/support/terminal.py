"""Commands whose stderr is a terminal."""

import os
import pty
import subprocess
import termios

from tests.support.run_cadtof import ENVIRONMENT, PROGRAM


def on_terminal(*arguments: object, columns: int = 120, status: int = 0, **environment: str) -> tuple[str, str]:
    """Run `cadtof` with stderr on a terminal; return stdout and the text on the terminal. It must end with `status`."""
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, columns))
    usual = {name: value for name, value in ENVIRONMENT.items() if name not in {"COLUMNS", "LINES"}}
    environment = {**usual, "TERM": "xterm-256color", **environment}
    process = subprocess.Popen(
        [*PROGRAM, *map(str, arguments)], env=environment, stdout=subprocess.PIPE, stderr=theirs, text=True
    )
    os.close(theirs)
    shown = b""
    # on Linux, to read a terminal that no process holds any more is an error
    while piece := _read(ours):
        shown += piece
    os.close(ours)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == status
    return out, shown.decode()


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""
