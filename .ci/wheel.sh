#!/usr/bin/env bash
# Build the wheel, install it into a clean environment away from the source, and run what a new user runs first: a
# demo, and the tests of the first day of a glaciologist, a roboticist and a surveyor (tests/first_day).
set -euo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
source=$PWD
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT

"$python" -m venv "$place/venv"
"$place/venv/bin/python" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$place" "$source"
"$place/venv/bin/python" -m pip install --quiet --disable-pip-version-check --constraint constraints.txt "$place"/firnline-*.whl
mkdir "$place/work"
cd "$place/work"
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MPLBACKEND=Agg PYTHONSAFEPATH=1
unset PYTHONPATH
firnline="$place/venv/bin/firnline"
"$firnline" --version
"$firnline" doctor > doctor.txt || { cat doctor.txt; exit 1; }
"$firnline" example
"$firnline" examples srtm-ridge
"$firnline" example two-summers.ipynb
"$firnline" example two-summers
"$place/venv/bin/python" two_summers.py > /dev/null
"$firnline" run srtm_ridge.toml --quiet
run=results/runs/srtm-ridge/latest
"$firnline" show "$run" > /dev/null
"$firnline" schema mission > mission.schema.json
"$firnline" init mine.toml
"$firnline" plan mine.toml --quiet
"$firnline" score "$run/4-reconstruct" --truth "$run/2-simulate/truth/dem.tif" --by slope --report accuracy --quiet
test -s accuracy/index.html && test -s accuracy/report.pdf

# These tests start the command of the clean environment; pytest itself runs in the development environment.
cd "$source"
env -u PYTHONSAFEPATH FIRNLINE_COMMAND="$firnline" "${TEST_PYTHON:-.venv/bin/python}" -m pytest -q -p no:cacheprovider -m walkthrough tests/first_day
echo "the wheel works away from its source"
