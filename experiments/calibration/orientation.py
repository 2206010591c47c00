"""Simulation-based calibration of the posterior over orientation and size (Talts et al. 2018; Modrák et al. 2023).

The rank of the true value of a quantity among draws from the posterior is uniform if the posterior is calibrated. A
quantity is any function of the rotation, so symmetric shapes, whose orientations cannot all be told apart, need no
canonical one: orientations that look alike are as probable in the prior as in the posterior. Here the rank is the
posterior probability of smaller values, which has no error of drawing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kstest

from activetouch.poses import to_matrices
from belief.observation_model.rigid_body import RigidBodyModel
from experiments.calibration.sequences import Rounds

Floats = NDArray[np.float64]
Quantity = Callable[[Floats, Floats, Floats], Floats]
"""Numbers ``(...)`` from rotation matrices ``(..., 3, 3)``, sizes ``(...)`` and the likeliest rotation ``(3, 3)``."""

NUM_TOUCHES = (1, 2, 3, 6)
"""Numbers of touches in different poses after which the posterior is tested."""
LEAST_P = 0.01
"""Smallest p-value, corrected for the number of quantities, of a posterior that passes."""

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
class RankTest:
    """Ranks of the truth of one shape after a number of touches.

    Attributes:
        shape: label of the shape.
        num_touches: in different poses.
        ranks: by quantity, in [0, 1], one of each object, ``(n,)``.
    """

    shape: str
    num_touches: int
    ranks: Mapping[str, Floats]

    @property
    def num_objects(self) -> int:
        """How many objects."""
        return len(next(iter(self.ranks.values())))

    @property
    def p_values(self) -> dict[str, float]:
        """p-value of Kolmogorov and Smirnov's test that the ranks are uniform, by quantity."""
        return {name: float(kstest(ranks, "uniform").pvalue) for name, ranks in self.ranks.items()}

    @property
    def corrected(self) -> float:
        """Smallest p-value times the number of quantities (Bonferroni), at most 1."""
        return min(1.0, min(self.p_values.values()) * len(self.ranks))

    @property
    def spread(self) -> float:
        """Largest standard deviation of ranks relative to uniform ones; above 1, the posterior is too narrow."""
        return max(float(ranks.std() * np.sqrt(12.0)) for ranks in self.ranks.values())


def rank_tests(
    model: RigidBodyModel,
    hypotheses: tuple[Floats, Floats],
    splits: Sequence[Rounds],
    rng: np.random.Generator,
) -> list[RankTest]:
    """Ranks of the true orientation and size of every shape: of all objects, each in one sequence of different poses.

    Args:
        model: fitted, with its hypotheses.
        hypotheses: orientations at rest ``(N, 4)`` and sizes ``(N,)`` of these.
        splits: touches whose objects' orientations and sizes are known.
        rng: of the sequences, and of ranks among equals.
    """
    rotations, sizes = to_matrices(hypotheses[0]), hypotheses[1]
    found: dict[tuple[int, int], list[dict[str, float]]] = {}
    for rounds in splits:
        assert rounds.rests is not None, "recorded"
        assert rounds.sizes is not None, "recorded with it"
        sequences = rounds.distinct_poses(rng)
        _, first = np.unique(sequences.object_ids, return_index=True)
        batch, truths = sequences.batch.sequences(first), to_matrices(rounds.rests)
        for number in NUM_TOUCHES:
            if number > batch.num_touches:
                continue
            for index, shape in enumerate(rounds.shapes.tolist()):
                weights = model.log_weights(batch.sequences([index]).first(number))[0, shape]
                truth = (truths[index], rounds.sizes[index])
                found.setdefault((shape, number), []).append(_ranks(weights, rotations, sizes, truth, rng))
    return [
        RankTest(
            model.shape_labels[shape], number, {name: np.array([row[name] for row in rows]) for name in QUANTITIES}
        )
        for (shape, number), rows in sorted(found.items())
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
        found[name] = float(probs[values < true].sum() + rng.random() * probs[values == true].sum())
    return found
