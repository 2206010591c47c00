"""Where people type a shape, a pose or a seed, a name or a number will do; and objects print on one line."""

from types import SimpleNamespace

import numpy as np
import pytest

from activetouch import Quasistatic, Scene, TouchWorld
from activetouch.named_scenes import SCENES
from belief import Belief, Confirm, Probe, Reject, SceneBelief, SearchProblem, Touch
from belief.errors import InvalidArgument, UnknownName
from belief.naming import index_of
from belief.synthetic import SyntheticWorld, random_model
from planners import Decision, search, search_lockstep

MODEL = random_model(np.random.default_rng(0), num_shapes=3, num_poses=2)
PROBLEM = SearchProblem(MODEL.shape_labels, ("front", "back"), num_objects=2)


class Named:
    """Touches once in a pose given by its name, then confirms the second object."""

    def __init__(self, pose):
        self.pose = pose

    def decide(self, info, rng):
        if not info.uses.sum() and info.object_index == 0:
            return Decision(Probe(self.pose))
        return Decision(Reject() if info.object_index == 0 else Confirm())


def test_a_search_by_names_is_the_search_by_numbers():
    def played(shapes, target, seed, pose):
        return search(SyntheticWorld(MODEL, shapes), Named(pose), PROBLEM, target, MODEL, seed).to_dict()

    by_name = played(("shape_2", "shape_1"), "shape_1", 7, "back")
    assert by_name == played((2, 1), 1, (7,), 1)
    world = SyntheticWorld(MODEL, ("shape_2", 1))
    [episode] = search_lockstep([world], Named(np.int64(1)), PROBLEM, [np.int64(1)], MODEL, [7])
    assert episode.to_dict() == by_name


def test_a_scenes_belief_takes_shapes_by_name():
    beliefs = [SceneBelief(PROBLEM, MODEL, target=target) for target in ("shape_1", 1)]
    assert beliefs[0].prob_present("shape_1") == beliefs[1].prob_present(1)


def test_objects_and_poses_of_a_scene_are_named():
    scene = Scene(press_model=Quasistatic())
    image, same = (
        scene.press(scene.sample_object(shape, np.random.default_rng(0)), pose, np.random.default_rng(1)).image
        for shape, pose in (("cone", scene.pose_labels[2]), (scene.shape_labels.index("cone"), 2))
    )
    assert (image == same).all()


@pytest.mark.parametrize(
    ("call", "nearest"),
    [
        (lambda: index_of("shape", ("sphere", "cone"), "cones"), "cone"),
        (lambda: Scene().sample_object("cones", np.random.default_rng(0)), "cone"),
        (lambda: SyntheticWorld(MODEL, ("shape1",)), "shape_1"),
        (lambda: search(SyntheticWorld(MODEL, (0, 1)), Named(0), PROBLEM, "shape1", MODEL, 7), "shape_1"),
        (lambda: SceneBelief(PROBLEM, MODEL).prob_present("shape1"), "shape_1"),
    ],
)
def test_an_unknown_name_suggests_the_nearest(call, nearest):
    with pytest.raises(UnknownName, match=f"Did you mean '{nearest}'"):
        call()


@pytest.mark.parametrize("wrong", [-1, 2, 1.0, True, None, np.float64(0)])
def test_what_is_neither_a_name_nor_an_index_is_refused(wrong):
    with pytest.raises(InvalidArgument):
        index_of("shape", ("sphere", "cone"), wrong)


def test_what_people_print_is_one_short_line():
    labels = [f"a shape with a long name, number {k}" for k in range(30)]
    scene = SCENES["many"].scene
    sensor = SimpleNamespace(scene=scene)
    world = TouchWorld.sample(sensor, ["cone", 0] * 9, np.random.default_rng(0))
    for thing in (
        search(SyntheticWorld(MODEL, (0, 1)), Named(0), PROBLEM, 1, MODEL, 7),
        Touch(0, np.linspace(-1e9, 1e9, 30), np.zeros(512)),
        Belief.uniform(labels),
        Belief.uniform(["cube", "cone"]),
        scene,
        world,
    ):
        text = repr(thing)
        assert text.startswith(f"{type(thing).__name__}(")
        assert text.endswith(")")
        assert len(text) <= 120
        assert "\n" not in text
    assert repr(Belief.from_probs(["cube", "cone"], [0.25, 0.75])) == "Belief(cone 0.750, cube 0.250)"


@pytest.mark.torch
def test_a_sensor_prints_on_one_line():
    from activetouch import TactileSensor

    text = repr(TactileSensor.shipped("coarse"))
    assert text.startswith("TactileSensor(sphere, cube, cylinder, cone, network ")
    assert len(text) <= 120
