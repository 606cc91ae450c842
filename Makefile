# Everything that sets up, runs and checks the project. On a fresh machine each target sets up what it needs first.
PYTHON ?= python3
VENV ?= .venv
TASK ?= picking_up_trash
# One process of tests a core, of about 1.7 GB each. Each computes with one thread, so that they do not wait for one another.
TEST_WORKERS ?= auto
bin := $(VENV)/bin
run_tests = OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(bin)/pytest --numprocesses $(TEST_WORKERS) --maxprocesses 8 --dist worksteal
pip_install = $(bin)/python -m pip install --quiet --constraint constraints.txt

.PHONY: help demo setup setup-test system test test-all check lint format types pytest pytest-all quick docs results editor docs-links setup-docs clean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1 @ /p' Makefile | column -t -s @

demo: setup  ## set up the core and run one episode
	$(bin)/mpvi run $(TASK)

test: setup-test  ## set up everything, with torch and ManiSkill, and run every check, and every test but the rare ones
	@$(MAKE) --no-print-directory check

test-all: setup-test  ## the same with the rare tests: what CI runs
	@$(MAKE) --no-print-directory lint types pytest-all

setup: system $(VENV)/.core  ## system packages, virtual environment, core dependencies

setup-test: system $(VENV)/.test  ## the same with the extras: torch, ManiSkill, test tools

check: lint types pytest  ## ruff, mypy, pytest in the environment that is there

lint:
	$(bin)/ruff check .
	$(bin)/ruff format --check .

format:  ## rewrite the code in the project's format
	$(bin)/ruff check --fix .
	$(bin)/ruff format .

types:
	$(bin)/mypy

pytest:  ## all tests but the rare ones
	$(run_tests) -m "not rare"

pytest-all:  ## all tests
	$(run_tests)

quick:  ## tests without the slow ones
	$(run_tests) -m "not slow and not rare"

docs: setup-docs  ## build the site in docs/_build/html; a warning, such as a dead link, is an error
	$(bin)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

results:  ## write the tables of measurements into docs/, from benchmarks/results/
	$(bin)/python -m benchmarks.tables

editor:  ## bundle CodeMirror for the page of `mpvi edit` anew (needs npm and a network; the bundle is committed)
	cd scripts/editor && npm ci --ignore-scripts --no-audit --no-fund && node build.mjs

docs-links: setup-docs  ## ask every address on the pages whether it is still there (needs a network)
	$(bin)/sphinx-build -q -b linkcheck docs docs/_build/links

setup-docs: system $(VENV)/.docs

clean:  ## remove the virtual environment and caches
	rm -rf $(VENV) docs/_build .mypy_cache .pytest_cache .ruff_cache .numba_cache

system:
	@PYTHON=$(PYTHON) scripts/system-packages.sh

$(bin)/python: | system
	$(PYTHON) -m venv $(VENV)
	@$(bin)/python -m pip install --quiet --upgrade pip

$(VENV)/.core: pyproject.toml constraints.txt | $(bin)/python
	@echo "set-up: installing the core into $(VENV) (1.1 GB)"
	$(pip_install) --editable .
	@touch $@

$(VENV)/.test: pyproject.toml constraints.txt | $(bin)/python
	@echo "set-up: installing everything into $(VENV) (3.3 GB)"
	$(pip_install) --editable '.[dev]'
	@touch $(VENV)/.core $@

$(VENV)/.docs: pyproject.toml constraints.txt | $(VENV)/.core
	@echo "set-up: installing Sphinx into $(VENV) (80 MB)"
	$(pip_install) --editable '.[docs]'
	@touch $@
