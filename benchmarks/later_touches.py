"""What another touch of one object tells, as the joint belief knows it and as a table of first touches says.

Run: python benchmarks/later_touches.py coarse --objects 400

Objects are drawn from the shipped joint model and touched in new poses in random order. At every belief on the way,
the expected information of the best next touch about the shape is taken from the touches so far, and from the table of
first touches, by which `point_based` plans.
"""

from __future__ import annotations

import argparse

import numpy as np

from activetouch import TactileSensor
from belief.bayes import expected_information_gain, update
from belief.validation import Floats

_OUTCOMES, _HYPOTHESES, _REPEATS = 128, 64, 3


def gains_on_the_way(scene: str, objects: int, rng: np.random.Generator) -> Floats:
    """Information of the best next touch [nats] by the joint belief and by first touches, ``(n, P, 2)``."""
    model = TactileSensor.shipped(scene).model
    number, prior = len(model.shape_labels), np.full(len(model.shape_labels), -np.log(len(model.shape_labels)))
    first = model.start().outcome_mixture(_OUTCOMES, _HYPOTHESES).table.probs
    found = np.empty((objects, model.num_poses, 2))
    for index in range(objects):
        poses, evidence = rng.permutation(model.num_poses), model.start()
        for step, touch in enumerate(model.sample(index % number, poses=poses.tolist(), rng=rng)):
            belief, left = np.exp(update(prior, evidence.log_likelihood)[0]), poses[step:]
            now = evidence.outcome_mixture(_OUTCOMES, _HYPOTHESES).table.probs
            found[index, step] = [expected_information_gain(belief, table[left]).max() for table in (now, first)]
            evidence = evidence.update(touch)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["coarse"])
    parser.add_argument("--objects", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print("| scene | touches before | by the joint belief [nats] | by first touches [nats] | ratio [95 %] |")
    print("|---|---:|---:|---:|---|")
    for scene in arguments.scenes:
        found = gains_on_the_way(scene, arguments.objects, np.random.default_rng(arguments.seed))
        for step in range(found.shape[1]):
            (joint, first), rng = found[:, step].mean(axis=0), np.random.default_rng(arguments.seed)
            drawn = found[rng.integers(len(found), size=(2000, len(found))), step].mean(axis=1)
            low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [0.025, 0.975])
            print(f"| `{scene}` | {step} | {joint:.3f} | {first:.3f} | {joint / first:.2f} [{low:.2f}, {high:.2f}] |")


if __name__ == "__main__":
    main()
