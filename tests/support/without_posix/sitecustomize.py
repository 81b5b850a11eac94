"""Takes from a Python process what only POSIX has. Python imports this file on its start if its folder is in PYTHONPATH.

A stand-in for `msvcrt` gives the locks that Windows has instead of `fcntl`: locks of bytes at the position of the file. Open
files and folders cannot be replaced.
"""

import contextlib
import errno
import importlib
import os
import signal
import sys
from pathlib import Path
from types import ModuleType
from typing import cast

LACKING = {
    os: (
        *(
            "pread",
            "pwrite",
            "preadv",
            "pwritev",
            "readv",
            "writev",
            "sendfile",
            "copy_file_range",
            "splice",
            "memfd_create",
        ),
        *(
            "fork",
            "forkpty",
            "register_at_fork",
            "nice",
            "wait",
            "wait3",
            "wait4",
            "waitid",
            "killpg",
            "setsid",
            "getsid",
        ),
        *("sched_getaffinity", "sched_setaffinity", "sched_yield", "getloadavg", "sysconf", "confstr", "statvfs"),
        *(
            "getuid",
            "geteuid",
            "getgid",
            "getegid",
            "getgroups",
            "getpgid",
            "getpgrp",
            "setuid",
            "getpriority",
            "getresuid",
        ),
        *(
            "mkfifo",
            "mknod",
            "chown",
            "lchown",
            "fchown",
            "fchmod",
            "chroot",
            "sync",
            "fdatasync",
            "posix_fadvise",
            "lockf",
        ),
        *(
            "posix_fallocate",
            "ttyname",
            "openpty",
            "tcgetpgrp",
            "pathconf",
            "getxattr",
            "setxattr",
            "listxattr",
            "eventfd",
        ),
        *(
            "O_NOFOLLOW",
            "O_CLOEXEC",
            "O_NONBLOCK",
            "O_DIRECTORY",
            "O_DIRECT",
            "O_SYNC",
            "O_DSYNC",
            "O_TMPFILE",
            "O_PATH",
        ),
    ),
    signal: (
        *("SIGHUP", "SIGPIPE", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGCHLD", "SIGSTOP", "SIGTSTP", "SIGCONT"),
        *("SIGQUIT", "SIGXCPU", "SIGXFSZ", "SIGBUS", "SIGWINCH", "setitimer", "alarm", "pause", "siginterrupt"),
        *("pthread_sigmask", "pthread_kill", "sigwait", "sigpending", "SIG_BLOCK", "SIG_UNBLOCK", "SIG_SETMASK"),
    ),
}

NO_MODULES = (
    "fcntl",
    "resource",
    "pwd",
    "grp",
    "termios",
    "tty",
    "pty",
    "syslog",
    "curses",
    "readline",
    "spwd",
    "crypt",
)

fcntl = importlib.import_module("fcntl")
# imported before there is a stand-in for msvcrt, from which subprocess would conclude that this is Windows
importlib.import_module("subprocess")


def locking(descriptor: int, mode: int, count: int) -> None:
    """Lock bytes from the position of the file on; raise OSError if another process has locked them."""
    assert mode == 1
    fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, count, os.lseek(descriptor, 0, os.SEEK_CUR))


_replace = os.replace


def replace(source: "str | os.PathLike[str]", target: "str | os.PathLike[str]") -> None:
    """Replace a file as Windows does: raise PermissionError if `target` is a folder, or a file that this process has open."""
    opened = set[str]()
    for one in Path("/proc/self/fd").iterdir():
        # another thread may close a file meanwhile
        with contextlib.suppress(FileNotFoundError):
            opened.add(os.path.realpath(one))
    if Path(target).is_dir() or not opened.isdisjoint(map(os.path.realpath, (source, target))):
        raise PermissionError(errno.EACCES, "Access denied", os.fspath(source))
    _replace(source, target)


vars(os)["replace"] = replace

for module, names in LACKING.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
for name in NO_MODULES:
    # with None, an import fails as if there were no such module
    sys.modules[name] = cast("ModuleType", None)
msvcrt = ModuleType("msvcrt")
msvcrt.__dict__.update(LK_NBLCK=1, locking=locking)
sys.modules["msvcrt"] = msvcrt
