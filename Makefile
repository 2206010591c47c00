# Two commands do everything on a machine that has Python 3.11 or newer:
#   make search    set up, then the main job: compare deciders on live searches, write a report
#   make test      set up, then lint, types, import contracts, docs, and all tests
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# More for `activetouch compare`, e.g. make search ARGS="--episodes 1000"
ARGS ?=
# More for `pip install`, e.g. where the CPU build of torch comes from (see docs/install.md)
PIP_ARGS ?=

export HF_HUB_OFFLINE := 1

.PHONY: search test tests quick nightly check types others docs dist environment development sensor any-object places independent-sensor convnext-sensor policies joint-policies figures reproduce submissions zoo clean

search: environment
	$(BIN)/activetouch compare --scene coarse --out runs/search $(ARGS)

# Two processes of tests share the processors, so each computes on one thread.
# Types take long on one processor, so tests begin beside them.
test: development
	@$(MAKE) --no-print-directory -j2 types tests

tests: others
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

# Beliefs, statistics and decisions without touch, without physics, networks and fits: under a minute.
quick: development
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 -m "not slow and not mujoco and not torch and not nightly" tests/belief/test_*.py tests/belief/metrics tests/belief/statistics tests/planners/test_classification.py

# Every shell command of README and docs, with small sizes, and what the tests make smaller: an hour or more.
nightly: development
	OMP_NUM_THREADS=1 $(BIN)/pytest tests/nightly_commands.py -n 2
	OMP_NUM_THREADS=1 $(BIN)/pytest -m nightly -n 2

# Types take as long as all other checks together, so these run beside them.
check: development
	@$(MAKE) --no-print-directory -j2 types others

types:
	$(BIN)/mypy

others:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BUILD_DOCS)

# The documentation as a site in build/site; warnings are errors.
BUILD_DOCS = NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
docs: development
	$(BUILD_DOCS)

# The wheel and the source archive of a release in dist: what is committed, without readers that are fetched at first use.
FETCHED := any_pad.safetensors $(addsuffix /reader.safetensors,paper-independent gel-convnext hard many keyed)
dist:
	rm -rf build/release && git clone --quiet . build/release
	cd build/release/activetouch/models && rm $(FETCHED)
	$(PYTHON) -m build --outdir dist build/release

# What searches need, and what training and tests need beside it, in the same folder. Without --no-compile, pip writes
# 100 MB of bytecode (with training, a minute and a half more), most of it never used; the first start writes what is.
# The pip that comes with Python 3.11 computes twice as long as one of today.
environment: $(VENV)/ready
development: $(VENV)/ready-dev

INSTALL = $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt $(PIP_ARGS) -e

$(VENV)/bin/python:
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11))" || \
		{ echo "Python 3.11 or newer is needed; say which: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check $(PIP_ARGS) --upgrade "pip>=25.1"

$(VENV)/ready: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) . --no-compile
	@$(BIN)/activetouch compare --help > /dev/null
	@touch $@

$(VENV)/ready-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) ".[dev]" --no-compile
	@touch $(VENV)/ready $@

# The shipped sensor of a scene from nothing: touches, reader, observation model; make sensor SCENE=coarse for another
# (up to an hour on two cores).
SCENE ?= gel
COLLECT.gel := --plan.test 0
COLLECT.coarse := --plan.train 13500 --plan.test 0
COLLECT.hard := --plan.train 3600 --plan.calibration 100 --plan.test 0
COLLECT.many := $(COLLECT.hard)
COLLECT.paper := --plan.train 3000 --plan.calibration 150 --plan.test 0
COLLECT.keyed := --plan.train 450 --plan.calibration 40 --plan.test 0
REPEATS.gel := --plan.repeats 2 --plan.calibration 150
REPEATS.coarse := --plan.repeats 6
REPEATS.hard := --plan.repeats 2 --plan.calibration 100 --plan.test 100
REPEATS.many := $(REPEATS.hard)
REPEATS.paper := --plan.repeats 2 --plan.calibration 150 --plan.test 300
REPEATS.keyed := --plan.repeats 2 --plan.calibration 60 --plan.test 40
WORN := --recipe worn --backbone grid_cnn --jobs 1
TRAIN.gel := $(WORN)
TRAIN.coarse := --change.batch-size 512 --change.cell 0
TRAIN.hard := $(WORN) --change.focus cube cuboid wedge
TRAIN.many := $(TRAIN.hard)
TRAIN.paper := --backbone cnn --change.epochs 30 --change.patience 30 --change.cell 2.8
TRAIN.keyed := --change.patience 12
MODEL = $(if $(filter keyed,$(SCENE)),,ratio) "rigid body"
sensor: development
	$(BIN)/activetouch collect --scene $(SCENE) $(COLLECT.$(SCENE))
	$(BIN)/activetouch train --scene $(SCENE) $(TRAIN.$(SCENE))
	$(BIN)/activetouch collect --scene $(SCENE) --plan.train 0 $(REPEATS.$(SCENE)) --out data/$(SCENE)-repeats
	$(BIN)/activetouch calibrate --scene $(SCENE) --observation-model $(MODEL) --out activetouch/models/$(SCENE)

# The reader of any object beside it: of random bodies, from nothing. With DEVICE=cuda some minutes; on two cores, fewer
# steps, as STEPS=3000, in about two hours.
DEVICE ?= cpu
ANY_OBJECT = runs/train-$(SCENE)-contacts
any-object: development
	$(BIN)/activetouch train --scene $(SCENE) --recipe contacts $(addprefix --steps ,$(STEPS)) --device $(DEVICE) --out $(ANY_OBJECT)
	mkdir -p activetouch/models/$(SCENE)
	cp $(ANY_OBJECT)/any_object.safetensors activetouch/models/$(SCENE)/
	cp $(ANY_OBJECT)/log.jsonl records/perception/any_object_$(SCENE).jsonl

# What choosing the place of a touch is worth among the 26 directions, in a scene whose sensor has six poses: its reader
# calibrated for the directions (with their best fixed order), and live searches; make places SCENE=coarse
DIRECTIONS.coarse := --plan.calibration 40 --plan.test 20
DIRECTIONS.hard := --plan.calibration 25 --plan.test 10
DIRECTIONS.many := $(DIRECTIONS.hard)
SEARCHES.coarse := 150
SEARCHES.hard := 34
SEARCHES.many := $(SEARCHES.hard)
BY_PLACE := information_gain shape_information_gain random_poses best_order "information_gain(given='shape')"
PLACES = $(SCENE)-directions26
places: development
	$(BIN)/activetouch collect --scene $(SCENE) --poses directions26 --plan.train 0 --plan.repeats 2 \
		$(DIRECTIONS.$(SCENE)) --out data/$(PLACES)
	$(BIN)/activetouch calibrate --scene $(SCENE) --reader activetouch/models/$(SCENE)/reader.safetensors \
		--data data/$(PLACES) --observation-model "rigid body" --out runs/sensor-$(PLACES)
	$(BIN)/activetouch compare --scene $(SCENE) --poses directions26 --sensor runs/sensor-$(PLACES) --deciders $(BY_PLACE) \
		--episodes $(SEARCHES.$(SCENE)) --seed 1 --out runs/places-$(PLACES)

# The sensor of paper that reads shapes only and takes touches as independent given the shape, as the paper did.
INDEPENDENT := paper-independent
independent-sensor: development
	$(BIN)/activetouch collect --scene paper --plan.train 1500 --out data/$(INDEPENDENT)
	$(BIN)/activetouch train --scene paper --recipe large --backbone atto --change.batch-size 128 --change.epochs 6 \
		--data data/$(INDEPENDENT) --out runs/train-$(INDEPENDENT)
	$(BIN)/activetouch collect --scene paper --plan.train 0 --plan.repeats 6 --out data/$(INDEPENDENT)-repeats
	$(BIN)/activetouch calibrate --scene paper --reader runs/train-$(INDEPENDENT)/reader.safetensors \
		--data data/$(INDEPENDENT)-repeats --out activetouch/models/$(INDEPENDENT)

# The reader of gel as a small ConvNeXt, of the touches of gel's own reader.
CONVNEXT := gel-convnext
convnext-sensor: development
	$(BIN)/activetouch collect --scene gel $(COLLECT.gel)
	$(BIN)/activetouch train --scene gel --recipe worn --backbone grid_convnext --jobs 1 --out runs/train-$(CONVNEXT)
	$(BIN)/activetouch collect --scene gel --plan.train 0 $(REPEATS.gel) --out data/gel-repeats
	$(BIN)/activetouch calibrate --scene gel --observation-model "rigid body" --data data/gel-repeats \
		--reader runs/train-$(CONVNEXT)/reader.safetensors --out activetouch/models/$(CONVNEXT)

# PPO policies of paper-independent, from the same repeated touches.
policies: development
	$(BIN)/activetouch train-ppo --scene paper --sensor $(INDEPENDENT) --data data/$(INDEPENDENT)-repeats
	mkdir -p activetouch/models/$(INDEPENDENT)/policies
	cp runs/ppo-paper/policies/* activetouch/models/$(INDEPENDENT)/policies/

# Policies on the belief about one rigid body, for the sensor of the scene; half an hour.
BANKED.gel := --plan.calibration 200 --plan.test 200
BANKED.paper := $(BANKED.gel)
REPEATED = data/$(SCENE)-joint-repeats
joint-policies: development
	$(BIN)/activetouch collect --scene $(SCENE) --plan.train 0 --plan.repeats 6 $(BANKED.$(SCENE)) --out $(REPEATED)
	$(BIN)/activetouch train-ppo --scene $(SCENE) --data $(REPEATED) --recipes goal gains --steps 200000 \
		--out runs/ppo-$(SCENE)-joint
	mkdir -p activetouch/models/$(SCENE)/policies
	cp runs/ppo-$(SCENE)-joint/policies/* activetouch/models/$(SCENE)/policies/

# Files of the benchmark's scoreboard; an hour. ppo-coarse.zip is of examples/benchmark/train_ppo.py.
SUBMITTED = examples/benchmark && $(CURDIR)/$(BIN)/activetouch benchmark --jobs 1 --out $(CURDIR)/records/submissions
RULES = information_gain value_of_information point_based threshold random_confirm
BASELINES.coarse = $(RULES) fixed_poses ppo_gains ppo_goal
BASELINES.bodies = information_gain random_confirm
BASELINES.drawer = information_per_cost raster random
submissions: development
	$(foreach task,coarse $(LIKE_COARSE) bodies drawer,for agent in $(or $(BASELINES.$(task)),$(RULES)); do \
		(cd $(SUBMITTED)/$(task)-v1/$$agent.jsonl.gz --task $(task)-v1 --agent $$agent) || exit 1; done;)
	cd $(SUBMITTED)/coarse-v1/in_turn.jsonl.gz --agent "policy:in_turn:act(state='posterior')"
	cd $(SUBMITTED)/coarse-v1/perl.jsonl.gz --agent "process:perl agent.pl"
	cd examples/benchmark && $(CURDIR)/$(BIN)/python train_ppo.py
	cd $(SUBMITTED)/coarse-v1/ppo-coarse.jsonl.gz --agent sb3:ppo-coarse.zip
	$(BIN)/python docs/generate/tables.py

# The learning agents of the scoreboard, examples/benchmark/zoo.py, two seeds of each; make zoo-gel for those of a task.
LIKE_COARSE = gel paper hard many keyed
OBJECTS.gel := --plan.calibration 200 --plan.test 100
OBJECTS.paper := $(OBJECTS.gel)
OBJECTS.hard := --plan.calibration 100 --plan.test 50
OBJECTS.many := $(OBJECTS.hard)
OBJECTS.keyed := $(OBJECTS.hard)
BY_FILE.coarse = recurrent_ppo
ON_IMAGES.coarse = images_frozen images_tuned images_new
SCORED = PATH=$(BIN):$$PATH activetouch benchmark --jobs 1 --task $*-v1 --out records/submissions/$*-v1
zoo: $(addprefix zoo-,coarse $(LIKE_COARSE) drawer)
	$(BIN)/python docs/generate/tables.py

zoo-%: BY_FILE = ppo maskable_ppo dqn $(BY_FILE.$*)
zoo-%: WRITTEN = runs/zoo$(if $(filter-out coarse,$*),-$*-v1)
zoo-%: development
	$(BIN)/activetouch collect --scene $* --plan.train 0 --plan.repeats 6 $(OBJECTS.$*) --out data/$*-repeats
	$(BIN)/python examples/benchmark/zoo.py $(BY_FILE) $(ON_IMAGES.$*) --task $*-v1 --seeds 0 1
	for seed in 0 1; do for agent in $(BY_FILE); do \
		$(SCORED)/zoo-$$agent-$$seed.jsonl.gz --agent sb3:$(WRITTEN)/$$agent-$$seed.zip || exit 1; done; \
	for agent in $(ON_IMAGES.$*); do $(SCORED)/zoo-$$agent-$$seed.jsonl.gz \
		--agent "process:python examples/benchmark/image_policy.py $(WRITTEN)/$$agent-$$seed.zip" || exit 1; done; done

zoo-drawer: development
	$(BIN)/python examples/benchmark/tray_policy.py --seeds 0 1
	for seed in 0 1; do PYTHONPATH=examples/benchmark PATH=$(BIN):$$PATH activetouch benchmark --jobs 1 --task drawer-v1 \
		--out records/submissions/drawer-v1/zoo-ppo-$$seed.jsonl.gz --agent "tray_policy:Learned(seed=$$seed)" || exit 1; done

figures: development
	$(BIN)/activetouch compare --scene coarse --deciders information_gain --targets cone --episodes 49 --seed 1 --out runs/figure
	$(BIN)/activetouch replay --folder runs/figure --target cone --number 48 --out docs/search.png
	$(BIN)/activetouch touch --all --seed 4 --out docs/gallery.png
	$(BIN)/python docs/generate/gallery.py

# The paper's tables and its Figure 3 beside ours; make reproduce ARGS="--parts table2", or ARGS="--sensor runs/sensor-paper".
reproduce: development
	$(BIN)/activetouch reproduce $(ARGS)

# Results stay: data/ and runs/.
clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache *.egg-info
