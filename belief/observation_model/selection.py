"""Choice of an observation model by cross-validated loss on sequences of touches of held-out objects."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.bayes import update
from belief.errors import OverconfidentStops
from belief.metrics.calibration_at_stop import CalibrationAtStop, calibration_at_stop
from belief.naming import few
from belief.observation_model.calibration_data import numbered_objects, object_folds
from belief.observation_model.model import ArrayModel
from belief.observation_model.registry import Fit, fits
from belief.problem import Touch
from belief.statistics.stop_thresholds import CandidateStops, CertifiedThresholds, certified_thresholds
from belief.table import Table, Tabular, interval
from belief.touch_batch import TouchBatch, grouped
from belief.validation import (
    Floats,
    as_real,
    labelled_logits,
    pose_count,
    require_count,
    require_fraction,
    unmasked,
    warn_of_probs,
)

NUM_FOLDS = 5
"""Default number of folds of whole objects."""
_LONGEST = 12  # touches of a sequence
_STOP = 0.95  # posterior at which held-out objects stop
_EXCESS = 0.03  # of what is stated at stops over what is right, beyond its interval, from which a fit warns


@dataclass(frozen=True, eq=False)
class ModelChoice(Tabular):
    """The chosen observation model, and the losses of all candidates; prints as a table.

    Attributes:
        name: of the chosen candidate, a key of ``losses``.
        model: fitted to all touches.
        losses: cross-validated sequence NLL of every candidate [nats]; the chosen one has the least.
        stops: stated confidence and accuracy of the chosen one where held-out objects, each by a model fitted to other
            folds, reach a posterior of 0.95 within twelve touches; None if none does, or without cross-validation.

    >>> from belief.synthetic import random_model
    >>> choice = ModelChoice("ratio", random_model(np.random.default_rng(0)), {"plda": 0.358, "ratio": 0.357})
    >>> print(choice)
    observation model  NLL [nats]  chosen
    ─────────────────────────────────────
    ratio                  0.3570  yes
    plda                   0.3580
    """

    name: str
    model: ArrayModel
    losses: Mapping[str, float]
    stops: CalibrationAtStop | None = None

    @property
    def at_stops(self) -> str:
        """What is stated and what is right at the stops of held-out objects, as a sentence; empty without stops."""
        if self.stops is None:
            return ""
        found, total = self.stops.overall, self.stops.overall.count + self.stops.never
        return (
            f"Held-out stops at {_STOP:g}: {found.count} of {total}, stated {found.mean_stated:.3f}, "
            f"right {interval(found.share_right, found.low, found.high, spec='.3f')}."
        )

    def table(self) -> Table:
        """The losses of the candidates, the least first."""
        ordered: list[tuple[str, float | None]] = [*sorted(self.losses.items(), key=lambda pair: pair[1])]
        rows = [(name, loss, "yes" if name == self.name else "") for name, loss in ordered or [(self.name, None)]]
        return Table("", ["observation model", ("NLL [nats]", ".4f", "nll"), ("chosen", "")], rows, self.at_stops)


def log_posteriors(model: ArrayModel, batch: TouchBatch) -> Floats:
    """Log posterior after each sequence of touches of one object, under a uniform prior, ``(S, K)``.

    >>> from belief.synthetic import random_model
    >>> model = random_model(np.random.default_rng(0), num_shapes=2)
    >>> once, twice = (TouchBatch.of([[Touch(0, np.array([1.0, 0.0]))] * n]) for n in (1, 2))
    >>> np.exp(log_posteriors(model, once)).round(2).tolist(), np.exp(log_posteriors(model, twice)).round(2).tolist()
    ([[0.83, 0.17]], [[0.96, 0.04]])
    """
    log_likelihoods = model.log_likelihood_batch(batch)
    num_shapes = log_likelihoods.shape[1]
    return update(np.full(num_shapes, -np.log(num_shapes)), log_likelihoods)[0]


def log_posteriors_by_touch(model: ArrayModel, batch: TouchBatch) -> Floats:
    """Log posteriors after 1 to n touches of each sequence, under a uniform prior, ``(S, n, K)``.

    >>> from belief.synthetic import random_model
    >>> model = random_model(np.random.default_rng(0), num_shapes=2)
    >>> log_posteriors_by_touch(model, TouchBatch(np.zeros((3, 4), int), np.zeros((3, 4, 2)))).shape
    (3, 4, 2)
    """
    return np.stack([log_posteriors(model, batch.first(n)) for n in range(1, batch.num_touches + 1)], axis=1)


def _sequence_nll(
    model: ArrayModel, batch: TouchBatch, truth: NDArray[np.int64], objects: NDArray[np.generic]
) -> float:
    """Mean negative log posterior of the true shape after 1, 2, … touches of an object under a uniform prior [nats]."""
    _, owner = np.unique(objects, return_inverse=True)
    means = []
    for kind in (owner, owner * (int(batch.poses.max()) + 1) + batch.poses[0]):
        losses = []
        for some, rows in grouped(batch, kind):
            for n in range(1, min(some.num_touches, _LONGEST) + 1):
                found = log_posteriors(model, some.first(n))
                losses.append(-found[np.arange(len(found)), truth[rows[:, 0]]])
        means.append(np.concatenate(losses).mean())
    return float(np.mean(means))


def choose_observation_model(
    touches: Sequence[Touch],
    shapes: ArrayLike,
    object_ids: ArrayLike,
    *,
    shape_labels: Sequence[str],
    num_poses: int,
    candidates: Mapping[str, Fit] = MappingProxyType(fits()),
    num_folds: int = NUM_FOLDS,
) -> ModelChoice:
    """The candidate with the least loss on sequences of touches of held-out objects, fitted to all touches.

    The loss is the mean negative log posterior of the true shape after one touch, two, and so on, half of it over
    touches of an object in their order, half over touches in one pose; it is averaged over folds of whole objects.
    An :class:`~belief.errors.OverconfidentStops` warns if the stops of held-out objects state more than is right, a
    UserWarning if a shape has no touch, or no object has two.

    Args:
        touches: calibration touches.
        shapes: true shape of each, ``(n,)``.
        object_ids: object of each, ``(n,)``.
        shape_labels: names of the K shapes.
        num_poses: P.
        candidates: functions that fit a model, by name.
        num_folds: from 2 to the number of objects.

    Raises:
        ValueError: no candidates, ``num_folds`` is out of range, or as the candidates.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng = np.random.default_rng(0)
        >>> source, ids = random_model(rng, num_shapes=2, num_poses=2), np.arange(400) // 4
        >>> touches = [touch for i in range(100) for touch in source.sample(i % 2, [0, 1, 0, 1], rng)]
        >>> some = {name: fits()[name] for name in ("confusion", "ratio")}
        >>> choice = choose_observation_model(
        ...     touches, ids % 2, ids, shape_labels=("cube", "cone"), num_poses=2, candidates=some
        ... )
        >>> choice.name == min(choice.losses, key=choice.losses.get)
        True
    """
    if not candidates:
        raise ValueError("there are no candidates to choose from")
    require_count("num_folds", num_folds, least=2)
    truth, ids, batch = np.asarray(shapes), np.asarray(object_ids), TouchBatch.of([touches])
    folds = object_folds(truth, ids, num_folds)
    _warn_of_gaps(truth, ids, shape_labels)
    options: dict[str, Any] = {"shape_labels": tuple(shape_labels), "num_poses": num_poses}
    losses: dict[str, float] = {}
    of_folds: list[ArrayModel] = []  # the models of the best candidate
    for name, fit in candidates.items():
        each, models = [], []
        for fold in range(num_folds):
            kept, held = np.flatnonzero(folds != fold), np.flatnonzero(folds == fold)
            models.append(fit([touches[i] for i in kept.tolist()], truth[kept], ids[kept], **options))
            each.append(_sequence_nll(models[-1], batch.touches(held), truth[held], ids[held]))
        losses[name] = float(np.mean(each))
        of_folds = models if min(losses, key=losses.__getitem__) == name else of_folds
    best, stops = min(losses, key=losses.__getitem__), []
    for fold, model in enumerate(of_folds):
        held = np.flatnonzero(folds == fold)
        stops.append(_candidates(model, batch.touches(held), truth[held], ids[held], _LONGEST))
    choice = ModelChoice(best, candidates[best](touches, shapes, object_ids, **options), losses, _stopped(stops, _STOP))
    if choice.stops is not None and choice.stops.overall.excess > _EXCESS:
        warnings.warn(
            f"{choice.at_stops} The stated probabilities of {best} are too high for stopping: stop at the thresholds "
            "of certified_stops, fitted to other objects, or record more objects and touches",
            OverconfidentStops,
            stacklevel=2,
        )
    return choice


def _warn_of_gaps(truth: NDArray[np.integer], ids: NDArray[Any], labels: Sequence[str]) -> None:
    """A UserWarning where the model of a shape, or how far touches of an object repeat each other, is only assumed."""
    if absent := [label for k, label in enumerate(labels) if not (truth == k).any()]:
        warnings.warn(
            f"no touch is of the shape {few(absent)}: what the model states of it is a guess; add touches of such "
            "objects, or leave the shape and its logits out",
            stacklevel=3,
        )
    if len(np.unique(ids)) == len(ids):
        warnings.warn(
            f"each of {len(ids)} objects has one touch: how far touches of one object repeat each other is assumed, "
            "and posteriors after several may be wrong; give objects that were touched several times, with one label "
            "of groups (object_ids) for all touches of an object",
            stacklevel=3,
        )


def fit_observation_model(
    logits: ArrayLike,
    labels: ArrayLike,
    groups: ArrayLike,
    poses: ArrayLike | None = None,
    *,
    shape_labels: Sequence[str] | None = None,
    num_poses: int | None = None,
    candidates: Mapping[str, Fit] | None = None,
    num_folds: int = NUM_FOLDS,
) -> ModelChoice:
    """Fit the observation models to touches of known objects, and choose the one with the least cross-validated loss.

    The objects must be others than those with which the classifier was trained. Where they were touched several times
    in a pose, the models learn how far such touches repeat each other.

    Args:
        logits: ``(n, K)``; :func:`~belief.calibration.logits_from_probs` makes them from probabilities.
        labels: true shape of each touch, ``(n,)``, in [0, K).
        groups: object of each touch, ``(n,)``, any labels that can be sorted.
        poses: pose, view or sensor of each touch, ``(n,)``, integers from 0; one and the same by default.
        shape_labels: names of the K shapes; "0", "1", … by default.
        num_poses: P; by default one more than the largest pose.
        candidates: functions that fit a model, by name; by default all that read logits.
        num_folds: folds of whole objects, at most the number of objects.

    Returns:
        The choice, which prints as a table with what is stated and right at the stops of held-out objects; its
        ``model`` is ready for a :class:`~belief.BeliefTracker`. An :class:`~belief.errors.OverconfidentStops` warns if
        more is stated than is right, a UserWarning if a shape has no touch, or no object has two.

    Raises:
        ValueError: arrays that do not fit, NaN or infinite logits, labels or poses out of range, an object with two
            labels, or fewer objects than folds.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng, groups = np.random.default_rng(0), np.arange(400) // 4
        >>> source = random_model(rng, num_shapes=2, num_poses=1)
        >>> logits = [touch.logits for i in range(100) for touch in source.sample(i % 2, [0] * 4, rng)]
        >>> choice = fit_observation_model(logits, groups % 2, groups, shape_labels=("mug", "ball"))
        >>> choice.name == min(choice.losses, key=choice.losses.get), choice.model.shape_labels
        (True, ('mug', 'ball'))
    """
    batch, y = _batch(logits, labels, groups, poses, 3)
    return choose_observation_model(
        batch.sequence(0),
        y,
        groups,
        shape_labels=tuple(map(str, range(batch.num_shapes))) if shape_labels is None else shape_labels,
        num_poses=pose_count(batch.poses[0], num_poses),
        candidates=fits() if candidates is None else candidates,
        num_folds=num_folds,
    )


def calibration_of_stops(
    model: ArrayModel,
    logits: ArrayLike,
    labels: ArrayLike,
    groups: ArrayLike,
    threshold: float = 0.95,
    poses: ArrayLike | None = None,
) -> CalibrationAtStop:
    """Touch each object until a shape has a given posterior; compare what is stated then with what is right.

    The prior is uniform, and the ``threshold`` of the posterior is in (1/K, 1). The arrays are as of
    :func:`fit_observation_model`, of objects other than those to which the model was fitted; the touches of an object
    are in the order of the rows.

    Returns:
        Stated confidence and accuracy by number of touches; objects for which no shape becomes so probable are counted
        in ``never``.

    Raises:
        ValueError: as :func:`fit_observation_model`; a threshold out of range, or one that no object reaches.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng, groups = np.random.default_rng(0), np.arange(400) // 4
        >>> model = random_model(rng, num_shapes=2, num_poses=1)
        >>> logits = [touch.logits for i in range(100) for touch in model.sample(i % 2, [0] * 4, rng)]
        >>> print(calibration_of_stops(model, logits, groups % 2, groups))
        touches  count  stated  right           95 %
        ────────────────────────────────────────────
        2           73   0.971  1.000  0.951 … 1.000
        4           18   0.992  1.000  0.815 … 1.000
        all         91   0.975  1.000  0.960 … 1.000
        9 more never reach the threshold.
    """
    require_fraction("threshold", threshold)
    num_shapes = len(model.shape_labels)
    if threshold * num_shapes <= 1.0:
        raise ValueError(f"threshold must be above 1/K = {1 / num_shapes:.3g}, got {threshold}")
    found = _stopped([_candidates(model, *_batch(logits, labels, groups, poses, 3), groups)], threshold)
    if found is None:
        raise ValueError(f"no object reaches a posterior of {threshold} with its touches; lower the threshold")
    return found


def certified_stops(
    model: ArrayModel,
    logits: ArrayLike,
    labels: ArrayLike,
    groups: ArrayLike,
    risk: float = 0.05,
    confidence: float = 0.9,
    poses: ArrayLike | None = None,
    *,
    by_answer: bool = False,
) -> CertifiedThresholds:
    """Posteriors at which to stop, so that at every number of touches at most a given fraction of stops is wrong.

    The thresholds belong together: for each object, stop at the first touch k at which some shape has a posterior of at
    least ``thresholds[k - 1]``, of the last one for more touches. Numbers of touches after which few objects stop are
    pooled in this last one: the promise is for their stops together. :mod:`belief.statistics.stop_thresholds` has the
    theorem and its proof. The promise is for objects drawn as these, touched in the same way.

    This allows that most of the stops that name a rare shape are wrong. ``by_answer`` promises the same for *every
    shape that is named*, over all numbers of touches together: stop at the first touch at which the most probable shape
    k has a posterior of at least ``thresholds[k]``. A shape that is too rare, or too often named wrongly, is never
    named: its threshold is infinite.

    The arrays are as of :func:`calibration_of_stops`, of independent objects; stated posteriors need not be right. The
    fraction ``risk``, and the ``confidence`` with which the promise holds, are in (0, 1).

    Returns:
        The thresholds; infinite where nothing is promised. All are if there are too few objects: fewer than
        :func:`~belief.statistics.stop_thresholds.least_searches`, or some times as many where some stops are wrong. It
        prints as a table, with the reason if nothing is promised.

    Raises:
        ValueError: as :func:`fit_observation_model`; a number out of its range, or fewer than two objects.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng, groups = np.random.default_rng(0), np.arange(1600) // 4
        >>> model = random_model(rng, num_shapes=2, num_poses=1)
        >>> logits = [touch.logits for i in range(400) for touch in model.sample(i % 2, [0] * 4, rng)]
        >>> print(certified_stops(model, logits, groups % 2, groups, risk=0.1))
        After every number of touches, at most 0.1 of the stops are wrong, with
        confidence 0.9, from 400 objects
        touches  stop from  stops  wrong
        ────────────────────────────────
        1            never      0      0
        ≥ 2           0.65    200     12
        Last row: so many and more, together. Stops: of the half that tests.
    """
    batch, y = _batch(logits, labels, groups, poses, 3)
    candidates = _candidates(model, batch, y, groups, by_answer=by_answer)
    place = np.random.default_rng(0).permutation(candidates.num_searches)  # an order that says nothing about them
    candidates = candidates.of(np.argsort(place))
    words = "touches", "objects"
    if by_answer:
        return certified_thresholds(candidates, risk, confidence, model.shape_labels, words)
    earlier = replace(candidates, touches=candidates.touches - 1)  # entry k - 1 is of touch k
    return replace(certified_thresholds(earlier, risk, confidence, words=words), first=1)


def _candidates(
    model: ArrayModel,
    batch: TouchBatch,
    labels: NDArray[np.int64],
    groups: ArrayLike,
    most: int | None = None,
    *,
    by_answer: bool = False,
) -> CandidateStops:
    """What is stated after each of at most so many touches of every object, under a uniform prior.

    By answer, the most probable shape stands in place of the number of touches.
    """
    every: list[CandidateStops] = []
    for some, rows in grouped(batch, groups):
        log_probs = log_posteriors_by_touch(model, some.touches(slice(most)))
        found = CandidateStops.of_posteriors(log_probs, labels[rows[:, 0]])
        every.append(replace(found, touches=log_probs.argmax(axis=2).ravel()) if by_answer else found)
    before = np.cumsum([0, *(some.num_searches for some in every)])
    searches = [some.searches + first for some, first in zip(every, before[:-1], strict=True)]
    touches, probs, is_wrong = (
        np.concatenate([getattr(some, name) for some in every]) for name in ("touches", "probs", "is_wrong")
    )
    return CandidateStops(np.concatenate(searches), touches, probs, is_wrong, int(before[-1]))


def _stopped(candidates: Sequence[CandidateStops], threshold: float) -> CalibrationAtStop | None:
    """Calibration where searches reach a threshold; None if none does."""
    rows = [some.stops([threshold]) for some in candidates]
    stated, is_wrong, touches = (
        np.concatenate([getattr(some, name)[index] for some, index in zip(candidates, rows, strict=True)])
        for name in ("probs", "is_wrong", "touches")
    )
    if not len(stated):
        return None
    never = sum(some.num_searches for some in candidates) - len(stated)
    return replace(calibration_at_stop(stated, ~is_wrong, touches), never=never)


def _batch(
    logits: ArrayLike, labels: ArrayLike, groups: ArrayLike, poses: ArrayLike | None, callers: int
) -> tuple[TouchBatch, NDArray[np.int64]]:
    """All touches as one sequence, and their labels."""
    z, y = labelled_logits(logits, labels)
    warn_of_probs(as_real(logits, "logits"), "logits", "give belief.calibration.logits_from_probs of them", callers)
    ids = unmasked(groups, "groups")
    p = np.zeros(len(y), np.int64) if poses is None else unmasked(poses, "poses")
    for name, values in (("groups", ids), ("poses", p)):
        if values.shape != y.shape:
            raise ValueError(f"need one of {name} for each of {len(y)} touches, got shape {values.shape}")
    numbered_objects(y, ids)  # raises for an object with two labels
    return TouchBatch(p[None], z[None]), y
