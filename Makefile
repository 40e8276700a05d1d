# Two commands do everything: `make demo` runs a survey on real elevations and a drive in images, `make test` runs the tests.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Every process would compile all modules again where the environment forbids stored bytecode.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test test-long test-walkthroughs test-exhaustive test-pythons wheel-check lint types imports check results results-check docs

# The demo needs the packages of firnline alone, not those of its tests; an environment of the tests serves as well.
demo: $(if $(wildcard $(VENV)/.ready),$(VENV)/.ready,$(VENV)/.demo)
	@echo "1 of 2: a survey of real elevations, about half a minute; the first run on a machine compiles some 20 s more."
	$(BIN)/firnline run examples/srtm_ridge.toml
	@echo "2 of 2: a drive seen by the camera of the rover, about a minute and a half."
	$(BIN)/firnline run examples/short_drive.toml
	@echo "Open these pages in a browser:"
	@ls -1 results/runs/srtm-ridge/latest/*report/index.html results/runs/short-drive/latest/*report/index.html

test: $(VENV)/.ready
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MPLBACKEND=Agg $(BIN)/python -m pytest -q -n auto --dist loadfile

# Tests of several seconds each: complete missions in images, killed processes and clusters, lossy links.
test-long: $(VENV)/.ready
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MPLBACKEND=Agg $(BIN)/python -m pytest -q -n auto --dist worksteal -m "long and not exhaustive"

# What users do: every command of the pages, the scripts of examples/, first days with the wheel, the desk in a browser.
test-walkthroughs: $(VENV)/.ready
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MPLBACKEND=Agg $(BIN)/python -m pytest -q -n auto --dist worksteal -m "walkthrough and not exhaustive"

# Hundreds of random sites, every command killed, many kills: claims that `make test` holds on fewer cases; the pictures of the
# documentation; the tests of tests/exhaustive.txt. Not part of the gate: run them before a release.
test-exhaustive: $(VENV)/.ready
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MPLBACKEND=Agg $(BIN)/python -m pytest -q -n auto --dist loadfile -m exhaustive

# Every Python of the machine: the wheel, a smoke set of tests, both demos.
test-pythons:
	.ci/pythons.sh

# The wheel in a clean environment away from the source: a demo, and the first day of three users.
wheel-check: $(VENV)/.ready
	PYTHON=$(PYTHON) .ci/wheel.sh

lint: $(VENV)/.ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/vulture
	$(BIN)/codespell firnline survey planners vision_slam sim live desk papers tests benchmarks docs README.md
	.ci/page.sh

types: $(VENV)/.ready
	$(BIN)/mypy

imports: $(VENV)/.ready
	$(BIN)/lint-imports

# Which stored tables and figures are not of today's code, within a minute.
results-check: $(VENV)/.ready
	$(BIN)/python -m benchmarks.stored check

# The same, and the page of results written again.
results: $(VENV)/.ready
	$(BIN)/python -m benchmarks.results_page

check: lint types imports test test-long test-walkthroughs

# Builds the pages with all figures and notebooks (NOTEBOOKS=short: without running the longest of them); open
# docs/_build/html/index.html. No network is used once the packages are there.
docs: $(VENV)/.docs
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 NOTEBOOKS=$(NOTEBOOKS) $(BIN)/python -m sphinx -b html -W --keep-going -q docs docs/_build/html
	$(BIN)/python -m docs.check_links docs/_build/html

# uv installs in seconds what takes pip two minutes; where it cannot, or finds no package index, pip does the work. It is given
# the index of pip's settings, which it does not read. Modules are compiled where they are first imported: a quarter ever are.
packages = --constraint constraints.txt --editable
pip = $(BIN)/python -m pip --quiet --disable-pip-version-check
index = $$($(pip) config list | sed -n "s/^.*\.index.url='\(.*\)'$$/\1/p" | tail -n 1)
install = { $(pip) install --constraint constraints.txt uv && \
	index=$(index) && env $${index:+UV_DEFAULT_INDEX="$$index"} $(BIN)/uv pip install --quiet --python $(BIN)/python $(packages) '$(PACKAGES)'; } || \
	$(pip) install --no-compile $(packages) '$(PACKAGES)'

# Rebuilt when the requirements change; an incomplete one has no .ready or .demo and is rebuilt.
$(VENV)/.demo: PACKAGES := .
$(VENV)/.ready: PACKAGES := .[dev]
$(VENV)/.demo $(VENV)/.ready: pyproject.toml constraints.txt
	@echo "Installing packages into $(VENV), once: half a minute, or up to three."
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("firnline needs Python 3.11 or newer; set PYTHON=...")'
	$(PYTHON) -m venv --clear $(VENV)
	@$(install)
	touch $@

$(VENV)/.docs: PACKAGES := .[dev,docs]
$(VENV)/.docs: $(VENV)/.ready
	@$(install)
	touch $@
