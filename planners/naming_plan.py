"""A plan of the touches that name an object: point-based value iteration on what was touched so far and on the belief.

Naming ends when a label is probable enough. As a decision process: a touch costs 1, and naming a label k costs
L (1 - b_k), with L such that at the threshold a touch is worth its cost only if it halves the doubt. The value of a
plan is linear in the belief, an alpha vector. There is a set of them for each tuple of touches that the poses have had,
because repeated and correlated touches tell less: a touch in pose p of an object with counts n gives an outcome with
probability 1 / (1 + ∑_j n_j κ_jp) and nothing otherwise, as in :mod:`belief.observation_model.action_kernel`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from belief.bayes import expected_information_gain
from belief.errors import InvalidArgument
from belief.frozen import frozen
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Probe
from belief.validation import Floats, as_real, require_count, require_number
from planners.decider import Decision, InformationState, require_fit
from planners.pomdp.alpha_vectors import AlphaVectors
from planners.pomdp.solver import backup, different
from planners.pomdp.stages import StagedProblem

Counts = tuple[int, ...]

_ROUNDS = (200, 200)  # simulated namings in each round of planning
_EXPLORATION = 0.2  # share of random poses in them
_FEW = 40  # vectors; fewer are joined by those of more touches, which are bounds as well


@dataclass(frozen=True, eq=False)
class NamingPlan:
    """Chooses the pose of the plan with the fewest expected touches; solved when it is first asked, in seconds.

    Attributes:
        table: p(outcome | pose, label) of first touches.
        kernel: correlations of touches between poses, ``(P, P)``; see :func:`touch_weights
            <belief.observation_model.action_kernel.touch_weights>`.
        repeats: number of touches in a pose that count.
        threshold: probability at which an object is named.
        max_touches: of an object.

    Raises:
        InvalidArgument: a kernel that does not fit the table, or a number out of range.

    >>> tells = np.array([[0.95, 0.05], [0.05, 0.95]])
    >>> plan = NamingPlan(OutcomeTable(np.stack([np.full((2, 2), 0.5), tells])), np.zeros((2, 2)))
    >>> plan.touch_values(np.array([0.5, 0.5]), (0, 0)).argmax()
    np.int64(1)
    """

    table: OutcomeTable
    kernel: Floats
    repeats: int = 1
    threshold: float = 0.9
    max_touches: int = 12

    def __post_init__(self) -> None:
        kernel, size = np.asarray(as_real(self.kernel, "kernel"), np.float64), self.table.num_poses
        if kernel.shape != (size, size) or not ((kernel >= 0.0) & (kernel <= 1.0)).all():
            raise InvalidArgument(f"kernel must be ({size}, {size}) with entries in [0, 1], got {kernel.tolist()}")
        object.__setattr__(self, "kernel", frozen(kernel))
        require_number("threshold", self.threshold, 0.0, 1.0)
        require_count("repeats", self.repeats)
        require_count("max_touches", self.max_touches)

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        require_fit(self.table, info.problem)
        counts = tuple(np.minimum(info.uses, self.repeats).tolist())
        values = self.touch_values(info.belief.probs, counts)
        best = int(values.argmax()) if np.isfinite(values).any() else int(info.uses.argmin())
        named = zip(info.problem.pose_labels, values.tolist(), strict=True)
        scores = {f"value_{label}": value for label, value in named if value > -np.inf}
        return Decision(Probe(best), {"target_prob": info.target_prob, **scores})

    def touch_values(self, belief: Floats, counts: Counts) -> Floats:
        """Value of a touch in each pose followed by the plan, ``(P,)``; -inf where a touch tells nothing new."""
        found = np.full(len(counts), -np.inf)
        for pose, weight, following in self._touches(self._vectors, counts):
            joint = (belief[:, None] * self.table.probs[pose]).T  # (M, K)
            found[pose] = (
                weight * following.value(joint).sum() + (1.0 - weight) * following.value(belief[None])[0] - 1.0
            )
        return found

    @cached_property
    def _vectors(self) -> dict[Counts, AlphaVectors]:
        """Alpha vectors of plans that begin with a touch, by the touches that the poses have had."""
        rng, found = np.random.default_rng(0), dict[Counts, AlphaVectors]()
        likelihoods = np.ascontiguousarray(np.moveaxis(self.table.probs, 2, 1))  # (P, M, K)
        problem = StagedProblem((), self._prior, self.table.probs, 1.0, 1.0)
        for number in _ROUNDS:
            reached = self._reached(found, number, rng)
            for counts in sorted(reached, key=sum, reverse=True):
                beliefs = different(np.array(reached[counts]))
                tried = []
                for pose, weight, following in self._touches(found, counts):
                    part = backup(problem, likelihoods[pose : pose + 1], following, beliefs, weight)
                    tried.append(AlphaVectors(part.alphas, np.full(len(beliefs), pose)))
                if tried:
                    best = np.argmax([(one.alphas * beliefs).sum(axis=1) for one in tried], axis=0)
                    rows = np.arange(len(beliefs))
                    alphas = np.array([one.alphas for one in tried])[best, rows]
                    new = AlphaVectors(alphas, np.array([one.actions for one in tried])[best, rows])
                    found[counts] = (found[counts].joined(new) if counts in found else new).useful(beliefs)
        return found

    def _touches(self, known: dict[Counts, AlphaVectors], counts: Counts) -> Iterator[tuple[int, float, AlphaVectors]]:
        """Poses in which a touch can tell something, the weight of the touch, and vectors for what follows."""
        if sum(counts) >= self.max_touches:
            return
        weights = 1.0 / (1.0 + np.array(counts) @ self.kernel)
        for pose, count in enumerate(counts):
            if count < self.repeats:
                after = (*counts[:pose], count + 1, *counts[pose + 1 :])
                yield pose, float(weights[pose]), self._following(known, after)

    def _following(self, known: dict[Counts, AlphaVectors], counts: Counts) -> AlphaVectors:
        vectors = self._naming.joined(known[counts]) if counts in known else self._naming
        if len(vectors.alphas) - len(self._naming.alphas) < _FEW:
            for other, more in known.items():
                if other != counts and all(n >= m for n, m in zip(other, counts, strict=True)):
                    vectors = vectors.joined(more)
                if len(vectors.alphas) - len(self._naming.alphas) >= 2 * _FEW:
                    break
        return vectors

    @cached_property
    def _naming(self) -> AlphaVectors:
        """A vector for naming each label."""
        size = self.table.probs.shape[1]
        loss = 2.0 / max(1.0 - self.threshold, 1e-3)
        return AlphaVectors(loss * (np.eye(size) - 1.0), np.full(size, len(self.kernel)))

    @property
    def _prior(self) -> Floats:
        size = self.table.probs.shape[1]
        return np.full(size, 1.0 / size)

    def _reached(
        self, known: dict[Counts, AlphaVectors], number: int, rng: np.random.Generator
    ) -> dict[Counts, list[Floats]]:
        """Beliefs below the threshold that simulated namings reach, by the touches of the poses."""
        probs, found = self.table.probs, dict[Counts, list[Floats]]()
        for _ in range(number):
            label, belief = int(rng.integers(probs.shape[1])), self._prior
            counts: Counts = (0,) * len(probs)
            while belief.max() < self.threshold and sum(counts) < self.max_touches:
                left = [pose for pose, count in enumerate(counts) if count < self.repeats]
                if not left:
                    break
                found.setdefault(counts, []).append(belief)
                pose = self._simulated(known, belief, counts, left, rng)
                weight = 1.0 / (1.0 + np.array(counts) @ self.kernel[pose])
                if rng.random() < weight:
                    outcome = rng.choice(probs.shape[2], p=probs[pose, label] / probs[pose, label].sum())
                    belief = belief * probs[pose, :, outcome]
                    belief = belief / belief.sum()
                counts = (*counts[:pose], counts[pose] + 1, *counts[pose + 1 :])
        return found

    def _simulated(
        self,
        known: dict[Counts, AlphaVectors],
        belief: Floats,
        counts: Counts,
        left: list[int],
        rng: np.random.Generator,
    ) -> int:
        """The pose of the plan so far where there is one, else that with the largest gain; sometimes a random one."""
        if rng.random() < _EXPLORATION:
            return int(rng.choice(left))
        if counts in known:
            return int(known[counts].actions[known[counts].best(belief[None])[0]])
        weights = 1.0 / (1.0 + np.array(counts) @ self.kernel)
        gains = expected_information_gain(belief, self.table.probs) * weights
        return max(left, key=lambda pose: float(gains[pose]))
