# Sourced by scripts/demo, scripts/test and .ci/run: sets $root and $python, and defines ready.
#
# .venv/.installed is written last and says what .venv holds: for which folder, from which
# pyproject.toml and pins, with which extra. Where it is missing an install was cut short, and
# since there is no telling what is missing then, .venv is built again from nothing.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
python=$root/.venv/bin/python

say() { printf '%s\n' "$*" >&2; }

# Prints the first Python that is new enough and can make virtual environments.
find_python() {
    # python3.11 is first because the pins were resolved for it.
    local candidate candidates=(python3.11 python3.12 python3.13 python3.14 python3)
    [ -z "${PYTHON:-}" ] || candidates=("$PYTHON")
    for candidate in "${candidates[@]}"; do
        if "$candidate" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            printf '%s\n' "$candidate"
            return
        fi
    done
    say "error: no Python 3.11 or newer with venv (tried: ${candidates[*]})."
    say "Install one (Debian, Ubuntu: apt-get install python3 python3-venv) or name one: PYTHON=/path/to/python3.11 $0"
    return 1
}

pip_install() {
    PIP_DISABLE_PIP_VERSION_CHECK=1 "$python" -m pip install -qq \
        --constraint "$root/scripts/constraints.txt" "$@"
}

# ready [EXTRA]: makes $python one that has the project and its dependencies, and those of EXTRA.
ready() {
    local extra=${1:-} stamp=$root/.venv/.installed base sum old_root='' old_sum='' old_extra=''
    sum=$(cat "$root/pyproject.toml" "$root/scripts/constraints.txt" | cksum)

    # Of two scripts started at once, one builds .venv and the other waits.
    exec 9<"$root/scripts/environment.sh"
    ! command -v flock >/dev/null || flock 9

    # A .venv whose Python was removed, or that was copied from another folder, counts as none.
    if [ -f "$stamp" ] && "$python" -c '' 2>/dev/null; then
        { read -r old_root && read -r old_sum && read -r old_extra; } <"$stamp" || true
    fi
    if [ "$old_root" != "$root" ]; then
        base=$(find_python) || return
        say "Making .venv with $("$base" --version)${extra:+, with the $extra extra}: about a minute, once ..."
        rm -rf "$root/.venv"
        "$base" -m venv "$root/.venv" || return
    elif [ "$old_sum" != "$sum" ] || { [ -n "$extra" ] && [ "$old_extra" != "$extra" ]; }; then
        say "Bringing .venv up to date${extra:+, with the $extra extra} ..."
        rm -f "$stamp"
    else
        exec 9<&-
        return
    fi
    # The build backend comes first and by itself, so that it too is the pinned one.
    pip_install hatchling || return
    pip_install --no-build-isolation --editable "$root${extra:+[$extra]}" || return
    printf '%s\n' "$root" "$sum" "$extra" >"$stamp"
    exec 9<&-
}
