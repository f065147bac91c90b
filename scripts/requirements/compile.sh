#!/usr/bin/env bash
# Compiles scripts/requirements/*.in into the pinned requirements*.txt at the top.
# Pins that still fit are kept; with --upgrade every package moves to its newest release.
set -euo pipefail
cd "$(dirname "$0")/../.."
uv=${UV:-.venv/bin/uv}
all=$(mktemp --suffix=.txt) apt=$(mktemp --suffix=.txt)
trap 'rm -f "$all" "$apt"' EXIT

compile() { # OUTPUT ARGUMENT...
    local output=$1
    shift
    "$uv" pip compile --quiet --universal --python-version 3.11 --no-annotate \
        --custom-compile-command "scripts/requirements/compile.sh [--upgrade]" \
        --output-file "$output" "$@"
}

# All inputs are resolved together first, so that the files agree with each other.
cat requirements.txt requirements-{ros,dev,docs,view}.txt > "$all"
compile "$all" "$@" scripts/requirements/{runtime,ros,dev,docs,view}.in
compile requirements.txt --constraints "$all" scripts/requirements/runtime.in
compile requirements-ros.txt --constraints "$all" scripts/requirements/ros.in
compile requirements-dev.txt --constraints "$all" scripts/requirements/dev.in
compile requirements-view.txt --constraints "$all" scripts/requirements/view.in
compile requirements-docs.txt --constraints "$all" scripts/requirements/docs.in
# Only what has to differ from the others differs: their pins are preferred.
cp "$all" "$apt"
compile "$apt" "$@" scripts/requirements/apt.in
compile requirements-apt.txt --constraints "$apt" scripts/requirements/apt.in
