"""Build what is compiled where a C compiler is at hand; without one, cadtof installs all the same and numpy does the work."""

import sys
import sysconfig
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.dist import Distribution

ROOT = Path(__file__).resolve().parent

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


COMPILED = {
    "resolver/two_path/_kernel": (
        "../_buffers.h",
        "../_calls.h",
        "../_instruction_sets.h",
        "../_module.h",
        "_decomposition.h",
        "_kernel_answers.h",
        "_kernel_frame.h",
        "_kernel_group.h",
        "_kernel_paths.h",
        "../diffuse/_elementary.h",
        "../diffuse/_patches.h",
        "../diffuse/_patches_call.h",
        "../diffuse/_radiosity.h",
        "../diffuse/_radiosity_call.h",
        "../diffuse/_sampled.h",
        "../diffuse/_sampled_call.h",
        "../diffuse/_tail.h",
        "../diffuse/_tail_buffers.h",
        "../diffuse/_tail_call.h",
        "../response/_search.h",
        "../response/_search_call.h",
    ),
    "resolver/likelihood/_search": (
        "../_buffers.h",
        "../_calls.h",
        "../_instruction_sets.h",
        "../_module.h",
        "_scan.h",
        "_search.h",
        "../paper/_shares.h",
        "../paper/_shares_call.h",
    ),
}
"""Extension modules, each of one C file in `cadtof_cli`, with the headers beside it."""


class BuildWithFlags(build_ext):
    """Extensions with the flags that their compiler understands."""

    def build_extension(self, ext: Extension) -> None:
        """Build one extension."""
        ext.extra_compile_args = MSVC_FLAGS if self.compiler.compiler_type == "msvc" else UNIX_FLAGS
        super().build_extension(ext)


class WheelOfWhatWasBuilt(bdist_wheel):
    """A wheel for any system where no extension was built, as numpy does the work everywhere; else one for this system."""

    def run(self) -> None:
        """Build, and see what has come of it, before the wheel is named."""
        self.run_command("build")
        built = self.get_finalized_command("build_ext")
        if not any(Path(built.get_ext_fullpath(ext.name)).exists() for ext in self.distribution.ext_modules):
            self.announce("no extension was built: the wheel is one for any system, and numpy does the work", level=3)
            self.distribution.ext_modules = []
            self.root_is_pure = True
        super().run()


class InstallManPages(Distribution().get_command_class("install_data")):
    """The man pages of all commands, made of their help."""

    def run(self) -> None:
        """Make them, and put them where others' lie; without click-man there are none, as without a compiler no kernel."""
        sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]
        try:
            from man_pages import write_man_pages

            pages = write_man_pages(ROOT / "build" / "man")
        except ImportError as error:
            self.announce(f"no man pages: {error}", level=3)
            return
        self.data_files = [("share/man/man1", [str(page.relative_to(ROOT)) for page in pages])]
        super().run()


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
    data_files=[("share/man/man1", [])],
    ext_modules=[extension(path, headers) for path, headers in COMPILED.items()],
    cmdclass={"bdist_wheel": WheelOfWhatWasBuilt, "build_ext": BuildWithFlags, "install_data": InstallManPages},
    options={} if FREE_THREADED else {"bdist_wheel": {"py_limited_api": "cp311"}},
)
