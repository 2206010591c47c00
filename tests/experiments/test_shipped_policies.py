"""The policies that come with the package probe what nobody touched, and searches are those of one set of policies."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from activetouch.world import CLASSIFIER_FILE, MODELS, OBSERVATION_FILE, POLICIES, load_observation_model
from belief import Belief, Probe, SearchProblem
from experiments.episodes import Setting
from experiments.results import RunFolder, RunMismatch
from experiments.shards import identity
from planners import InformationState
from planners.ppo import PPODecider

SCENES = sorted(path.parent.name for path in MODELS.glob(f"*/{POLICIES}"))


def test_three_scenes_come_with_policies():
    assert SCENES == ["coarse", "gel", "paper"]


@pytest.mark.parametrize("state", ["paper", "posterior"])
@pytest.mark.parametrize("scene", SCENES)
def test_an_untouched_object_of_a_search_is_probed(scene, state):
    # At the priors of a search of four: all shapes alike, or those that are left after one or two were rejected for
    # certain; and at one half. A touch costs .02 there and is worth far more on every one of these scenes.
    model = load_observation_model(MODELS / scene)
    labels, rng = model.shape_labels, np.random.default_rng(0)
    pose_labels = ("front", "z45", "z90", "y45", "y90", "corner")
    problem, decider = SearchProblem(labels, pose_labels, 4), PPODecider(MODELS / scene / POLICIES, state)
    for target in range(4):
        others = [shape for shape in range(4) if shape != target]
        beliefs = [
            np.isin(range(4), [target, *some]) / (1.0 + n) for n in (1, 2, 3) for some in combinations(others, n)
        ]
        beliefs.append(np.where(np.arange(4) == target, 0.5, 1.0 / 6.0))
        for probs in beliefs:
            info = InformationState(problem, target, Belief.from_probs(labels, probs))
            assert isinstance(decider.decide(info, rng).action, Probe), f"{scene}, {labels[target]} at {probs}"


def test_a_folder_of_searches_refuses_other_policies(tmp_path):
    sensor = tmp_path / "sensor"
    for name in (CLASSIFIER_FILE, OBSERVATION_FILE, Path(POLICIES, "paper-cone"), Path(POLICIES, "paper-cube")):
        (sensor / name).parent.mkdir(parents=True, exist_ok=True)
        (sensor / name).write_text(str(name))

    def begin():
        identity.cache_clear()  # a process reads the files once
        RunFolder(tmp_path / "run").open(dict(identity(Setting(sensor=sensor), 0)), {})

    begin()
    begin()
    (sensor / POLICIES / "paper-cone").write_text("trained anew")
    with pytest.raises(RunMismatch, match="other policies_sha256"):
        begin()
