"""Simulation-based calibration of the posterior over orientation and size (Talts et al. 2018; Modrák et al. 2023).

The rank of the true value of a quantity among draws from the posterior is uniform if the posterior is calibrated. A
quantity is any function of the rotation, so symmetric shapes, whose orientations cannot all be distinguished, need no
canonical one: orientations that look alike are as probable in the prior as in the posterior. Here the rank is the
posterior probability of smaller values, which has no error of drawing.

A reader that was trained with cells knows the likelihood of a touch after a small random rotation, another one in every
touch. Its posterior is tested with touches of such a world (``collect --presentation inexact``).

    python -m benchmarks.orientation_ranks coarse 131072

The arguments are a scene, whose shipped sensor and collection data/SCENE-repeats are used, and a number of hypotheses
of each shape, at temperature 1; without it, those of the sensor at its own temperature are tested.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kstest

from activetouch import TactileSensor
from activetouch.data.dataset import read_split
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.poses import to_matrices
from belief.observation_model.rigid_body import RigidBodyModel, joint_model
from belief.seeding import keyed_rng
from belief.table import Table
from experiments.calibration.sequences import Rounds
from experiments.scene_choice import repeats_folder
from experiments.sensor.scores import read_touches

Floats = NDArray[np.float64]
Quantity = Callable[[Floats, Floats, Floats], Floats]
"""Numbers ``(...)`` from rotation matrices ``(..., 3, 3)``, sizes ``(...)`` and the likeliest rotation ``(3, 3)``."""

NUM_TOUCHES = (1, 2, 3, 6)
"""Numbers of touches in different poses after which the posterior is tested."""
LEAST_P = 0.01
"""Smallest p-value, corrected for the number of quantities, of a posterior that passes."""
_AT_ONCE = 1 << 24  # weights of hypotheses

QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "x component of the approach axis": lambda rotations, sizes, best: rotations[..., 0, 0],
        "z component of the approach axis": lambda rotations, sizes, best: rotations[..., 0, 2],
        "largest component of it": lambda rotations, sizes, best: np.abs(rotations[..., 0, :]).max(axis=-1),
        "angle of the rotation": lambda rotations, sizes, best: -np.trace(rotations, axis1=-2, axis2=-1),
        "angle to the likeliest": lambda rotations, sizes, best: -np.einsum("...ij,ij->...", rotations, best),
        "size": lambda rotations, sizes, best: sizes,
    }
)
"""What is ranked, by name. Components are those in the frame of the body at rest; angles enter as -2 cos - 1."""


@dataclass(frozen=True, eq=False)
class Touched:
    """Touches of objects whose orientations and sizes are known.

    Attributes:
        rounds: the touches.
        rests: orientation of every object at rest, unit quaternions ``wxyz``, ``(N, 4)``.
        sizes: size factor of every object, ``(N,)``.
    """

    rounds: Rounds
    rests: Floats
    sizes: Floats


@dataclass(frozen=True)
class Ranks:
    """Summary of the ranks of one quantity, one rank of each object.

    Attributes:
        p_value: of Kolmogorov and Smirnov's test that they are uniform.
        mean: 0.5 for uniform ranks; of a distance to the likeliest, above 0.5 if the posterior is too narrow.
        spread: standard deviation relative to that of uniform ranks; above 1 the posterior is too narrow, below 1 too
            wide.
    """

    p_value: float
    mean: float
    spread: float

    @classmethod
    def of(cls, ranks: Floats) -> Ranks:
        """The summary of ranks ``(n,)`` in [0, 1]."""
        p_value = float(kstest(ranks, "uniform").pvalue)
        return cls(p_value, float(ranks.mean()), float(ranks.std() * np.sqrt(12.0)))


@dataclass(frozen=True)
class RankTest:
    """Ranks of the truth of one shape after a number of touches.

    Attributes:
        shape: label of the shape.
        num_touches: in different poses.
        num_objects: with one rank each.
        ranks: by quantity.
    """

    shape: str
    num_touches: int
    num_objects: int
    ranks: Mapping[str, Ranks]

    @property
    def worst(self) -> str:
        """The quantity with the smallest p-value."""
        return min(self.ranks, key=lambda name: self.ranks[name].p_value)

    @property
    def p_value(self) -> float:
        """Smallest p-value times the number of quantities (Bonferroni), at most 1."""
        return min(1.0, self.ranks[self.worst].p_value * len(self.ranks))

    @property
    def passes(self) -> bool:
        """Whether the p-value is large enough for a calibrated posterior."""
        return self.p_value > LEAST_P


def rank_tests(
    model: RigidBodyModel,
    rests: Floats,
    sizes: Floats,
    splits: Sequence[Touched],
    rng: np.random.Generator,
) -> list[RankTest]:
    """Ranks of the true orientation and size of every shape: of all objects, each in one sequence of different poses.

    Args:
        model: fitted, with its hypotheses.
        rests: orientations at rest of these, unit quaternions ``wxyz``, ``(N, 4)``.
        sizes: size factors of these, ``(N,)``.
        splits: touches of objects.
        rng: of the sequences, and of ranks among equals.
    """
    rotations = to_matrices(rests)
    at_once = max(1, _AT_ONCE // model.num_hypotheses)  # objects
    found: dict[tuple[int, int], list[dict[str, float]]] = {}
    for split in splits:
        rounds = split.rounds
        sequences = rounds.distinct_poses(rng)
        _, first = np.unique(sequences.object_ids, return_index=True)
        batch = sequences.batch.sequences(first)
        truths = list(zip(to_matrices(split.rests), split.sizes, strict=True))
        for number in [number for number in NUM_TOUCHES if number <= batch.num_touches]:
            for start in range(0, len(truths), at_once):
                rows = np.arange(start, min(start + at_once, len(truths)))
                weights = np.empty((len(rows), model.num_hypotheses))
                for shape in np.unique(rounds.shapes[rows]).tolist():
                    here = rounds.shapes[rows] == shape
                    touches, own = batch.sequences(rows[here]).first(number), slice(shape, shape + 1)
                    weights[here] = model.log_weights(touches, shapes=own)[:, 0]
                for row, of_object in zip(rows, weights, strict=True):
                    shape = int(rounds.shapes[row])
                    ranks = _ranks(of_object, rotations, sizes, truths[row], rng)
                    found.setdefault((shape, number), []).append(ranks)
    return [
        RankTest(
            model.shape_labels[shape],
            number,
            len(of_objects),
            {name: Ranks.of(np.array([ranks[name] for ranks in of_objects])) for name in QUANTITIES},
        )
        for (shape, number), of_objects in sorted(found.items())
    ]


def _ranks(
    log_weights: Floats, rotations: Floats, sizes: Floats, truth: tuple[Floats, float], rng: np.random.Generator
) -> dict[str, float]:
    """Posterior probability of smaller values than the true one, by quantity; equals count by a random share."""
    probs = np.exp(log_weights - log_weights.max())
    probs /= probs.sum()
    best, found = rotations[log_weights.argmax()], {}
    for name, quantity in QUANTITIES.items():
        values, true = quantity(rotations, sizes, best), quantity(truth[0], np.asarray(truth[1]), best)
        rank = float(probs[values < true].sum() + rng.random() * probs[values == true].sum())
        found[name] = min(rank, 1.0)  # a sum of all may exceed one by rounding
    return found


def table(tests: Sequence[RankTest]) -> Table:
    """The tests as a table."""
    rows = [
        (
            *(test.shape, test.num_touches, test.num_objects),
            f"{test.p_value:.2g} {'✓' if test.passes else '✗'}",
            test.worst,
            test.ranks[test.worst].mean,
            test.ranks[test.worst].spread,
            max(ranks.spread for ranks in test.ranks.values()),
        )
        for test in tests
    ]
    columns = [
        *("shape", ("touches", "d"), ("objects", "d"), ("p, corrected", "")),
        *(("quantity with the smallest p", ""), ("its mean rank", ".3f"), ("its spread", ".2f")),
        ("largest spread", ".2f"),
    ]
    return Table("Uniformity of the ranks of the true orientation and size", columns, rows)


def main(name: str, number: str = "") -> None:
    """Test the posterior of the shipped sensor of a scene."""
    sensor, data = TactileSensor.shipped(name), repeats_folder(name)
    model = joint_model(sensor.model)
    assert model is not None, "a sensor whose model is about one rigid body"
    hypotheses = HypothesisTable(sensor.reader, sensor.scene)
    if number:
        model = model.with_hypotheses(hypotheses, int(number)).at(1.0)
    splits = []
    for split in ("calibration", "test"):
        truth = read_split(data, split)
        rounds = Rounds.of(truth, read_touches(sensor.reader, truth, f"reading {split} touches"), model.num_poses)
        each = len(truth.object_ids) // rounds.num_objects
        splits.append(Touched(rounds, truth.rests[::each], truth.sizes[::each]))
    bodies = sensor.scene.hypotheses(model.num_hypotheses)
    tests = rank_tests(model, bodies.rests, bodies.sizes, splits, keyed_rng([0, 4], is_fixed_length=True))
    print(table(tests).text(140))
    passed = sum(test.passes for test in tests)
    print(f"{passed} of {len(tests)} tests pass (p > {LEAST_P:g}, corrected for {len(QUANTITIES)} quantities)")


if __name__ == "__main__":
    main(*sys.argv[1:])
