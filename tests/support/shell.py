"""Commands as a person types them: a real shell runs them in a folder, with `cadtof` as a program."""

import subprocess
import sys
from pathlib import Path

from tests.support.run_cadtof import ENVIRONMENT, Finished

_CADTOF = f'cadtof() {{ "{sys.executable}" -W error -m cadtof_cli "$@"; }}\n'


def shell(script: str, folder: Path, *, program: str = "bash") -> Finished:
    """Run a script by a shell in which `cadtof` is this package; the status is that of the last command."""
    command = [program, "-c", _CADTOF + script]
    done = subprocess.run(
        command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, timeout=120, check=False
    )
    return Finished(done.returncode, done.stdout, done.stderr)
