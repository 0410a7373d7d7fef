# make demo: set up and run the main job.  make test: set up and pass the tests.
.PHONY: setup demo test lint clean
VENV := .venv/bin
export HF_HUB_OFFLINE ?= 1

setup:
	@bash scripts/setup.sh

demo: setup
	@$(VENV)/python scripts/demo.py

test: setup
	@$(VENV)/python -m ruff check .
	@$(VENV)/python -m mypy
	@$(VENV)/python -m pytest -n 2 --dist loadfile

lint: setup
	$(VENV)/python -m ruff check .
	$(VENV)/python -m mypy

clean:
	rm -rf demo_out .pytest_cache .mypy_cache .ruff_cache
