"""The policies that come with the package probe what nobody touched, and searches are those of one set of policies."""

import shutil
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from activetouch import TactileSensor
from activetouch.sensor_files import MODELS, POLICIES
from belief import Belief, Probe, SceneBelief, SearchProblem
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import prepared
from experiments.search.play import Setting
from planners import InformationState
from planners.ppo import MissingPolicy, Policy, PPODecider, policy_file

LABELS = ("sphere", "cube", "cylinder", "cone")
STATES = {
    folder.parent.name: sorted({file.stem.partition("-")[0] for file in folder.iterdir()})
    for folder in MODELS.glob(f"*/{POLICIES}")
}


def test_these_sensors_come_with_policies():
    assert STATES == {"coarse": ["gains", "goal"], "paper-independent": ["paper", "posterior"]}


@pytest.mark.parametrize(("scene", "state"), [(scene, state) for scene, states in STATES.items() for state in states])
def test_an_untouched_object_of_a_search_is_probed(scene, state):
    # At the priors of a search of four: all shapes alike, or those that are left after one or two were rejected for
    # certain; and at one half. A touch costs .02 there and is worth far more on every one of these scenes.
    model = TactileSensor.shipped(scene).model
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
            view = SceneBelief(problem, model).view()
            info = InformationState(problem, target, Belief.from_probs(labels, probs), scene=view)
            assert isinstance(decider.decide(info, rng).action, Probe), f"{scene}, {labels[target]} at {probs}"


def test_a_new_policy_is_another_decider_for_its_target_and_for_nobody_else(tmp_path):
    sensor = tmp_path / "sensor"
    shutil.copytree(MODELS / "paper-independent", sensor)
    setting, deciders = (
        Setting(SceneChoice("paper"), sensor=sensor),
        ("threshold", "ppo", "ppo_posterior", "ppo_confident"),
    )
    before = prepared(setting, deciders, jobs=1)
    old = before.keys
    file = sensor / POLICIES / policy_file("paper", "cone")
    policy = Policy.load(file)
    replace(policy, card=replace(policy.card, training="trained anew")).save(file)
    after = prepared(setting, deciders, jobs=1)
    assert {cell for cell in old if after.keys[cell] != old[cell]} == {("ppo", "cone"), ("ppo_confident", "cone")}
    assert after.searches.identity == before.searches.identity
    file.unlink()
    with pytest.raises(MissingPolicy):
        prepared(setting, deciders, jobs=1)
