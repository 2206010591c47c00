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

.PHONY: search test check environment rigid-body development sensor policies figures reproduce clean

search: environment
	$(BIN)/activetouch compare $(ARGS)

test: check
	$(BIN)/pytest -n 2 --dist loadfile

check: development
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# What searches need, and what training and tests need beside it, in the same folder. Without --no-compile, pip writes
# 100 MB of bytecode, most of it never used; the first start writes what is.
environment: $(VENV)/ready
development: $(VENV)/ready-dev

INSTALL = $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt $(PIP_ARGS) -e

$(VENV)/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11))" || \
		{ echo "Python 3.11 or newer is needed; say which: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) . --no-compile
	@$(BIN)/activetouch compare --help > /dev/null
	@touch $@

$(VENV)/ready-dev: $(VENV)/ready
	$(INSTALL) ".[dev]"
	@touch $@

# The shipped sensor of a scene from nothing: touches, classifier, observation model; make sensor SCENE=coarse for another
# (ten to fifteen minutes on two cores).
SCENE ?= gel
COLLECT.paper := --plan.train 1500
COLLECT.coarse := --plan.train 13500
COLLECT.hard := --plan.train 1200 --plan.calibration 250 --plan.test 250
COLLECT.many := $(COLLECT.hard)
REPEATS.hard := --plan.calibration 100 --plan.test 100
REPEATS.many := --plan.calibration 100 --plan.test 150
CNN := --recipe large --change.batch-size 128 --change.learning-rate 2e-3
TRAIN.gel := $(CNN)
TRAIN.coarse := $(CNN) --change.epochs 12
TRAIN.hard := $(CNN) --change.epochs 24
TRAIN.many := $(TRAIN.hard)
TRAIN.paper := --recipe large --change.batch-size 128 --change.epochs 6
sensor: development
	$(BIN)/activetouch collect --scene $(SCENE) $(COLLECT.$(SCENE))
	$(BIN)/activetouch train --scene $(SCENE) $(TRAIN.$(SCENE))
	$(BIN)/activetouch collect --scene $(SCENE) --plan.train 0 --plan.repeats 6 $(REPEATS.$(SCENE)) --out data/$(SCENE)-repeats
	$(BIN)/activetouch calibrate --scene $(SCENE) --out activetouch/models/$(SCENE)

# The sensor of a scene whose belief is about one rigid body (docs/perception.md); part of the package for coarse.
rigid-body: development
	$(BIN)/activetouch collect --scene $(SCENE) $(COLLECT.$(SCENE))
	$(BIN)/activetouch train --scene $(SCENE) --data data/$(SCENE) --out runs/train-$(SCENE)-rigid-body
	$(BIN)/activetouch collect --scene $(SCENE) --plan.train 0 --plan.repeats 6 $(REPEATS.$(SCENE)) --out data/$(SCENE)-repeats
	$(BIN)/activetouch calibrate --scene $(SCENE) --reader runs/train-$(SCENE)-rigid-body/reader.safetensors \
		--observation-model ratio "rigid body" --out activetouch/models/$(SCENE)-rigid-body

# Its PPO policies, from the same repeated touches; those that come with the package are of paper, coarse and gel.
PPO.gel := --change.steps 120000
policies: development
	$(BIN)/activetouch touch-bank --scene $(SCENE)
	$(BIN)/activetouch train-ppo --scene $(SCENE) $(PPO.$(SCENE))
	mkdir -p activetouch/models/$(SCENE)/policies
	cp runs/ppo-$(SCENE)/policies/* activetouch/models/$(SCENE)/policies/

# The README's figure is one of the default comparison's searches.
figures: search
	$(BIN)/activetouch replay --target cone --number 121 --out docs/search.png
	$(BIN)/activetouch gallery --out docs/gallery.png

# The paper's tables and figures beside ours; make reproduce ARGS="--parts table2 figure3", or ARGS=--from-nothing.
reproduce: development
	$(BIN)/activetouch reproduce $(ARGS)

clean:
	rm -rf $(VENV) runs build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis *.egg-info
