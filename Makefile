# Everything runs in .venv, which `make setup` builds from constraints.txt.
PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed
STAMP := .venv/.set-up

.PHONY: setup desk thesis studies test lint docs fuzz clean

setup: $(STAMP)

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "$(PYTHON) is Python " \
	  + sys.version.split()[0] + "; 3.11 or newer is needed, as in: make PYTHON=python3.12 setup")'
	@echo "Setting up .venv, once: installing takes a minute or two."
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

$(STAMP): $(INSTALLED)
	@echo "Compiling the kernels takes two to six minutes; then the font cache is built."
	$(BIN)/python -m registration.warm
	$(BIN)/python -c 'import matplotlib.font_manager'
	touch $@

desk: setup
	$(BIN)/run-experiment configs/desk.yaml

thesis: setup
	$(BIN)/run-experiment configs/thesis.yaml

# Each goes on where it stopped when the same is said again.
STUDIES := sensitivity sensitivity_sobol overlap noise step_profiles leaderboard

studies: setup
	@for study in $(STUDIES); do $(BIN)/run-experiment configs/$$study.yaml || exit 1; done

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Compiling takes one core for minutes: what needs no kernels runs beside it.
test:
	@$(MAKE) --no-print-directory --jobs=2 lint setup
	$(BIN)/pytest -n auto

# The .3dx reader against 25,000 damaged files: under a minute.
fuzz: setup
	$(BIN)/python benchmarks/fuzz_threedx.py

# The documentation as a site that is read from disk: site/index.html.
docs: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	$(BIN)/mkdocs build --strict --quiet --no-directory-urls

clean:
	rm -rf .venv site .pytest_cache .mypy_cache .ruff_cache
	find results -mindepth 1 -maxdepth 1 -type d ! -name reference -exec rm -rf {} +
