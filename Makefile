# `make plan` and `make test` do all of their own set-up in .venv, with Python 3.11 or later and nothing else.
PYTHON ?= python3
VENV ?= .venv
OLDEST ?= .oldest-venv
BIN := $(VENV)/bin

.PHONY: plan test slow campaign mutants figures times lint docs docs-check minimum wheel clean

plan: $(VENV)/.installed
	$(BIN)/ensemble-plan configs/five_obstacles.yaml

test: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not slow"

slow: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n auto --dist worksteal -m "slow or hypothesis" --hypothesis-profile=all

campaign: slow
	$(BIN)/python -m tests.campaign.run --out tests/campaign/result.json --page docs/proof_campaign.md
	$(BIN)/python -m tests.campaign.features.run --cases 4000
	$(BIN)/python -m tests.campaign.loops.run
	$(BIN)/python -m tests.campaign.systems.run
	$(BIN)/python -m tests.campaign.systems.twins

mutants: $(VENV)/.installed-dev
	$(BIN)/python -m tests.campaign.mutate --out tests/campaign/mutants.json --page docs/proof_campaign.md

figures: $(VENV)/.installed-dev
	$(BIN)/python docs/make_gallery.py
	$(BIN)/python docs/make_tables.py
	$(BIN)/python docs/make_figures.py
	$(BIN)/python docs/make_pictures.py

times: $(VENV)/.installed-dev
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/run.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/online.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/maps.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/proofs.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/scaling.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/replay.py --many 1e6 1e7 1e8
	$(BIN)/python -m benchmarks.finding.run --record
	$(BIN)/python docs/make_tables.py --write

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -W -b html docs docs/_build

docs-check: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -q -W --keep-going -b html -D nb_execution_mode=off docs docs/_build/check
	$(BIN)/python docs/try_site.py docs/_build/check

minimum: $(OLDEST)/.installed
	$(OLDEST)/bin/ensemble-plan --help > /dev/null
	$(OLDEST)/bin/ensemble-plan run --help > /dev/null
	$(OLDEST)/bin/ensemble-plan configs/five_obstacles.yaml --quiet --overwrite -o $(OLDEST)/plan
	$(OLDEST)/bin/ensemble-plan plot $(OLDEST)/plan trajectories

$(VENV)/.created:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or later is needed")'
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.installed: pyproject.toml $(VENV)/.created
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.installed-dev: pyproject.toml $(VENV)/.created
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@ $(VENV)/.installed

$(VENV)/.installed-docs: pyproject.toml $(VENV)/.created
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

$(OLDEST)/.installed: pyproject.toml .ci/minimum.txt
	$(PYTHON) -m venv --clear $(OLDEST)
	$(OLDEST)/bin/python -m pip install --quiet --constraint .ci/minimum.txt .
	touch $@

# built, installed outside of the repository, used
wheel:
	$(PYTHON) packaging/try_wheel.py

clean:
	rm -rf $(VENV) $(OLDEST) docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis
