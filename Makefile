.DEFAULT_GOAL := help
PYTHON ?= python3
BIN := .venv/bin
DATA ?= $(or $(BUNRAKU_DATA),../shared/data)
TEST_WORKERS ?= 2

help: ## list these targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

.venv/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

install: .venv/.installed ## make .venv and install the package with its tools

demo: install ## animate the built-in figures; results in demo/
	$(BIN)/bunraku demo -o demo

test: install ## run the tests
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -n $(TEST_WORKERS) --dist loadfile

lint: install ## format check, lint, types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

format: install ## put every file in the project's format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

evaluate: install ## the paper's tables on the evaluation data (DATA=folder)
	$(BIN)/bunraku evaluate weights --data $(DATA)/weights
	$(BIN)/bunraku evaluate retarget --data $(DATA)

dist: install ## build the wheel, install it into an empty environment, run the demo from there
	rm -rf dist
	$(BIN)/python -m build --wheel --outdir dist . > /dev/null
	$(BIN)/python scripts/check_wheel.py dist/*.whl

docs: install ## build the documentation into site/; it asks the network for nothing
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet --site-dir site

bench: install ## how the cost of each stage grows
	$(BIN)/python bench/stages.py

fuzz: install ## search for files that break a reader: FUZZ_COUNT mutants a format, FUZZ_SECONDS by coverage
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.fuzz.run --count $(or $(FUZZ_COUNT),100000) --workers $(TEST_WORKERS)
	BUNRAKU_FUZZ_SECONDS=$(or $(FUZZ_SECONDS),600) $(BIN)/python -m pytest -q -n $(TEST_WORKERS) tests/fuzz/test_coverage.py

.PHONY: help install demo test lint format evaluate dist docs bench fuzz
