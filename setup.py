"""Build the compiled kernel where a C compiler is at hand; without one, cadtof installs all the same and numpy does the work."""

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


class BuildKernel(build_ext):
    """The extension with the flags that its compiler understands."""

    def build_extension(self, ext: Extension) -> None:
        """Build one extension."""
        ext.extra_compile_args = MSVC_FLAGS if self.compiler.compiler_type == "msvc" else UNIX_FLAGS
        super().build_extension(ext)


setup(
    ext_modules=[
        Extension(
            "cadtof_cli.resolver.two_path._kernel",
            ["cadtof_cli/resolver/two_path/_kernel.c"],
            depends=[f"cadtof_cli/resolver/two_path/_kernel_{part}.h" for part in ("frame", "paths")],
            py_limited_api=not FREE_THREADED,
            optional=True,
        )
    ],
    cmdclass={"build_ext": BuildKernel},
    options={} if FREE_THREADED else {"bdist_wheel": {"py_limited_api": "cp311"}},
)
