# make demo: the main job; make test: the tests. Both set up .venv with all they need first.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test validate bench lint tables figures clean

.venv/.run: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install -q --disable-pip-version-check -e .
	touch $@

# no more than a look where the sources have not changed; without a compiler everything works with beads
.venv/.plugin: .venv/.run $(wildcard cgfibre/plugin/*.cpp cgfibre/plugin/*.h)
	$(BIN)/python -m cgfibre plugin build --optional
	touch $@

.venv/.dev: .venv/.plugin
	$(BIN)/python -m pip install -q --disable-pip-version-check -e '.[dev]'
	touch $@

demo: .venv/.plugin
	$(BIN)/cgfibre run carbon-37 --out results/carbon-37 --force

# files of tests on two cores side by side
test: .venv/.dev
	$(BIN)/python -m pytest -q -n 2 --dist loadfile

validate: .venv/.dev
	$(BIN)/python -m pytest -q -m validate

bench: .venv/.dev
	$(BIN)/python analysis/bench_build.py
	$(BIN)/python analysis/bench_run.py

lint: .venv/.dev
	$(BIN)/python -m ruff check .
	$(BIN)/python -m mypy

tables: .venv/.dev
	$(BIN)/python analysis/verification.py

figures: .venv/.dev
	$(BIN)/python analysis/readme_figures.py

clean:
	rm -rf .venv results dist cgfibre/plugin/lib
