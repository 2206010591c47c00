"""Search live by the joint belief of shape and orientation, with planners of ours and of pomdp-py: return against time.

Run: OMP_NUM_THREADS=1 python benchmarks/peers_joint.py [--searches 40] [--figure peers_joint.svg]

All play the same searches of scene ``coarse`` with its sensor's own joint belief. POUCT is played in two ways. On the
table of :mod:`planners.pomdp_py_adapter`, touches in the tree are independent given the shape. On the
joint problem, a state of the tree is an object's shape and one of the orientations that its touches leave likely, so
that what a simulated touch shows depends on both, as in the belief.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pomdp_py.utils.templates import SimpleObservation, SimpleState
from timed import Timed

from activetouch import TactileSensor, TouchWorld
from belief import SearchProblem
from belief.observation_model.log_weights import some_hypotheses
from belief.observation_model.rigid_body import RigidBodyModel, joint_model
from belief.seeding import arrangement_rng
from belief.statistics import paired_bootstrap, wilson_interval
from belief.synthetic import sample_arrangement
from belief.touch_batch import TouchBatch
from planners import Decider, InformationState, make_decider, search_lockstep
from planners.pomdp_py_adapter import Pouct, Rules

SCENE, NUM_OBJECTS, TOUCH_COST = "coarse", 4, 0.02
SIMULATIONS = (100, 400)
BODIES, NUM_OUTCOMES = 32, 16  # orientations of each shape in a tree, and outcomes of a touch


class BodyRules(Rules):
    """A search whose states are (object, body, whether a target was rejected).

    A body is a shape in an orientation. The first K H bodies are those of the current object, H likely ones of each
    shape; the other K H are those of later objects, drawn evenly.
    """

    def __init__(self, info: InformationState, pouct: BodyPouct) -> None:
        super().__init__(info.problem, info.target, pouct.table)
        self.by_shape = super().histogram(info)  # before its states are those of bodies
        model, num_shapes = pouct.model, info.problem.num_shapes
        weights = np.zeros((num_shapes, model.num_hypotheses))
        if info.history:
            poses = np.array([[touch.pose for touch in info.history]])
            features = np.array([[touch.features for touch in info.history]])
            weights = model.log_weights(TouchBatch(poses, features=features), np.float32)[0].astype(np.float64)
        chosen, self.shares = some_hypotheses(weights, BODIES)
        now = model.outcomes.of(chosen, NUM_OUTCOMES)
        probs = np.concatenate([now.reshape(len(now), -1, now.shape[3]), pouct.later], axis=1)
        number = num_shapes * BODIES
        keys = [(info.object_index, body, missed) for body, missed in product(range(number), (0, 1))]
        places = range(info.object_index + 1, info.problem.num_objects)
        keys += [(place, number + body, missed) for place, body, missed in product(places, range(number), (0, 1))]
        later = np.repeat(self.shape_probs / BODIES, BODIES, axis=2)
        self.states = {key: SimpleState(key) for key in keys}
        self.outcomes = [SimpleObservation(outcome) for outcome in range(probs.shape[2])]
        self.cumulative_outcomes = probs.astype(np.float64).cumsum(axis=2).tolist()
        self.cumulative_shapes = np.concatenate([np.zeros_like(later), later], axis=2).cumsum(axis=2).tolist()

    def is_target(self, state: SimpleState) -> bool:
        """Whether the current object is the target."""
        return bool(state.data[1] // BODIES % self.problem.num_shapes == self.target)

    def histogram(self, info: InformationState) -> dict[SimpleState, float]:
        """The belief as probabilities of bodies."""
        found: dict[SimpleState, float] = {}
        for state, prob in self.by_shape.items():
            place, shape, missed = state.data
            for body, share in enumerate(self.shares[shape].tolist()):
                if share > 0.0:
                    found[self.states[place, shape * BODIES + body, missed]] = prob * share
        return found


@dataclass(frozen=True, eq=False)
class BodyPouct(Pouct):
    """POUCT of pomdp-py on the joint problem of a model of one rigid body."""

    model: RigidBodyModel | None = None

    @cached_property
    def later(self) -> np.ndarray:
        """p(outcome | pose, body) of objects that were not touched, ``(P, K H, M)``."""
        spread = np.linspace(0, self.model.num_hypotheses - 1, BODIES).astype(int)
        found = self.model.outcomes.of(np.tile(spread, (len(self.model.shape_labels), 1)), NUM_OUTCOMES)
        return found.reshape(len(found), -1, found.shape[3])

    def rules(self, info: InformationState) -> Rules:
        """The search in which bodies are touched."""
        return BodyRules(info, self)


def main(searches: int, figure: Path | None) -> None:
    """Play and print; draw if there is a path."""
    sensor = TactileSensor.shipped(SCENE)
    model, table = joint_model(sensor.model), sensor.model.outcome_table()
    planners: dict[str, Callable[[], Decider]] = {
        name: lambda name=name: make_decider(name, table, sensor.model)
        for name in ("information_gain", "point_based", "value_of_information")
    }
    for number in SIMULATIONS:
        planners[f"pouct, table ({number})"] = lambda number=number: Pouct(table, number)
        planners[f"pouct, joint ({number})"] = lambda number=number: BodyPouct(table, number, model=model)
    labels, poses = sensor.scene.shape_labels, sensor.scene.pose_labels
    problem = SearchProblem(labels, poses, NUM_OBJECTS, touch_cost=TOUCH_COST, touch_limit=12 * NUM_OBJECTS)
    keys = [(0, number) for number in range(searches)]
    targets = [number % len(labels) for number in range(searches)]
    print(f"{searches} live searches of {SCENE} among {NUM_OBJECTS} objects, touch cost {TOUCH_COST}, seed 0; 95 %")
    first, points = np.empty(0), []
    for name, make in planners.items():
        timed, worlds = Timed(make()), []
        for key in keys:
            rng = arrangement_rng(key)
            worlds.append(TouchWorld.sample(sensor, sample_arrangement(problem, rng), rng))
        episodes = search_lockstep(worlds, timed, problem, targets, sensor.model, keys)
        returns = np.array([episode.reward(problem) for episode in episodes])
        first = first if first.size else returns
        over = "{:+.3f} [{:+.3f}, {:+.3f}]".format(*paired_bootstrap(returns, first, np.random.default_rng(0)))
        right = sum(episode.success for episode in episodes)
        success = "{:.3f} [{:.3f}, {:.3f}]".format(right / searches, *wilson_interval(right, searches))
        touches = np.mean([episode.num_touches for episode in episodes])
        taken = float(np.median(np.concatenate(list(timed.milliseconds.values()))))
        points.append((name, taken, returns))
        print(
            f"{name:<24} return {returns.mean():+.3f}, over information_gain {over}, success {success}, "
            f"{touches:.2f} touches, {taken:.2f} ms a decision",
            flush=True,
        )
    if figure is not None:
        draw(points, figure)


def draw(points: list[tuple[str, float, np.ndarray]], path: Path) -> None:
    """Draw return against time."""
    drawn = Figure(figsize=(7, 4), layout="constrained")
    axes = drawn.subplots()
    for name, taken, returns in points:
        error = 1.96 * returns.std(ddof=1) / np.sqrt(len(returns))
        axes.errorbar(taken, returns.mean(), error, fmt="o", capsize=3)
        axes.annotate(name, (taken, returns.mean()), xytext=(5, 5), textcoords="offset points", fontsize=8)
    axes.set(xscale="log", xlabel="processor time of a decision, median [ms]", ylabel="return of a search, mean, 95 %")
    axes.grid(alpha=0.3)
    drawn.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--searches", type=int, default=40)
    parser.add_argument("--figure", type=Path)
    asked = parser.parse_args()
    main(asked.searches, asked.figure)
