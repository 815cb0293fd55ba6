# Everything runs in .venv, which the first target that needs it makes.
PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3.13 || \
	command -v python3.14 || echo python3)
# Tuning seeds; a table to be published takes new ones, see docs/results/seeds.md.
SEEDS ?= 0:20
# Processes of the tests, episodes at a time of an evaluation.
JOBS ?= 2
# More arguments for the target's command, for example: make demo ARGS=--meshcat
ARGS ?=

BIN := .venv/bin
INSTALLED := .venv/.installed
# With what tests, lint and training need besides.
DEVELOPING := .venv/.developing

.DEFAULT_GOAL := help
.PHONY: help demo test lint pytest docs replays recordings bench evaluate clean

help:
	@echo "make demo       a robot opens a drawer and perceives its joint (ARGS=--meshcat: live)"
	@echo "make test       lint, types and tests"
	@echo "make lint       ruff, imports between rooms, and mypy"
	@echo "make pytest     tests only (ARGS=tests/systems/vision: some of them)"
	@echo "make docs       the guide with the reference, as pages in docs/_build; minutes"
	@echo "make replays    what perception makes of tests/recordings, written anew after a change"
	@echo "make recordings the same, the recordings simulated anew before"
	@echo "make bench      time per tick, real-time factor, joint filters, episodes per hour"
	@echo "make evaluate   all experiments over SEEDS=$(SEEDS) with JOBS=$(JOBS), beside the paper"

# The stamps are written last, so that an interrupted installation starts again.
$(INSTALLED): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed, not " + sys.version)'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(DEVELOPING): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

demo: $(INSTALLED)
	$(BIN)/crossmodal run drawer --out runs/demo --force $(ARGS)

test: lint pytest

lint: $(DEVELOPING)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy

# Processes that each take all cores for small matrices would wait for each other.
pytest: export OMP_NUM_THREADS = 1
pytest: export OPENBLAS_NUM_THREADS = 1
pytest: $(DEVELOPING)
	$(BIN)/python -m pytest --numprocesses $(JOBS) --dist loadfile $(ARGS)

# Fails where a link leads nowhere.
docs: $(DEVELOPING)
	$(BIN)/python -m sphinx -b html -W --keep-going -q docs docs/_build
	@echo docs/_build/index.html

# Only perceives; nothing is simulated.
replays: $(DEVELOPING)
	$(BIN)/python -m tests.recordings.write

recordings: $(DEVELOPING)
	$(BIN)/python -m tests.recordings.write --simulate

bench: $(INSTALLED)
	$(BIN)/python -m benchmarks.episode
	$(BIN)/python -m benchmarks.episode --scenario flap
	$(BIN)/python -m benchmarks.servoing
	$(BIN)/python -m benchmarks.joint_filters $(ARGS)
	$(BIN)/python -m benchmarks.joint_robustness
	$(BIN)/python -m benchmarks.joint_robustness --plain
	$(BIN)/python -m benchmarks.real_tracks
	$(BIN)/python -m benchmarks.many_bodies
	$(BIN)/python -m benchmarks.pose_planners

evaluate: $(INSTALLED)
	$(BIN)/crossmodal evaluate all --seeds $(SEEDS) --jobs $(JOBS) $(ARGS)

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache crossmodal.egg-info
