# Two commands do everything on a machine that has Python 3.11 or newer:
#   make search    set up, then the main job: compare deciders on live searches, write a report
#   make test      set up, then lint, types, import contracts, and all tests
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# More for `activetouch compare`, e.g. make search ARGS="--episodes 1000"
ARGS ?=
# More for `pip install`, e.g. where the CPU build of torch comes from (see the README)
PIP_ARGS ?=

export HF_HUB_OFFLINE := 1

.PHONY: search test check environment sensor figures clean

search: environment
	$(BIN)/activetouch compare $(ARGS)

test: check
	$(BIN)/pytest -n 2 --dist loadfile

check: environment
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

environment: $(VENV)/ready

$(VENV)/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11))" || \
		{ echo "Python 3.11 or newer is needed; say which: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt $(PIP_ARGS) -e ".[dev]"
	@touch $@

# The shipped sensor from nothing: touches, classifier, observation model (about 40 minutes on two cores).
sensor: environment
	$(BIN)/activetouch collect --out data/gel
	$(BIN)/activetouch train --data data/gel --out runs/train
	$(BIN)/activetouch calibrate --data data/gel --classifier runs/train/classifier.safetensors \
		--out activetouch/models/gel

# The README's figure: one of the default comparison's searches.
figures: search
	$(BIN)/activetouch replay --target cone --number 121 --out docs/search.png

clean:
	rm -rf $(VENV) runs build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis *.egg-info
