# Everything from a clone, Python and make. Each target first sets up what it needs.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed
RUNTIME := $(VENV)/runtime
PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Hundreds of processes and all workers of pytest import the same files, and need not compile them each time.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-all test-required fuzz faults bench bench-check check docs package format clean

help: ## List the targets
	@sed -n 's/^\([a-z-]*\):.*## /make \1\t/p' $(MAKEFILE_LIST) | expand -t 20

setup: $(INSTALLED) ## Install everything into .venv

demo: $(RUNTIME) ## Run the main scenario: six robots identify a load
	$(BIN)/coheft run real6

test: setup ## Run the tests that a contributor runs, on all cores: some minutes
	$(PYTEST) -m "not slow"

test-all: setup ## Run all tests, also those that take long or start processes: about fifteen minutes
	$(PYTEST)

test-required: setup ## Run the tests that need a browser or a foreign package, and fail where these are missing
	$(PYTEST) --require-everything tests/integration/test_view.py tests/integration/test_ros2_bridge.py

fuzz: setup ## Test decoders with tens of thousands of malformed messages and scenarios, some minutes
	$(BIN)/python -m pytest tests/fuzz --hypothesis-profile=fuzz --timeout=0

faults: setup ## Inject faults into 500 simulated runs, and check that the promises are kept
	$(BIN)/coheft faults --seeds 500

bench: setup ## Run the benchmarks, some minutes; tables in build/bench
	$(BIN)/python -m benchmarks --to build/bench

bench-check: setup ## Compare the benchmarks with the committed ratios, some minutes
	$(BIN)/python -m benchmarks.check

check: setup ## Check format, lint and types
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy

docs: setup ## Build the site of the documentation, build/docs/index.html
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet --fresh-env --write-all docs build/docs

package: setup ## Build wheel and sdist into dist, and check what is in them and that they can be installed
	rm -rf dist coheft.egg-info
	$(BIN)/python -m build --no-isolation --outdir dist .
	$(BIN)/python -m twine check --strict dist/*
	$(BIN)/python -m pytest --require-everything --package dist tests/integration/test_wheel.py

format: setup ## Format the code
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean: ## Remove all generated files
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

# Installs coheft with the extras $(1) into .venv. The stamp is written last: an installation that failed is done again.
define install
	@$(PYTHON) -c 'import sys; sys.exit("coheft needs Python 3.11 or later, but $(PYTHON) is " + sys.version.split()[0] + "; name another: make PYTHON=python3.12 $(MAKECMDGOALS)" if sys.version_info < (3, 11) else 0)'
	@echo "Installing $(2) into $(VENV), once: $(3) on a fast connection"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[$(1)]'
	@touch $@
endef

# What a run and its view need; other targets install the rest.
$(RUNTIME): pyproject.toml constraints.txt
	$(call install,view,what a run needs,half a minute)

$(INSTALLED): pyproject.toml constraints.txt
	$(call install,dev,everything,some minutes)
	@touch $(RUNTIME)
