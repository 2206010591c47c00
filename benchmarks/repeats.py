"""Measure the benefit of discounting repeated touches: searches among recorded objects with many touches per pose.

Run: activetouch collect --scene paper --plan.train 0 --plan.repeats 6 --plan.test 300 --out data/paper-repeats
     python benchmarks/repeats.py

Touches are recorded touches of test objects; a second touch in a pose is that of the next round. Repeats are therefore
correlated as in live searches. Beliefs come from the shipped observation model, which discounts repeats. Deciders
differ in the choice of poses only:

- ``least used``: information gain among the least used poses (decision 0006);
- ``independent``: information gain, with repeats assumed independent;
- ``discounted``: information gain, with repeats discounted as by the model.

The same is measured with the value of information, which also stops by it.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import READER_FILE, load_observation_model
from belief import SearchProblem, Touch
from belief.observation_model import OutcomeTable
from belief.statistics import paired_bootstrap
from belief.synthetic import sample_arrangement
from experiments.calibration.sequences import Rounds
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import independent_sensor
from planners import Decider, search_lockstep
from planners.decider import SequentialDecider
from planners.probing import TargetInformationGain
from planners.repeats import CorrelatedRepeats, LeastUsedFirst, RepeatDiscount, repeat_discount
from planners.stopping import PosteriorThresholds
from planners.value_of_information import ValueOfInformation


class RecordedWorld:
    """Recorded objects, each touched in its recorded rounds, in random order."""

    def __init__(self, rounds: Rounds, arrangement: Sequence[int], rng: np.random.Generator) -> None:
        self.arrangement = tuple(arrangement)
        self._rounds, self._current = rounds, 0
        self._objects = [int(rng.choice(np.flatnonzero(rounds.shapes == shape))) for shape in arrangement]
        number, poses = len(self._objects), rounds.num_poses
        order = np.tile(np.arange(rounds.num_rounds), (number, poses, 1))
        self._order = rng.permuted(order, axis=2)
        self._uses = np.zeros((number, poses), np.int64)

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """The touch of the current object in this pose in the next round; after the last round, the first again."""
        number = self._uses[self._current, pose] % self._rounds.num_rounds
        self._uses[self._current, pose] += 1
        drawn = self._order[self._current, pose, number]
        return Touch(pose, self._rounds.logits[self._objects[self._current], drawn, pose])

    def advance(self) -> None:
        """Bring the next object."""
        self._current += 1

    def reset(self) -> None:
        """Bring the first object, and forget all touches."""
        self._current = 0
        self._uses[:] = 0


def read_rounds(data: Path, sensor: Path) -> Rounds:
    manifest = read_manifest(data)
    truth = read_split(data, "test")
    touches = read_touches(TactileReader.load(sensor / READER_FILE), truth, "reading test touches")
    return Rounds.of(truth, touches, len(manifest.pose_labels))


def deciders(table: OutcomeTable, known: RepeatDiscount) -> Mapping[str, Decider]:
    discounts = {"least used": LeastUsedFirst(), "independent": CorrelatedRepeats(0.0), "discounted": known}
    gains = {
        f"information gain, {name}": SequentialDecider(PosteriorThresholds(), TargetInformationGain(table, discount))
        for name, discount in discounts.items()
    }
    values = {
        f"value of information, {name}": ValueOfInformation(table, 2, discount) for name, discount in discounts.items()
    }
    return {**gains, **values}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="paper")
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    sensor = independent_sensor(arguments.scene)
    rounds = read_rounds(Path("data") / f"{arguments.scene}-repeats", sensor)
    model = load_observation_model(sensor)
    known = repeat_discount(model)
    poses = tuple(f"pose_{pose}" for pose in range(rounds.num_poses))
    problem = SearchProblem(model.shape_labels, poses, 4, touch_limit=48)
    print(f"{arguments.scene}: {rounds.num_objects} objects, {arguments.episodes} searches, {known}")
    print(f"{'':36}{'return':>8}{'success':>9}{'touches':>9}   over least used, paired, 95 %")
    reference = np.empty(0)
    for name, decider in deciders(model.outcome_table(), known).items():
        seeds = [(arguments.seed, number) for number in range(arguments.episodes)]
        rngs = [np.random.default_rng([*seed, 2]) for seed in seeds]
        worlds = [RecordedWorld(rounds, sample_arrangement(problem, rng), rng) for rng in rngs]
        targets = [number % problem.num_shapes for number in range(arguments.episodes)]
        episodes = search_lockstep(worlds, decider, problem, targets, model, seeds)
        returns = np.array([episode.reward(problem) for episode in episodes])
        reference = returns if name.endswith("least used") else reference
        over, low, high = paired_bootstrap(returns, reference, np.random.default_rng(arguments.seed))
        print(
            f"{name:36}{returns.mean():8.3f}{np.mean([e.success for e in episodes]):9.3f}"
            f"{np.mean([e.num_touches for e in episodes]):9.2f}   {over:+.4f} [{low:+.4f}, {high:+.4f}]",
            flush=True,
        )


if __name__ == "__main__":
    main()
