"""Wheels: the name says whether they hold compiled extensions, and flags of a distribution change no bits."""

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from tests.support.needed import needed_program
from tests.support.run_cadtof import ENVIRONMENT, ROOT

NO_COMPILER = str(Path(os.sep) / "there" / "is" / "no" / "compiler")

BUILD = "from setuptools.build_meta import build_wheel; build_wheel('wheels')"


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """Return a copy of the sources whose C files are almost empty: the real ones take a minute to compile."""
    for name in ("setup.py", "pyproject.toml", "README.md", "LICENSE", "MANIFEST.in"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(
        ROOT / "cadtof_cli", tmp_path / "cadtof_cli", ignore=shutil.ignore_patterns("*.so", "*.pyd", "__pycache__")
    )
    for file in tmp_path.rglob("*.c"):
        file.write_text("int nothing;\n")
    return tmp_path


def wheel(sources: Path, compiler: str, build: str = BUILD) -> tuple[str, list[str], str]:
    """Return the name of the wheel that is built, the extensions in it, and what it says of itself."""
    given = {"CC": compiler, "LDSHARED": f"{compiler} -shared"}
    words = [sys.executable, "-c", build]
    done = subprocess.run(words, cwd=sources, env={**ENVIRONMENT, **given}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (file,) = (sources / "wheels").iterdir()
    with ZipFile(file) as archive:
        (about,) = (name for name in archive.namelist() if name.endswith(".dist-info/WHEEL"))
        compiled = [name for name in archive.namelist() if Path(name).suffix in {".so", ".pyd"}]
        return file.name, compiled, archive.read(about).decode()


def test_a_wheel_built_without_a_compiler_is_for_any_system(sources: Path) -> None:
    name, compiled, about = wheel(sources, NO_COMPILER)
    assert name.endswith("-py3-none-any.whl")
    assert not compiled
    assert "Root-Is-Purelib: true" in about
    assert "Tag: py3-none-any" in about


def test_a_wheel_built_with_a_compiler_is_for_this_system_and_any_python(sources: Path) -> None:
    name, compiled, about = wheel(sources, needed_program("cc"))
    assert "-abi3-" in name
    assert not name.endswith("-any.whl")
    # the only name that every Python looks for
    assert {Path(one).name for one in compiled} == {"_kernel.abi3.so", "_likelihood.abi3.so"}
    assert "Root-Is-Purelib: false" in about


def test_a_wheel_holds_the_extensions_that_could_be_built(sources: Path) -> None:
    (sources / "cadtof_cli" / "resolver" / "likelihood" / "_likelihood.c").write_text("this is no C\n")
    name, compiled, _ = wheel(sources, needed_program("cc"))
    assert "-abi3-" in name
    assert [Path(one).name.partition(".")[0] for one in compiled] == ["_kernel"]


@pytest.mark.parametrize("disabled", [0, 1])
def test_extensions_know_before_python_h_whether_there_is_a_stable_abi(sources: Path, disabled: int) -> None:
    """`Python.h` of a free-threaded Python refuses the limited API, and the C files ask for it otherwise."""
    for file in sources.rglob("*.c"):
        file.write_text(f"#if {'!' * disabled}defined Py_GIL_DISABLED\n#error\n#endif\nint nothing;\n")
    build = f"import sysconfig; sysconfig.get_config_vars()['Py_GIL_DISABLED'] = {disabled}; {BUILD}"
    _, compiled, _ = wheel(sources, needed_program("cc"), build)
    assert [".abi3." in name for name in compiled] == 2 * [not disabled]


@pytest.mark.parametrize(
    ("largest", "machine", "expected"),
    [
        (2**31 - 1, "i686", True),
        (2**31 - 1, "x86_64", True),
        (2**31 - 1, "armv7l", False),
        (2**63 - 1, "x86_64", False),
    ],
)
def test_on_32_bit_x86_the_compiler_is_told_to_use_sse2(largest: int, machine: str, expected: bool) -> None:
    """Without these flags it uses the x87 unit, which rounds otherwise, and no kernel is built. Elsewhere it knows neither."""
    lines = (
        "import platform, runpy, sys",
        f"sys.maxsize, sys.argv, platform.machine = {largest}, ['setup.py', '-q', '--name'], lambda: {machine!r}",
        "print(runpy.run_path('setup.py')['UNIX_FLAGS'])",
    )
    words = [sys.executable, "-c", "; ".join(lines)]
    done = subprocess.run(words, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    flags = done.stdout.splitlines()[-1]
    assert ["'-msse2'" in flags, "'-mfpmath=sse'" in flags] == [expected, expected]


def build_in_checkout(sources: Path, compiler: str) -> list[str]:
    """Build in place, and return the extensions that the checkout then has."""
    given = {"CC": compiler, "LDSHARED": f"{compiler} -shared"}
    words = [sys.executable, "setup.py", "-q", "build_ext", "--inplace"]
    subprocess.run(words, cwd=sources, env={**ENVIRONMENT, **given}, check=True)
    return sorted(file.name for file in (sources / "cadtof_cli").rglob("*.so"))


def edit(file: Path) -> None:
    """Make a source newer than all that was built."""
    checkout = next(folder for folder in file.parents if (folder / "setup.py").exists())
    later = max(one.stat().st_mtime for one in checkout.rglob("*.*")) + 2
    os.utime(file, (later, later))


def test_a_build_that_fails_leaves_the_extensions_of_these_sources(sources: Path) -> None:
    """Another Python, which has no compiler, must not take the kernel away from those that share the checkout."""
    folder = sources / "cadtof_cli" / "resolver" / "two_path"
    built = ["_kernel.abi3.so", "_likelihood.abi3.so"]
    assert build_in_checkout(sources, needed_program("cc")) == built
    (folder / "_kernel.cpython-313t-x86_64-linux-gnu.so").touch()
    shutil.rmtree(sources / "build")
    assert build_in_checkout(sources, NO_COMPILER) == [built[0], "_kernel.cpython-313t-x86_64-linux-gnu.so", built[1]]


def test_a_build_that_fails_leaves_no_extension_of_older_sources(sources: Path) -> None:
    """The maps of such a kernel could have other bits. `build` keeps copies, which must get into neither checkout nor wheel."""
    folder = sources / "cadtof_cli" / "resolver" / "likelihood"
    assert len(build_in_checkout(sources, needed_program("cc"))) == 2
    (folder / "_likelihood_of_others.so").touch()
    edit(folder / "_starts.h")
    assert build_in_checkout(sources, NO_COMPILER) == ["_kernel.abi3.so", "_likelihood_of_others.so"]
    edit(folder.parent / "_buffers.h")
    _, compiled, _ = wheel(sources, NO_COMPILER)
    assert not compiled


def test_a_wheel_holds_no_module_of_an_older_commit(sources: Path) -> None:
    """The package `optics` would hide `optics.py`."""
    old = sources / "cadtof_cli" / "optics" / "__init__.py"
    old.parent.mkdir()
    old.touch()
    wheel(sources, NO_COMPILER)
    shutil.rmtree(old.parent)
    shutil.rmtree(sources / "wheels")
    wheel(sources, NO_COMPILER)
    (file,) = (sources / "wheels").iterdir()
    with ZipFile(file) as archive:
        names = {name for name in archive.namelist() if "optics" in name}
    assert names == {"cadtof_cli/optics.py"}


@pytest.mark.parametrize("flags", ["-Ofast", "-ffast-math", "-funsafe-math-optimizations"])
def test_flags_of_a_distribution_do_not_change_arithmetic_of_the_whole_process(sources: Path, flags: str) -> None:
    _, compiled, _ = wheel(sources, f"{needed_program('cc')} {flags}")
    code = "import ctypes, sys; small = 5e-324; [ctypes.CDLL(name) for name in sys.argv[1:]]; print(small * float('1'))"
    (file,) = (sources / "wheels").iterdir()
    with ZipFile(file) as archive:
        libraries = [archive.extract(name, sources / "libraries") for name in compiled]
    done = subprocess.run([sys.executable, "-c", code, *libraries], capture_output=True, text=True, check=True)
    assert (len(libraries), done.stdout) == (2, "5e-324\n")


@pytest.mark.parametrize(
    ("flag", "refused"),
    [
        ("-ffast-math", "the same bits only without -ffast-math"),
        ("-funsafe-math-optimizations", "the same bits only without -ffast-math"),
        ("-ffinite-math-only", "the same bits only without -ffast-math"),
        ("-fsingle-precision-constant", "not -fsingle-precision-constant"),
    ],
)
def test_nothing_is_built_with_arithmetic_that_is_not_as_written(flag: str, refused: str) -> None:
    """A wrapper of the compiler may add such a flag after those of setup.py; both modules include this header."""
    compiler = needed_program("gcc")
    assert _complaints([compiler]) == ""
    assert refused in _complaints([compiler, flag])


def _complaints(compiler: list[str]) -> str:
    """Return what the compiler says of the header that all compiled modules include."""
    header = ROOT / "cadtof_cli" / "resolver" / "_instruction_sets.h"
    command = [*compiler, "-std=c11", "-fsyntax-only", "-x", "c", str(header)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


@pytest.mark.skipif(platform.machine() not in {"x86_64", "AMD64"}, reason="names the flag of another processor")
def test_flags_of_a_wrapper_do_not_contract_products_and_sums(tmp_path: Path) -> None:
    file = tmp_path / "a.c"
    file.write_text(
        "#ifdef LISTS\n#include LISTS\n#endif\ndouble f(double a, double b, double c) { return a * b + c; }\n"
    )
    header = ROOT / "cadtof_cli" / "resolver" / "_instruction_sets.h"
    command = [needed_program("gcc"), "-O3", "-mfma", "-ffp-contract=fast", "-S", str(file), "-o", "-"]
    listing = [
        subprocess.run([*command, *more], capture_output=True, text=True, check=True).stdout
        for more in ([], [f'-DLISTS="{header}"'])
    ]
    assert ["fmadd" in text for text in listing] == [True, False]
