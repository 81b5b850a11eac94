# Sourced by the scripts in this folder. `setup EXTRAS` makes .venv in the repository, installs cadtof with these extras, and
# puts it on PATH. A second call costs nothing, because a stamp says what is installed. The versions are those of
# constraints.txt; with CADTOF_CONSTRAINTS=none, they are the newest that pyproject.toml allows.

# a user's settings of Python, of `cd` and of where pip installs: other packages would be found, `cd` would print, asserts would
# not be run, output would not be buffered as users have it, or nothing would be installed into .venv
unset "${!PYTHON@}" CDPATH
export PIP_USER=0

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv="$root/.venv"

# tests that compare compiled modules with numpy
compiled_tests=(
    tests/resolver/two_path tests/resolver/response/test_compiled_newton.py
    tests/resolver/response/test_compiled_other_pairs.py
    tests/resolver/response/test_compiled_more_harmonics.py tests/resolver/likelihood/test_compiled.py
    tests/resolver/paper/test_compiled.py tests/resolver/diffuse/test_compiled.py tests/resolver/diffuse/test_compiled_fit.py
    tests/resolver/diffuse/test_compiled_light.py tests/resolver/diffuse/test_compiled_radiosity.py
    tests/resolver/diffuse/test_tail_buffers.py
)

fail() {
    echo "$(basename "$0"): $*" >&2
    exit 1
}

find_python() {
    local candidate
    for candidate in python3 python3.15 python3.14 python3.13 python3.12 python3.11 python; do
        if command -v "$candidate" >/dev/null 2>&1 &&
            "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

# Find a compiler for the kernels: the compiler of the system, or else that of the ziglang wheel, which the command in $@
# installs. Without a compiler, numpy does the same work, with the same bits.
find_compiler() {
    local candidate
    [ -z "${CC:-}" ] || return 0
    for candidate in cc gcc clang; do
        if command -v "$candidate" >/dev/null 2>&1; then
            export CC="$candidate"
            return
        fi
    done
    if "$@" ziglang >/dev/null 2>&1; then
        export CC="$venv/bin/python -I -m ziglang cc -mcpu=baseline"
    else
        echo "$(basename "$0"): no C compiler, and no ziglang wheel either: numpy will do without" >&2
    fi
}

setup() {
    local extras="$1" python stamp wanted
    stamp="$venv/cadtof-$extras.stamp"
    local constraints=(--constraint "$root/constraints.txt")
    [ "${CADTOF_CONSTRAINTS:-}" != none ] || constraints=()
    wanted=$(find "$root/cadtof_cli" -name '*.[ch]' -print0 | sort -z |
        xargs -0 cat "$root/pyproject.toml" "$root/constraints.txt" "$root/setup.py" | cksum)${constraints[0]:-}
    # after a checkout was moved or copied, commands of its environment would run the Python and the code of the old place
    [ "$(cat "$venv/made_for" 2>/dev/null || echo "$root")" = "$root" ] || rm -rf "$venv"
    if [ "$(cat "$stamp" 2>/dev/null)" = "$wanted" ] && "$venv/bin/python" -c 'import cadtof_cli' 2>/dev/null; then
        PATH="$venv/bin:$PATH"
        return
    fi
    if uv --version >/dev/null 2>&1; then
        [ -x "$venv/bin/python" ] || uv venv --quiet --python '>=3.11' "$venv" || fail "uv could not make $venv"
        find_compiler uv pip install --quiet --python "$venv/bin/python"
        uv pip install --quiet --python "$venv/bin/python" ${constraints[@]+"${constraints[@]}"} --editable "$root$extras" || fail "uv could not install cadtof"
    else
        python=$(find_python) || fail "no Python 3.11 or newer on PATH; install one (Debian: apt install python3 python3-venv)"
        if ! "$venv/bin/python" -m pip --version >/dev/null 2>&1; then
            rm -rf "$venv"
            "$python" -m venv "$venv" >/dev/null 2>&1 ||
                fail "$python cannot make virtual environments; on Debian and Ubuntu: apt install python3-venv, or install uv"
        fi
        find_compiler "$venv/bin/python" -m pip install --quiet --disable-pip-version-check
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check ${constraints[@]+"${constraints[@]}"} --editable "$root$extras" ||
            fail "pip could not install cadtof; is a package index reachable?"
    fi
    echo "$wanted" >"$stamp"
    echo "$root" >"$venv/made_for"
    PATH="$venv/bin:$PATH"
}
