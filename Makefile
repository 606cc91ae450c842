# Everything that sets up, runs and checks the project. On a fresh machine each target sets up what it needs first.
PYTHON ?= python3
VENV ?= .venv
TASK ?= picking_up_trash
bin := $(VENV)/bin
pip_install = $(bin)/python -m pip install --quiet --constraint constraints.txt

.PHONY: help demo setup setup-test system test check lint format types pytest quick clean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1 @ /p' Makefile | column -t -s @

demo: setup  ## set up the core and run one episode
	$(bin)/mpvi run $(TASK)

test: setup-test  ## set up everything, with torch and ManiSkill, and run every check and test
	@$(MAKE) --no-print-directory check

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

pytest:
	$(bin)/pytest

quick:  ## tests without the slow ones
	$(bin)/pytest -m "not slow"

clean:  ## remove the virtual environment and caches
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .numba_cache

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
