#!/bin/sh
# Sets up everything the suite needs in this clone; does nothing when it is up to date.
# Arguments name extras, large packages for few purposes: benchmark, docs, pictures,
# tables, test, view.
# PYTHON=... names the interpreter, else the first of Python 3.11 to 3.14 found is taken.
root=$(cd "$(dirname "$0")/.." && pwd)

supported() {
    "$1" -c 'import sys; sys.exit(sys.implementation.name != "cpython" or
             not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null
}

find_python() {
    # The environment that is already there first, unless a ROS installation brings its own Python.
    [ -z "$ROS_DISTRO" ] && supported "$root/.venv/bin/python" && {
        echo "$root/.venv/bin/python"
        return
    }
    for name in python3 python3.12 python3.13 python3.11 python3.14 \
        "$HOME"/.pyenv/versions/*/bin/python3; do
        path=$(command -v "$name") && supported "$path" && echo "$path" && return
    done
    return 1
}

if [ -n "$PYTHON" ]; then
    if ! command -v "$PYTHON" >/dev/null; then
        echo "error: PYTHON=$PYTHON is not a program; name a Python 3.11 to 3.14" >&2
        exit 1
    elif ! supported "$PYTHON"; then
        echo "error: PYTHON=$PYTHON is $("$PYTHON" --version 2>&1);" \
            "CPython 3.11 to 3.14 is needed" >&2
        exit 1
    fi
    python=$PYTHON
elif ! python=$(find_python); then
    found=$(python3 --version 2>/dev/null)
    echo "error: CPython 3.11 to 3.14 is needed, found ${found:-no python3};" \
        "install python3 python3-venv python3-dev (Debian, Ubuntu)," \
        "or name an interpreter: make PYTHON=/path/to/python3" >&2
    exit 1
fi

exec "$python" "$root/scripts/setup" "$@"
