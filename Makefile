# Everything runs in an environment of its own (.venv), made on first use and brought up to date when pyproject.toml
# or constraints.txt change. PYTHON names the interpreter that makes it; VENV says where.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet -c constraints.txt

# Tests and sweeps are parallel already: one thread a process keeps them from fighting over the cores.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: help demo test coverage slow bench blind lint dev docs clean

help:
	@echo "make demo    a robot that differs from its model: diagnosed, then driven with what was found"
	@echo "make test    the tests, without the slow ones"
	@echo "make coverage  which lines the tests reach"
	@echo "make slow    the slow tests"
	@echo "make bench   what diagnosis, MPC, learner and simulator cost, beside IPOPT, do-mpc, filterpy and dynamax where they are"
	@echo "make blind   a development sweep of the blind benchmark"
	@echo "make lint    style, types and the direction of imports"
	@echo "make dev     the tools of a contributor, and \`make lint\` before each commit"
	@echo "make docs    the documentation as a site, in build/site (with search: python3 -m http.server -d build/site)"
	@echo "make clean   removes $(VENV) and what the tools left behind"

demo: $(VENV)/.installed
	$(BIN)/python -m residual_mpc.demo

# Each worker begins with its own half of the tests, so that what a file prepares is prepared once.
test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n 2 --dist worksteal -q -m "not slow"

# Measuring which lines the tests reach takes about 40 % more time on Python 3.11. The floor is a little below what was
# measured, in % of lines.
coverage: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n 2 -q -m "not slow" --cov --cov-report= --cov-fail-under=93

slow: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n 2 -q -m slow

bench: $(VENV)/.installed-test
	$(BIN)/python -m benchmarks.diagnosis
	$(BIN)/python -m benchmarks.profile
	$(BIN)/python -m benchmarks.control
	$(BIN)/python -m benchmarks.own_arm
	$(BIN)/python -m benchmarks.learning
	$(BIN)/python -m benchmarks.jitter
	$(BIN)/python -m benchmarks.simulator

blind: $(VENV)/.installed-test
	$(BIN)/python -m benchmarks.blind

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

dev: $(VENV)/.installed-dev
	$(BIN)/pre-commit install

docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@! grep -rnoE '<(script|link|img|iframe)[^>]*(src|href)="?(https?:)?//[^ >]*' build/site --include=*.html # no foreign hosts

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .coverage .coverage.* htmlcov

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# The interpreter is an order-only prerequisite: its time stamp says nothing about what is installed.
$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) -e ".[mpc]"
	@touch $@

$(VENV)/.installed-test: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) -e ".[test]"
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) -e ".[dev]"
	@touch $@ $(VENV)/.installed-test $(VENV)/.installed

$(VENV)/.installed-docs: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) -e ".[docs]"
	@touch $@ $(VENV)/.installed
