"""Probe selectors: rules that choose the next pose; and the best fixed order, how it is found and kept in a file.

Touches of one object in one pose are correlated, so a table of single touches overstates the information of a repeat.
:func:`repeat_discount` takes the discount of repeats from the observation model (decision 0002).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.bayes import target_information_gain
from belief.constraints import Checked, Count, Probability, Within, check
from belief.errors import ActiveTouchError, CorruptFile, InvalidArgument, UnknownName
from belief.files import sealed_json, unsealed_json, write_text
from belief.observation_model.model import ObservationModel
from belief.observation_model.outcome_mixture import OutcomeMixture, information, target_shares
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Probe
from belief.validation import Floats
from planners.decider import Decision, InformationState, pose_scores, require_fit


@dataclass(frozen=True)
class RepeatDiscount:
    """Discounts touches in used poses by the correlation ρ of touches in one pose, in [0, 1], or None.

    The weight of the n-th touch is the difference of
    :func:`~belief.observation_model.repeat_discount.effective_touches` for n and n - 1 touches. Without a correlation,
    only the least used poses are allowed (decision 0019).
    """

    correlation: Probability | None = None

    def __post_init__(self) -> None:
        check(self)

    def weights(self, uses: ArrayLike) -> Floats:
        """Value of the next touch in each pose relative to a new touch's, for ``uses (..., P)``; 0 forbids a pose."""
        n, rho = np.asarray(uses, np.float64), self.correlation
        if rho is None:
            return (n == n.min(axis=-1, keepdims=True)).astype(np.float64)
        # The difference of effective_touches at n + 1 and n, without cancellation.
        return np.where(n > 0.0, (1.0 - rho) / ((1.0 + n * rho) * (1.0 + np.maximum(n - 1.0, 0.0) * rho)), 1.0)


LEAST_USED = RepeatDiscount()
"""Allows only the least used poses."""


def weights_in_turn(repeats: RepeatDiscount, num_poses: int, times: int) -> Floats:
    """Weights of an object's first, second, … touch if each of P poses is used ``times`` times in turn, ``(P times,)``.

    >>> weights_in_turn(RepeatDiscount(0.5), 2, 2).round(3).tolist()
    [1.0, 1.0, 0.333, 0.333]
    """
    return np.repeat([repeats.weights(np.full(num_poses, used)).max() for used in range(times)], num_poses)


def repeat_discount(model: ObservationModel | None) -> RepeatDiscount:
    """The discount by the ``repeat_correlation`` of an observation model, if it has one."""
    return RepeatDiscount(getattr(model, "repeat_correlation", None))


OUTCOMES = 128
HYPOTHESES = 32


def next_touch(
    info: InformationState,
    shares: Floats | None,
    table: OutcomeTable,
    repeats: RepeatDiscount,
    outcomes: int = OUTCOMES,
    hypotheses: int = HYPOTHESES,
) -> tuple[NDArray[np.floating], Floats]:
    """Joint probabilities of the next touch, and the value of a touch in each pose as a fraction of one with these.

    Args:
        info: the information state.
        shares: of the belief in what the touch is to distinguish: one row for each answer, ``(J, K)``; None for
            hypotheses about the body, or, without any, shapes.
        table: p(outcome | pose, shape) of single touches, for models that take touches as independent given the shape.
        repeats: discounts the value of repeated poses, for the same models.
        outcomes: of a mixture, at most.
        hypotheses: about the object that a mixture works with, of each shape, at most.

    Returns:
        p(answer, outcome | pose), ``(P, J, M)``, and weights in [0, 1], ``(P,)``; a pose with weight zero is not used.
    """
    evidence = info.evidence
    mixture = None if evidence is None else evidence.outcome_mixture(outcomes, hypotheses)
    if mixture is None:
        return (np.diag(info.belief.probs) if shares is None else shares) @ table.probs, repeats.weights(info.uses)
    joint = mixture.of_hypotheses(info.belief.probs) if shares is None else mixture.one_touch(shares)
    return joint, np.ones(len(joint)) if mixture.new is None else mixture.new


_MOST_ANSWERS = 64  # shapes that a touch is to tell apart
_ALIKE = 1e-9  # difference of gains [nats]
_LEAST_GAIN = 1e-3  # about shape and hypothesis together, below which a touch is no part of a good pair [nats]


@dataclass(frozen=True)
class FixedOrder:
    """Poses 0, 1, 2, … in turn, repeated: the paper's manual sequence (§6.3)."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        return Decision(Probe(len(info.history) % info.problem.num_poses), {"target_prob": info.target_prob})


@dataclass(frozen=True)
class GivenOrder:
    """Poses in a given order, repeated: for example the best fixed order that was found on other objects.

    Attributes:
        order: labels of poses; those that are missing come last, as the problem has them.
    """

    order: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.order or len(set(self.order)) < len(self.order):
            raise InvalidArgument(f"an order needs at least one pose, and each at most once, got {self.order}")

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`.

        Raises:
            UnknownName: the problem has no such pose.
        """
        labels = tuple(info.problem.pose_labels)
        if unknown := [label for label in self.order if label not in labels]:
            raise UnknownName("pose", unknown[0], list(labels))
        order = [*self.order, *(label for label in labels if label not in self.order)]
        label = order[len(info.history) % len(order)]
        return Decision(Probe(labels.index(label)), {"target_prob": info.target_prob})


@dataclass(frozen=True)
class RandomOrder:
    """All poses once in random order, then again: a baseline for the choice of poses."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        uses = info.uses
        return Decision(Probe(int(rng.choice(np.flatnonzero(uses == uses.min())))), {"target_prob": info.target_prob})


@dataclass(frozen=True, eq=False)
class TargetInformationGain(Checked):
    """The pose with the largest expected information gain about whether this object is the target.

    Where the evidence has an outcome mixture, the gain is that after the touches so far. Otherwise the gain is that of
    the table; for a pose that was used before it is multiplied by its repeat weight. Of equally good poses the least
    used is chosen, then the lowest.

    Attributes:
        table: p(outcome | pose, shape) of single touches.
        repeats: discounts the value of repeated poses; by default only the poses used least are candidates.
        outcomes: of a mixture, at most: more are more accurate and slower.
        hypotheses: about the object that a mixture works with, of each shape, at most.
        given: "body", or "shape" for the table even where there is a mixture; poses that are alike to it are then
            drawn at random. It is the baseline for what orientation and size are worth.
    """

    table: OutcomeTable
    repeats: RepeatDiscount = LEAST_USED
    outcomes: Count = OUTCOMES
    hypotheses: Count = HYPOTHESES
    given: Literal["body", "shape"] = "body"

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        require_fit(self.table, info.problem)
        if self.given == "shape":
            gains = target_information_gain(info.probs, self.table.probs, info.target)
            return _best(info, gains, self.repeats.weights(info.uses), rng)
        shares = self._shares(info)
        joint, weights = next_touch(info, shares, self.table, self.repeats, self.outcomes, self.hypotheses)
        return _best(info, information(joint), weights)

    def _shares(self, info: InformationState) -> Floats | None:
        """What the touch is to distinguish, as of :func:`next_touch`."""
        return target_shares(info.probs, info.target)


@dataclass(frozen=True, eq=False)
class ShapeInformationGain(TargetInformationGain):
    """The pose with the largest expected information gain about the shape of this object.

    It is the usual criterion of active perception. In the scene ``keyed`` it needs as many touches as the gain about
    the target. Beside the 64 most probable shapes, all others count as one. Attributes as of
    :class:`TargetInformationGain`; ``given`` is "body".

    Attributes:
        depth: 2 looks two touches ahead, where the evidence has an outcome mixture and the limit allows both: a touch
            that tells nothing by itself may say which other one does. It costs P times as much.
        costs: of a touch in each pose, ``(P,)``; the pose has the largest gain for its cost. All equal by default.
    """

    given: Literal["body"] = field(default="body", init=False)
    depth: Annotated[int, Within(1, 2)] = 1
    costs: Floats | None = None

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        require_fit(self.table, info.problem)
        shares = self._shares(info)
        joint, weights = next_touch(info, shares, self.table, self.repeats, self.outcomes, self.hypotheses)
        costs = np.ones(len(joint)) if self.costs is None else self.costs
        evidence = info.evidence if self.depth > 1 and len(info.history) + 1 < info.problem.touch_limit else None
        mixture = None if evidence is None else evidence.outcome_mixture(self.outcomes, self.hypotheses)
        if not isinstance(mixture, OutcomeMixture):
            return _best(info, information(joint) / costs, weights)
        values = _with_second(mixture, shares, information(joint) * weights, costs, weights)
        return _best(info, values, np.where(weights > 0.0, 1.0, 0.0))

    def _shares(self, info: InformationState) -> Floats:
        probs = info.belief.probs  # of listed shapes: what a touch tells about strangers is not predicted
        if len(probs) <= _MOST_ANSWERS:
            return np.diag(probs)
        likely = np.argpartition(-probs, _MOST_ANSWERS)[:_MOST_ANSWERS]
        is_likely = likely[:, None] == np.arange(len(probs))
        return np.vstack([is_likely, ~is_likely.any(axis=0)]) * probs


@dataclass(frozen=True, eq=False)
class PoseInformationGain(TargetInformationGain):
    """The pose with the largest expected information gain about how the object lies, and about its shape.

    It is for those who grasp what they find: once the shape is known, other criteria have nothing more to ask. Without
    hypotheses about a body, as in a table of single touches, it is :class:`ShapeInformationGain`. Attributes as of
    :class:`TargetInformationGain`; ``given`` is "body".
    """

    given: Literal["body"] = field(default="body", init=False)

    def _shares(self, info: InformationState) -> None:
        return None


def _with_second(mixture: OutcomeMixture, shares: Floats, gains: Floats, costs: Floats, weights: Floats) -> Floats:
    """Gain of a touch in each pose, or of it and the best second one in another pose, for the cost, ``(P,)``."""
    found = gains / costs
    kept = np.flatnonzero((weights > 0.0) & (information(mixture.of_hypotheses(shares.sum(axis=0))) > _LEAST_GAIN))
    rest = OutcomeMixture(mixture.weights, mixture.probs[kept]) if kept.size else mixture
    for place, pose in enumerate(kept.tolist()):
        joint = rest.two_touches(place, shares).transpose(1, 2, 0, 3)  # (M, P', J, M')
        second = information(joint)
        second[:, place] = 0.0
        chosen = (second / costs[kept]).argmax(axis=1)  # after each outcome
        outcomes = np.arange(len(chosen))
        cost = joint.sum(axis=(2, 3))[outcomes, chosen] @ costs[kept][chosen]
        found[pose] = max(found[pose], (gains[pose] + second[outcomes, chosen].sum()) / (costs[pose] + cost))
    return found


def _best(
    info: InformationState, gains: Floats, weights: Floats, tie_breaker: np.random.Generator | None = None
) -> Decision:
    """The best pose; of equally good ones the least used, then the lowest, or one at random."""
    uses = info.uses
    values = np.where(weights > 0.0, gains * weights, -np.inf)
    best = np.flatnonzero(values >= values.max() - (0.0 if tie_breaker is None else _ALIKE))
    if tie_breaker is not None:
        best = tie_breaker.permutation(best)
    scores = {"target_prob": info.target_prob, **pose_scores("gain", info.problem, gains * weights)}
    return Decision(Probe(int(best[uses[best].argmin()])), scores)


ORDER_FILE = "order.json"
"""Name of the file of the best fixed order in a sensor's folder."""


class NoOrder(ActiveTouchError, FileNotFoundError):
    """A sensor has no best order of poses."""


def greedy_order(
    num_poses: int, length: int, loss: Callable[[tuple[int, ...]], float]
) -> tuple[tuple[int, ...], Floats]:
    """Poses one by one, each the one with which the touches so far have the lowest loss; of equal ones the first.

    Args:
        num_poses: P.
        length: of the order, at most P.
        loss: of touches in some poses, without one of them twice.

    Returns:
        The order, and the loss after each of its touches.
    """
    order: tuple[int, ...] = ()
    losses: list[float] = []
    while len(order) < length:
        found = {(*order, pose): loss((*order, pose)) for pose in range(num_poses) if pose not in order}
        order = min(found, key=lambda poses: found[poses])
        losses.append(found[order])
    return order, np.array(losses)


def write_order(folder: Path, labels: Sequence[str], losses: Floats) -> None:
    """Write an order of poses into a sensor's folder."""
    write_text(folder / ORDER_FILE, sealed_json({"order": list(labels), "nll": losses.round(5).tolist()}, 1) + "\n")


def read_order(folder: Path | None) -> tuple[str, ...]:
    """The order of poses in a sensor's folder.

    Raises:
        NoOrder: there is none.
        CorruptFile: the file is damaged.
    """
    path = None if folder is None else folder / ORDER_FILE
    if path is None or not path.is_file():
        raise NoOrder(f"there is no order of poses{f' in {folder}' if folder else ''}; activetouch calibrate finds one")
    try:
        order = unsealed_json(path.read_text(encoding="utf-8"))["order"]
        return tuple(str(label) for label in order)
    except (OSError, ValueError, KeyError, TypeError, json.JSONDecodeError) as error:
        raise CorruptFile(f"{path} is no order of poses: {error}") from error
