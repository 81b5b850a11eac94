"""Build the compiled kernels if a C compiler is available. Without one, cadtof still installs, and numpy does the work."""

import platform
import sys
import sysconfig
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.dist import Distribution
from setuptools.modified import newer_group

ROOT = Path(__file__).resolve().parent

FREE_THREADED = bool(sysconfig.get_config_var("Py_GIL_DISABLED"))
"""Whether this Python has no global interpreter lock. Such builds have no stable ABI yet."""

UNIX_FLAGS = [
    "-std=c11",
    "-O3",
    "-g0",
    # round every operation as written, as numpy does: every compiler and processor gives the same bits
    "-fno-fast-math",
    "-ffp-contract=off",
    # the code reads neither errno nor floating-point traps; without these flags, square roots and selections are not
    # vectorised
    "-fno-math-errno",
    "-fno-trapping-math",
]
if sys.maxsize < 2**32 and platform.machine() in {"i386", "i586", "i686", "x86_64"}:
    # the x87 unit would round to 80 bits, and the kernel refuses to be built for it
    UNIX_FLAGS += ["-msse2", "-mfpmath=sse"]
LINK_FLAGS = ["-O3", "-fno-fast-math", "-fno-unsafe-math-optimizations"]
"""If a linker is given -Ofast or -ffast-math, the extension makes the whole process take subnormal numbers for 0."""
MSVC_FLAGS = ["/std:c11", "/O2", "/fp:precise"]


COMPILED = {
    "resolver/two_path/_kernel": (
        "../_buffers.h",
        "../_calls.h",
        "../_instruction_sets.h",
        "../_module.h",
        "_arcsine.h",
        "_decomposition.h",
        "_kernel_answers.h",
        "_kernel_frame.h",
        "_kernel_group.h",
        "_kernel_paths.h",
        "../diffuse/_elementary.h",
        "../diffuse/_patch_steps.h",
        "../diffuse/_patch_steps_call.h",
        "../diffuse/_radiosity.h",
        "../diffuse/_radiosity_call.h",
        "../diffuse/_light.h",
        "../diffuse/_light_call.h",
        "../diffuse/_pixels.h",
        "../diffuse/_pixels_buffers.h",
        "../diffuse/_pixels_call.h",
        "../response/_newton.h",
        "../response/_newton_call.h",
        "../response/_other_pairs.h",
        "../response/_other_pairs_call.h",
        "../response/_table.h",
    ),
    "resolver/likelihood/_likelihood": (
        "../_buffers.h",
        "../_calls.h",
        "../_instruction_sets.h",
        "../_module.h",
        "_starts.h",
        "_levenberg_marquardt.h",
        "../paper/_levenberg_marquardt.h",
        "../paper/_levenberg_marquardt_call.h",
        "../response/_more_harmonics.h",
        "../response/_table.h",
        "../two_path/_arcsine.h",
    ),
}
"""Extension modules: the path of a C file in `cadtof_cli` without its suffix, and the headers on which it depends."""


class BuildWithFlags(build_ext):
    """Build extensions with the flags that their compiler understands."""

    def run(self) -> None:
        """Build all extensions. None of older sources stays if that fails: its maps could have other bits."""
        in_checkout = self.inplace or self.editable_mode
        for ext in self.extensions:
            for folder in (Path(self.build_lib), *([ROOT] if in_checkout else [])):
                for built in folder.glob(f"{ext.name.replace('.', '/')}.*"):
                    if built.suffix in {".so", ".pyd"} and newer_group(ext.sources + ext.depends, built, "newer"):
                        built.unlink()
        super().run()

    def get_ext_filename(self, fullname: str) -> str:
        """Return the path of an extension. Python 3.15 would put the system into its name, and older Pythons not find it."""
        name = super().get_ext_filename(fullname)
        return name if ".abi3-" not in name else f"{name.partition('.abi3-')[0]}.abi3.so"

    def build_extension(self, ext: Extension) -> None:
        """Build one extension."""
        if self.compiler.compiler_type == "msvc":
            ext.extra_compile_args = MSVC_FLAGS
        else:
            ext.extra_compile_args, ext.extra_link_args = UNIX_FLAGS, LINK_FLAGS
        super().build_extension(ext)


class WheelOfWhatWasBuilt(bdist_wheel):
    """Build a wheel for this system. If no extension was built, the wheel is for any system, because numpy does the work."""

    def run(self) -> None:
        """Build the extensions before the wheel gets its name, because the name depends on whether one was built."""
        build = Path(self.get_finalized_command("build").build_lib)
        for module in build.glob("cadtof_cli/**/*.py"):
            # a package of an older commit would hide a module of this one
            if not (ROOT / module.relative_to(build)).exists():
                module.unlink()
        self.run_command("build")
        built = self.get_finalized_command("build_ext")
        if not any(Path(built.get_ext_fullpath(ext.name)).exists() for ext in self.distribution.ext_modules):
            self.announce("no extension was built: the wheel is one for any system, and numpy does the work", level=3)
            self.distribution.ext_modules = []
            self.root_is_pure = True
        super().run()


class InstallManPages(Distribution().get_command_class("install_data")):
    """Make the man pages of all commands from their help, and install them."""

    def run(self) -> None:
        """Make the pages for the usual folder of man pages.

        Without click-man there are no pages, and the installation goes on.
        """
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
    """Return the extension module of a C file. It is optional: if it cannot be built, the installation goes on without it."""
    folder = f"cadtof_cli/{path.rpartition('/')[0]}"
    return Extension(
        f"cadtof_cli.{path.replace('/', '.')}",
        [f"cadtof_cli/{path}.c"],
        depends=["setup.py", *(f"{folder}/{header}" for header in headers)],
        py_limited_api=not FREE_THREADED,
        # the C files ask for it before Python.h defines it
        define_macros=[("Py_GIL_DISABLED", "1")] if FREE_THREADED else [],
        optional=True,
    )


setup(
    data_files=[("share/man/man1", [])],
    ext_modules=[extension(path, headers) for path, headers in COMPILED.items()],
    cmdclass={"bdist_wheel": WheelOfWhatWasBuilt, "build_ext": BuildWithFlags, "install_data": InstallManPages},
    options={} if FREE_THREADED else {"bdist_wheel": {"py_limited_api": "cp311"}},
)
