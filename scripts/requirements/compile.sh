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
cat requirements.txt requirements-{ros,dev,test,docs,tables,pictures,view,benchmark}.txt > "$all"
compile "$all" "$@" scripts/requirements/{runtime,ros,dev,test,docs,tables,pictures,view,benchmark}.in
compile requirements.txt --constraints "$all" scripts/requirements/runtime.in
for part in ros dev test docs tables pictures view benchmark; do
    compile "requirements-$part.txt" --constraints "$all" "scripts/requirements/$part.in"
done
# Only what has to differ from the others differs: their pins are preferred.
cp "$all" "$apt"
compile "$apt" "$@" scripts/requirements/apt.in
compile requirements-apt.txt --constraints "$apt" scripts/requirements/apt.in
