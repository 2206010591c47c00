"""Deciders only read: what they see cannot be changed by them, and does not change under them."""

import copy
import pickle

import numpy as np
import pytest

from belief import Belief, Confirm, Probe, Reject, SceneBelief, SceneView, SearchProblem, Touch
from belief.synthetic import SyntheticWorld
from planners import DECIDERS, Decision, InformationState, make_decider, search
from planners.decider import BadState
from planners.registry import NEED_FILES

POSES = ("p0", "p1", "p2")


def searched_scene(model, seed=0):
    """A scene of three objects in the middle of a search, the first of them rejected."""
    problem = SearchProblem(model.shape_labels, POSES, 3)
    scene, rng = SceneBelief(problem, model), np.random.default_rng(seed)
    for index, poses in ((0, [0, 1, 0]), (1, [2])):
        scene.update(index, model.sample(index, poses, rng))
    return problem, scene


def numbers(scene):
    """All that a scene's belief says, by value."""
    return [
        scene.log_likelihoods().tobytes(),
        scene.log_marginals().tobytes(),
        *[
            [(touch.pose, touch.logits.tobytes()) for touch in scene.touches(index)]
            for index in range(scene.num_objects)
        ],
    ]


@pytest.mark.parametrize("name", [name for name in DECIDERS if name not in NEED_FILES])
def test_no_decider_changes_a_number_of_what_it_sees(name, model):
    decider, rng = make_decider(name, model.outcome_table(), model, simulations=20), np.random.default_rng(1)
    for seed in range(3):
        problem, scene = searched_scene(model, seed)
        info = InformationState.of(problem, seed % 4, scene, 1)
        before, seen = numbers(scene), info.belief.log_probs.tobytes()
        decider.decide(info, rng)
        assert numbers(scene) == before
        assert numbers(info.scene) == before
        assert info.belief.log_probs.tobytes() == seen


def overwrite(array):
    array[...] = 0.0


HOSTILE = {
    "touches an object itself": lambda info: info.scene.update(1, info.history),
    "reaches for what holds the belief": lambda info: info.scene._scene,
    "writes into its numbers": lambda info: overwrite(info.scene._log_likelihoods),
    "takes a touch of another object away": lambda info: info.scene._touches.clear(),
    "sets an attribute of the scene": lambda info: setattr(info.scene, "labels", ("a",)),
    "sets a private one": lambda info: setattr(info.scene, "_log_likelihoods", None),
    "puts another scene in its place": lambda info: setattr(info, "scene", None),
    "writes into the posterior": lambda info: overwrite(info.belief.log_probs),
    "adds a touch": lambda info: info.history.append(Touch(0, np.zeros(4))),
    "takes a touch away": lambda info: info.history.__delitem__(0),
    "changes the rules": lambda info: setattr(info.problem, "touch_cost", 0.0),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_decider_that_tries_to_change_the_belief_gets_an_error(what, model):
    class Hostile:
        def decide(self, info, rng):
            if info.history:
                HOSTILE[what](info)
            return Decision(Probe(0))

    problem = SearchProblem(model.shape_labels, POSES, 4)
    with pytest.raises((AttributeError, TypeError, ValueError)):
        search(SyntheticWorld(model, (0, 1, 2, 3)), Hostile(), problem, 0, model, (0,))


def test_what_is_returned_are_copies(model):
    _, scene = searched_scene(model)
    view, before = scene.view(), numbers(scene)
    for array in (view.marginals(), view.log_marginals(), view.log_likelihoods(), view.touches(1).uses(3)):
        array[...] = 7
    assert numbers(view) == numbers(scene) == before


def test_what_a_decider_keeps_does_not_change_when_more_is_felt(model):
    kept = []

    class Keeps:
        def decide(self, info, rng):
            kept.append((info, numbers(info.scene), len(info.history), info.scene.prob_present(info.target)))
            return Decision(Probe(len(info.history) % 3) if len(info.history) < 4 else Reject())

    search(SyntheticWorld(model, (0, 1, 2, 3)), Keeps(), SearchProblem(model.shape_labels, POSES, 4), 0, model, (0,))
    assert len(kept) == 20
    for info, then, touches, present in kept:
        assert numbers(info.scene) == then
        assert len(info.history) == touches
        assert info.scene.prob_present(info.target) == present


def test_a_view_reads_what_the_scene_says_and_can_be_sent_to_a_worker(model):
    _, scene = searched_scene(model)
    for view in (scene.view(), copy.deepcopy(scene.view()), pickle.loads(pickle.dumps(scene.view()))):
        assert isinstance(view, SceneView)
        assert numbers(view) == numbers(scene)
        assert (view.labels, view.num_objects) == (scene.labels, scene.num_objects)
        assert view.belief(2).log_probs.tolist() == scene.belief(2).log_probs.tolist()


def test_a_scene_that_can_be_changed_is_no_part_of_an_information_state(model):
    problem, scene = searched_scene(model)
    with pytest.raises(BadState, match=r"view\(\)"):
        InformationState(problem, 0, Belief.uniform(model.shape_labels), (), 1, scene)


def test_reading_is_all_a_decision_needs(model):
    class Reads:
        def decide(self, info, rng):
            return Decision(Confirm() if info.scene.belief(info.object_index).probs[info.target] > 0.9 else Reject())

    problem = SearchProblem(model.shape_labels, POSES, 4)
    assert search(SyntheticWorld(model, (0, 1, 2, 3)), Reads(), problem, 0, model, (0,)).num_touches == 0
