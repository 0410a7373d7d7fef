# make demo: set up what the main job needs and run it.  make test: set up everything and pass the tests.
# make test-fast: the tests that need neither the simulator nor training.
# make docs: build the documentation into site/; a warning is an error.
.PHONY: setup setup-demo demo test test-fast lint docs clean
VENV := .venv/bin
export HF_HUB_OFFLINE ?= 1
export PYTHONUTF8 ?= 1
export NO_MKDOCS_2_WARNING = 1

setup:
	@bash scripts/setup.sh dev

setup-demo:
	@bash scripts/setup.sh demo

demo: setup-demo
	@$(VENV)/python scripts/demo.py

test: setup
	@$(VENV)/python -m ruff check .
	@$(VENV)/python -m ruff format --check --quiet .
	@$(VENV)/lint-imports
	@$(VENV)/python -m mypy
	@$(VENV)/python benchmarks/results_page.py --check
	@$(VENV)/python -m pytest -n 2 --dist loadfile

test-fast: setup
	@$(VENV)/python -m pytest -n 2 --dist loadfile -m "not sim and not slow"

lint: setup
	$(VENV)/python -m ruff check .
	$(VENV)/python -m ruff format --check .
	$(VENV)/lint-imports
	$(VENV)/python -m mypy

docs: setup
	@$(VENV)/python -m mkdocs build --strict

clean:
	rm -rf demo_out site .pytest_cache .mypy_cache .ruff_cache
