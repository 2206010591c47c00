"""Test whether touches in different poses are independent given the shape, as outcome tables assume.

Run: activetouch collect --scene paper --plan.train 0 --plan.repeats 2 --plan.test 300 --out data/paper-repeats
     python benchmarks/independence.py

It compares recorded objects of the test split, touched once in every pose, with objects whose touches are drawn from
the outcome table of the shipped observation model, as plans and bounds assume. Accuracy on recorded objects is lower if
an orientation can make all poses of an object uninformative at once.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.special import softmax

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import READER_FILE, fitted_model
from belief.observation_model import ArrayModel, OutcomeTable
from belief.observation_model.selection import log_posteriors
from belief.touch_batch import TouchBatch
from belief.validation import Floats
from experiments.calibration.sequences import Rounds
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import independent_sensor


def read_rounds(data: Path, sensor: Path) -> Rounds:
    manifest = read_manifest(data)
    truth = read_split(data, "test")
    touches = read_touches(TactileReader.load(sensor / READER_FILE), truth, "reading test touches")
    return Rounds.of(truth, touches, len(manifest.pose_labels))


def recorded_posteriors(scene: str, model: ArrayModel) -> tuple[Floats, np.ndarray]:
    """Posteriors ``(n, K)`` of recorded objects after their first touch in every pose, and their shapes."""
    rounds = read_rounds(Path("data") / f"{scene}-repeats", independent_sensor(scene))
    first = rounds.logits[:, 0]  # (n, P, K)
    poses = np.broadcast_to(np.arange(rounds.num_poses), first.shape[:2])
    return np.exp(log_posteriors(model, TouchBatch(poses, first))), rounds.shapes


def drawn_posteriors(table: OutcomeTable, number: int, rng: np.random.Generator) -> tuple[Floats, np.ndarray]:
    """The same for ``number`` objects of each shape whose touches are drawn from a table."""
    shapes = np.repeat(np.arange(table.num_shapes), number)
    logs = np.zeros((len(shapes), table.num_shapes))
    for probs in table.probs:
        chosen = [rng.choice(table.num_outcomes, number, p=row) for row in probs]
        logs += np.log(probs[:, np.concatenate(chosen)].T)
    return softmax(logs, axis=1), shapes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["paper"])
    parser.add_argument("--outcomes", type=int, default=24, help="number of outcomes of the table")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print("| scene | shape | recorded: accuracy | probability of the true shape | drawn: accuracy | probability |")
    print("|---|---|---|---|---|---|")
    for scene in arguments.scenes:
        model = fitted_model(independent_sensor(scene)).model
        rng = np.random.default_rng(arguments.seed)
        found = (
            recorded_posteriors(scene, model),
            drawn_posteriors(model.outcome_table(arguments.outcomes), 5000, rng),
        )
        for index, label in enumerate(model.shape_labels):
            cells = []
            for probs, shapes in found:
                own = probs[shapes == index]
                right, given = own.argmax(axis=1) == index, own[:, index]
                error = 1.96 / np.sqrt(len(own))
                cells += [
                    f"{right.mean():.3f} ± {error * right.std():.3f}",
                    f"{given.mean():.3f} ± {error * given.std():.3f}",
                ]
            print(f"| {scene} | {label} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
