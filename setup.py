"""Build what is compiled where a C compiler is at hand; without one, cadtof installs all the same and numpy does the work."""

import sysconfig

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

FREE_THREADED = bool(sysconfig.get_config_var("Py_GIL_DISABLED"))
"""Builds of Python without the global lock have no stable ABI yet."""

UNIX_FLAGS = [
    "-std=c11",
    "-O3",
    "-g0",
    # every operation is rounded as written, as numpy does it: the same bits from any compiler and processor
    "-fno-fast-math",
    "-ffp-contract=off",
    # nobody looks at errno or at floating-point traps; without this, square roots and choices are not vectorised
    "-fno-math-errno",
    "-fno-trapping-math",
]
MSVC_FLAGS = ["/std:c11", "/O2", "/fp:precise"]


COMPILED = {"files/_digest": (), "resolver/two_path/_kernel": ("_kernel_frame.h", "_kernel_paths.h")}
"""Extension modules, each of one C file in `cadtof_cli`, with the headers beside it."""


class BuildWithFlags(build_ext):
    """Extensions with the flags that their compiler understands."""

    def build_extension(self, ext: Extension) -> None:
        """Build one extension."""
        ext.extra_compile_args = MSVC_FLAGS if self.compiler.compiler_type == "msvc" else UNIX_FLAGS
        super().build_extension(ext)


def extension(path: str, headers: tuple[str, ...]) -> Extension:
    """Return the extension module of a C file, which cadtof can do without."""
    folder = f"cadtof_cli/{path.rpartition('/')[0]}"
    return Extension(
        f"cadtof_cli.{path.replace('/', '.')}",
        [f"cadtof_cli/{path}.c"],
        depends=[f"{folder}/{header}" for header in headers],
        py_limited_api=not FREE_THREADED,
        optional=True,
    )


setup(
    ext_modules=[extension(path, headers) for path, headers in COMPILED.items()],
    cmdclass={"build_ext": BuildWithFlags},
    options={} if FREE_THREADED else {"bdist_wheel": {"py_limited_api": "cp311"}},
)
