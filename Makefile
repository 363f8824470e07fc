# make demo and make test: everything, from a machine that has Python >= 3.11 and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# The lock is complete: --no-deps keeps pip from resolving an extra (coverage[toml]) past its pin.
# Bytecode is stored when a module is first imported, for all later processes; pip would compile all modules.
export PYTHONDONTWRITEBYTECODE =

.PHONY: help demo test collect test-all lint types contract docs check bench bench-full lock clean

help:
	@echo "make demo      install, wear out a simulated axis and test it again and again: a report with pictures"
	@echo "make test      install what is locked into $(VENV) and run the tests"
	@echo "make test-all  the slow tests too: coverage of intervals, rates of false alarms, the paper's experiments"
	@echo "make check     test, lint, types, import contract, docs: what CI runs"
	@echo "make docs      build the documentation into docs/_build/html"
	@echo "make bench     benchmarks of a few minutes, printed as tables"
	@echo "make bench-full  the long benchmarks too, for hours; the pages name the commands of all tables"
	@echo "make lock      lock the dependencies anew"

$(STAMP): requirements/dev.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "ballscrew needs Python 3.11 or newer; say which one: make test PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv --clear $(VENV) || { \
	  echo "This Python has no venv; installing Debian's python3-venv."; \
	  apt-get update && apt-get install -y python3-venv && $(PYTHON) -m venv --clear $(VENV); } || \
	  { echo "No virtual environment could be made: install python3-venv, then run make again."; exit 1; }
	$(BIN)/python -m pip install --quiet --no-compile --require-hashes --no-deps -r requirements/dev.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $(STAMP)

demo: $(STAMP)
	$(BIN)/ballscrew demo
	@echo "To see a simulated plant in the browser: $(BIN)/ballscrew serve --demo"

test: $(STAMP)
	$(BIN)/python -m pytest -m "not slow" -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# pytest stores the modules that it has rewritten: the processes of the tests load them.
collect: $(STAMP)
	$(BIN)/python -m pytest -m "not slow" --collect-only -qq

test-all: $(STAMP)
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/vulture
	$(BIN)/codespell

types: $(STAMP)
	$(BIN)/mypy

contract: $(STAMP)
	$(BIN)/lint-imports

docs: $(STAMP)
	$(BIN)/sphinx-build -W --keep-going -q -b html -d docs/_build/doctrees docs docs/_build/html

check: test lint types contract docs

bench: $(STAMP)
	$(BIN)/python -m pip install --quiet --require-hashes --no-deps -r requirements/bench.txt
	$(BIN)/python -m benchmarks.spectra

bench-full: bench
	$(BIN)/python -m benchmarks.testbed
	$(BIN)/python -m benchmarks.random_axes
	$(BIN)/python -m benchmarks.finite_elements
	$(BIN)/python -m benchmarks.identification
	$(BIN)/python -m benchmarks.phase_currents
	$(BIN)/python -m benchmarks.faults
	$(BIN)/python -m benchmarks.speed
	$(BIN)/python -m benchmarks.preload
	$(BIN)/python -m benchmarks.optimal_plan
	$(BIN)/python -m benchmarks.early
	$(BIN)/python -m benchmarks.lives
	$(BIN)/python -m benchmarks.remaining_life
	$(BIN)/python -m benchmarks.forecasts

COMPILE := uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header \
  --all-extras --group test --group lint --group docs

lock:
	$(COMPILE) pyproject.toml requirements/build.in -o requirements/dev.txt
	$(COMPILE) --group bench -c requirements/dev.txt pyproject.toml requirements/build.in -o requirements/bench.txt

clean:
	rm -rf $(VENV) docs/_build docs/reference/api
