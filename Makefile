# Two commands: `make demo` and `make test`. Both make their environment from pyproject.toml when it is missing.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo test test-thorough test-arviz test-napari lint types docs data movie notebooks clean

demo: $(VENV)/.installed
	$(BIN)/yeastfit demo

test: $(VENV)/.installed-test lint types
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal -m 'not slow and not thorough and not users_compiler'

# dear tests, and those that compile as users do
test-thorough: $(VENV)/.installed-test
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal -m 'thorough and not users_compiler'
	XLA_FLAGS= $(BIN)/python -m pytest -m users_compiler $$(grep -rl --include='test_*.py' mark.users_compiler tests)

# the export with ArviZ 1.x, which Python 3.11 has not: make test-arviz PYTHON=python3.12 VENV=.venv-arviz
test-arviz: $(VENV)/.made
	$(BIN)/pip install --quiet --disable-pip-version-check --editable . 'arviz>=1' h5netcdf pytest beartype hypothesis
	$(BIN)/python -m pytest -p no:cacheprovider tests/inference/posterior/test_arviz.py

# the editor of outlines, without a window; napari and Qt take two minutes to install: make test-napari VENV=.venv-napari
test-napari: $(VENV)/.made
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[napari]' pytest beartype hypothesis
	QT_QPA_PLATFORM=offscreen $(BIN)/python -m pytest -p no:cacheprovider tests/corrections

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(VENV)/.installed-test
	$(BIN)/mypy yeastfit tests benchmarks

# the documentation site in build/docs, about a minute; then every page is looked at in a browser, where there is one
docs: $(VENV)/.installed-docs
	rm -rf build/docs docs/reference
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -c docs --doctree-dir build/doctrees . build/docs
	$(BIN)/python -m pytest -m slow tests/test_site.py

# the data sets, from their stated seeds and parameters
data: $(VENV)/.installed
	$(BIN)/yeastfit synthesize --recipe data/synthetic/recipes.toml --out data/synthetic

# the movie on the home page of the site, about a minute
movie: $(VENV)/.installed
	$(BIN)/yeastfit simulate --members 1 --time 7 --mobility 2 --movie --out out/movie --overwrite
	cp out/movie/movie.gif docs/growth.gif

# the notebooks in full size, outputs and all, about 32 minutes on two cores
notebooks: $(VENV)/.installed-test
	JUPYTER_PREFER_ENV_PATH=1 $(BIN)/jupyter-execute --inplace --kernel_name=python3 --timeout=-1 notebooks/*.ipynb

$(VENV)/.made:
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.installed: $(VENV)/.made pyproject.toml
	$(BIN)/pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.installed-test: $(VENV)/.made pyproject.toml
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test]'
	touch $@ $(VENV)/.installed

$(VENV)/.installed-docs: $(VENV)/.made pyproject.toml
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test,docs]'
	touch $@ $(VENV)/.installed $(VENV)/.installed-test

clean:
	rm -rf out build docs/reference *.egg-info .mypy_cache .ruff_cache .pytest_cache
