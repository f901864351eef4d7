# Needs Python 3.11-3.13 and pip. `make run` makes a video, `make test` checks everything.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test lint fuzz bench clean

run: $(VENV)/.installed
	$(BIN)/sandbox run jelly

test: $(VENV)/.installed-dev
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# `make fuzz COUNT=20000 KINDS="scenes meshes"`, or for a time each: `make fuzz COUNT=1000000 SECONDS=600`.
COUNT = 2000
SECONDS = inf
fuzz: $(VENV)/.installed-dev
	$(BIN)/python -m tests.fuzz --count $(COUNT) --seconds $(SECONDS) $(KINDS)

bench: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/springs.py
	$(BIN)/python benchmarks/crossover.py
	$(BIN)/python benchmarks/startup.py
	$(BIN)/python benchmarks/compiling.py
	$(BIN)/python benchmarks/render_frame.py
	$(BIN)/python benchmarks/torn_frame.py
	$(BIN)/python benchmarks/renderers.py
	$(BIN)/python benchmarks/contact.py
	$(BIN)/python benchmarks/parts.py
	$(BIN)/python benchmarks/keeping.py
	$(BIN)/python benchmarks/ladder.py
	$(BIN)/python benchmarks/tune.py
	$(BIN)/python benchmarks/refinement.py

clean:
	rm -rf $(VENV) outputs

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
		|| { echo "Python 3.11, 3.12 or 3.13 is needed: make PYTHON=python3.12 ..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.installed-dev: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@ $(VENV)/.installed
