#!/usr/bin/env bash
# Try firnline on every Python that can be had: install the wheel, run a smoke set of tests and both demos.
# Pythons are those of PATH and of pyenv; name others as arguments: .ci/pythons.sh /opt/python3.14/bin/python3
set -euo pipefail
cd "$(dirname "$0")/.."
root=build/pythons
mkdir -p "$root"

interpreters() {
    for minor in 11 12 13 14; do
        local found=""
        found=$(command -v "python3.$minor" 2>/dev/null && "python3.$minor" -c "" 2>/dev/null) || found=""
        if [ -z "$found" ]; then
            found=$(ls -d "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3."$minor".*/bin/python 2>/dev/null | tail -1) || true
        fi
        if [ -n "$found" ]; then echo "$found"; else echo "python3.$minor is not on this machine: left out" >&2; fi
    done
}

try() {
    local python=$1 name
    name=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    local place="$root/$name"
    if [ ! -e "$place/.ready" ] || [ pyproject.toml -nt "$place/.ready" ]; then
        "$python" -m venv --clear "$place"
        "$place/bin/python" -m pip install --quiet --disable-pip-version-check --constraint constraints.txt . pytest pytest-timeout hypothesis
        touch "$place/.ready"
    else
        "$place/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --force-reinstall .
    fi
    # Away from the checkout: the tests and the demos see the installed wheel alone.
    rm -rf "$place/work" && mkdir -p "$place/work"
    cp -r tests benchmarks pyproject.toml examples "$place/work"
    (
        cd "$place/work"
        export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MPLBACKEND=Agg
        ../bin/python -m pytest -q -p no:cacheprovider tests/sim/vehicle tests/sim/simulate/test_simulation.py \
            tests/vision_slam/readers tests/vision_slam/test_calibrate.py
        for demo in srtm_ridge short_drive; do ../bin/firnline run "examples/$demo.toml" --quiet; done
    )
    echo "Python $name: tests and demos pass"
}

if [ $# -gt 0 ]; then pythons=("$@"); else mapfile -t pythons < <(interpreters); fi
for python in "${pythons[@]}"; do try "$python"; done
