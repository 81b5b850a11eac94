"""Makes of every Python process one of a system that lacks what only POSIX has; found by way of PYTHONPATH.

What Windows has instead of `fcntl`, a stand-in gives: locks of one byte at the place where the file is.
"""

import importlib
import os
import signal
import sys
from types import ModuleType
from typing import cast

LACKING = {
    os: (
        *("pread", "pwrite", "preadv", "pwritev", "readv", "writev", "sched_getaffinity", "memfd_create", "fork"),
        *("O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK", "O_DIRECTORY", "O_DIRECT"),
    ),
    signal: ("SIGHUP", "pthread_sigmask", "SIG_BLOCK", "SIG_UNBLOCK", "SIG_SETMASK"),
}

fcntl = importlib.import_module("fcntl")
# it takes the stand-in for Windows itself
importlib.import_module("subprocess")


def locking(descriptor: int, mode: int, count: int) -> None:
    """Lock bytes from where the file is; OSError where another process has them."""
    assert mode == 1
    fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, count, os.lseek(descriptor, 0, os.SEEK_CUR))


for module, names in LACKING.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
# as good as not there
sys.modules["fcntl"] = cast("ModuleType", None)
msvcrt = ModuleType("msvcrt")
msvcrt.__dict__.update(LK_NBLCK=1, locking=locking)
sys.modules["msvcrt"] = msvcrt
