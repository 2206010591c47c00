"""The search loop for all deciders, one episode at a time or many in lockstep (decision 0007); and naming one object.

The generator of a touch depends only on (episode seed, object, pose, number of earlier uses of that pose). Two deciders
that make the same touch in the same episode get the same result, so comparisons are paired. In lockstep, the touches of
all episodes are made in one call, so that a network processes many images at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.composition import Composition
from belief.constraints import SHARE, require_rule
from belief.errors import BrokenContract, InvalidArgument
from belief.naming import UNLISTED, Name, index_of
from belief.observation_model.model import ObservationModel
from belief.problem import Confirm, Probe, SearchProblem, Touch, Unsure
from belief.scene_belief import SceneBelief
from belief.seeding import checked_key, touch_rng
from belief.validation import Floats, require_count
from planners.decider import Decider, Decision, InformationState, ProbeSelector, SequentialDecider, require_decider
from planners.episode import Episode
from planners.probing import ShapeInformationGain
from planners.session import Session, likeliest
from planners.stopping import PosteriorThresholds, StopOverride


class World(Protocol):
    """A sequence of objects to touch."""

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shape of every object, in order of visit; for scoring only."""

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """Touch the current object."""

    def advance(self) -> None:
        """Go to the next object."""

    def reset(self) -> None:
        """Go to the first object."""


@runtime_checkable
class PlaysEpisodes(Protocol):
    """A decider that plays each episode by another one, such as a program that is told which episode it is in."""

    def begin(self, world: Any, key: tuple[int, ...]) -> Decider:
        """The decider of an episode in a world; the key is the seed of the episode."""


WorldT = TypeVar("WorldT", bound=World)


class TouchRequest(NamedTuple, Generic[WorldT]):
    """A touch for which an episode waits: of the current object of ``world``, in ``pose``, drawn with ``rng``."""

    world: WorldT
    pose: int
    rng: np.random.Generator


TouchMany: TypeAlias = Callable[[Sequence[TouchRequest[WorldT]]], Sequence[Touch]]


def search(
    world: World,
    decider: Decider,
    problem: SearchProblem,
    target: Name,
    model: ObservationModel,
    seed: int | Sequence[int],
    log_bets: ArrayLike = 0.0,
) -> Episode:
    """Search until an object is confirmed, all are rejected, the decider is unsure, or the touch limit is reached.

    Args:
        world: the objects, which are visited in order.
        decider: chooses the actions.
        problem: the search.
        target: label or index of the target shape.
        model: likelihood of touches.
        seed: seed of the episode, one number or several; the same seed gives the same episode.
        log_bets: log bets of an earlier search with the same set-up (:func:`log_bets_after`).

    Raises:
        UnknownName: no shape has the target's name.
        ValueError: a target out of range; an invalid seed; a world with another number of objects; a problem, a model
            and bets that do not fit each other, or a touch that does not fit the model.
        BadDecision: the decider returns an invalid decision.
        ImpossibleObservation: a touch has likelihood zero for every possible shape.
    """
    return search_lockstep([world], decider, problem, [target], model, [seed], log_bets=[log_bets])[0]


def search_lockstep(
    worlds: Sequence[WorldT],
    decider: Decider,
    problem: SearchProblem,
    targets: Sequence[Name],
    model: ObservationModel,
    seeds: Sequence[int | Sequence[int]],
    touch_many: TouchMany[WorldT] | None = None,
    log_bets: Sequence[ArrayLike] | None = None,
) -> list[Episode]:
    """:func:`search` for many episodes at once, in the order of ``worlds``, ``targets``, ``seeds`` and ``log_bets``.

    ``touch_many`` makes the touches of all waiting episodes; by default they are made one by one.

    Raises:
        ValueError: there are not as many targets, seeds or bets as worlds; or as :func:`search`, with its other errors.
    """
    labels = problem.shape_labels
    log_bets = [0.0] * len(worlds) if log_bets is None else log_bets
    for given, what in ((targets, "targets"), (seeds, "seeds"), (log_bets, "log_bets")):
        if len(given) != len(worlds):
            raise InvalidArgument(f"there must be as many {what} as worlds, {len(worlds)}, got {len(given)}")
    sessions = []
    for world, target, seed, bets in zip(worlds, targets, seeds, log_bets, strict=True):
        arrangement = tuple(int(shape) for shape in world.arrangement)
        if len(arrangement) != problem.num_objects:
            raise ValueError(f"the world has {len(arrangement)} objects, the problem {problem.num_objects}")
        world.reset()
        shape = index_of("target", labels, target)
        player = decider.begin(world, checked_key(seed)) if isinstance(decider, PlaysEpisodes) else decider
        session = Session(problem, player, shape, model, seed, abstain=False, log_bets=bets)
        session.arrangement = arrangement  # which may hold shapes that the problem does not know
        sessions.append(session)
    active = list(range(len(worlds)))
    while active:
        pending = {index: _next_request(sessions[index], worlds[index]) for index in active}
        requests = {index: request for index, request in pending.items() if request is not None}
        if touch_many is None:
            touches: Sequence[Touch] = [request.world.touch(request.pose, request.rng) for request in requests.values()]
        else:
            touches = touch_many(list(requests.values())) if requests else []
        for index, touch in zip(requests, touches, strict=True):
            sessions[index].tell(touch)
        active = list(requests)
    return [session.episode for session in sessions]


def _next_request(session: Session, world: WorldT) -> TouchRequest[WorldT] | None:
    """The touch that a session asks for after its other actions were carried out; None at the end of the search."""
    while (action := session.ask()) is not None:
        if isinstance(action, Probe):
            repeat = session.uses(action.pose)
            rng = touch_rng(session.seed, session.object_index, action.pose, repeat)
            return TouchRequest(world, action.pose, rng)
        session.tell()
        if session.outcome is None:
            world.advance()
    return None


def log_bets_after(
    episode: Episode, problem: SearchProblem, model: ObservationModel, log_bets: ArrayLike = 0.0
) -> Floats:
    """Log wealth of the conflict test after a search, ``(J,)``, with which the next search of the same robot begins.

    A robot outside the world of its observation model is outside it in every search, so evidence adds up over searches,
    and the false-alarm rate is for all of them together. ``episode`` needs the features of its touches; ``log_bets``
    are those with which it began.
    """
    scene = SceneBelief(problem, model, log_bets=log_bets)
    for step in episode.steps:
        if step.touch is not None:
            scene.update(step.object_index, [step.touch])
    return scene.log_bets


@dataclass(frozen=True)
class Identification:
    """An object that was named.

    Attributes:
        truth: its true label; :data:`belief.naming.UNLISTED` for none of them.
        named: the label that is named, or UNLISTED.
        stated: probability of that answer.
        poses: of its touches.
        is_certain: whether the probability reached the threshold.
        touches: what was felt.
        log_probs: log posterior of the labels after each touch, ``(n, K)``, in single precision; they sum to 1 less the
            probability of none of them.
    """

    truth: int
    named: int
    stated: float
    poses: tuple[int, ...]
    is_certain: bool
    touches: tuple[Touch, ...] = field(default=(), compare=False, repr=False)
    log_probs: NDArray[np.float32] | None = field(default=None, compare=False, repr=False)

    @property
    def is_right(self) -> bool:
        """Whether the named label is the true one."""
        return self.named == self.truth


def naming_session(
    decider: ProbeSelector | Decider,
    model: ObservationModel,
    pose_labels: Sequence[str],
    seed: int | Sequence[int] = 0,
    threshold: float | None = 0.95,
    max_touches: int = 16,
    unlisted: float = 0.0,
    opinion: ArrayLike | None = None,
    until: Callable[[int, Sequence[Touch]], bool] | None = None,
    abstain: bool = True,
    **settings: Any,
) -> Session:
    """A session that touches one object until a label has the probability ``threshold``, and names it.

    Its last action is Confirm where the object is named, and Unsure where no label became probable enough, or the
    touches contradict the model. :attr:`Session.answer` and :attr:`Session.stated` are the name and its probability.

    Args:
        decider: a selector of poses, whose target is label 0 and has no meaning; or a decider, which is asked about the
            most probable label. Of one that stops by the probability of the target, the selector is asked. Where
            another one would stop too early, the touch that tells most about the label is made.
        model: likelihood of touches; its labels are equally probable before the first.
        pose_labels: names of the P poses.
        seed: seed of the decider.
        threshold: probability at which to stop, in (0, 1]; None stops at ``max_touches`` alone.
        max_touches: ≥ 1.
        unlisted: prior probability that the object has none of the labels, which is one more answer, in [0, 1).
        opinion: probabilities of the labels from another source, ``(K,)`` (:attr:`belief.SearchProblem.opinion`).
        until: what else must hold of a label with that probability and its touches before they end, such as that it is
            known how the object lies; it is asked after each touch.
        abstain: whether nothing is named where touches contradict the model (:mod:`planners.abstaining`).
        settings: as of :class:`Session`.

    Raises:
        InvalidArgument: the threshold is out of its range, or the model cannot weigh unlisted shapes.

    >>> from belief.synthetic import random_model
    >>> from planners.probing import GivenOrder
    >>> model, rng = random_model(np.random.default_rng(0), sharpness=4.0), np.random.default_rng(1)
    >>> session = naming_session(GivenOrder(("a", "b", "c")), model, ("a", "b", "c"))
    >>> while isinstance(action := session.ask(), Probe):
    ...     _ = session.tell(model.sample(2, [action.pose], rng)[0])
    >>> _ = session.tell()
    >>> str(session.outcome), session.answer, session.stated > 0.95
    ('confirmed', 'shape_2', True)
    """
    if isinstance(decider, type) or not isinstance(decider, ProbeSelector):
        require_decider(decider)
    if threshold is not None:
        require_rule("threshold", threshold, SHARE)
    require_count("max_touches", max_touches)
    labels, poses = tuple(model.shape_labels), tuple(pose_labels)
    rules = {"touch_limit": max_touches, "unsure_reward": 0.0, "unlisted": unlisted, "opinion": opinion}
    problem = SearchProblem(labels, poses, 1, Composition.INDEPENDENT, **rules)  # type: ignore[arg-type]
    rule = _Certain(threshold, max_touches, until)
    player: Decider
    if isinstance(decider, SequentialDecider) and isinstance(decider.stopping, PosteriorThresholds):
        player = _ForLikeliest(SequentialDecider(rule, decider.probing))
    elif isinstance(decider, ProbeSelector):
        player = SequentialDecider(rule, decider)
    else:
        player = StopOverride(rule, _ForLikeliest(decider), ShapeInformationGain(model.outcome_table()))
    return Session(problem, _Naming(player, threshold, abstain), 0, model, seed, abstain=False, **settings)


def identify(
    world: World,
    decider: ProbeSelector | Decider,
    model: ObservationModel,
    pose_labels: Sequence[str],
    seed: int | Sequence[int],
    threshold: float | None = 0.9,
    max_touches: int = 12,
    unlisted: float = 0.0,
    opinion: ArrayLike | None = None,
    until: Callable[[int, Sequence[Touch]], bool] | None = None,
) -> Identification:
    """Touch the first object of a world until a label has the probability ``threshold``, or ``max_touches`` are made.

    Args:
        world: its first object is touched.
        decider, model, pose_labels, threshold, max_touches, unlisted, opinion, until: as of :func:`naming_session`.
        seed: seed of the touches and of the decider.

    Raises:
        InvalidArgument: as of :func:`naming_session`.
        BrokenContract: the selector chose another action than a touch.

    >>> from belief.synthetic import SyntheticWorld, random_model
    >>> from planners.probing import GivenOrder
    >>> model = random_model(np.random.default_rng(0), sharpness=4.0)
    >>> found = identify(SyntheticWorld(model, [2]), GivenOrder(("a", "b", "c")), model, ("a", "b", "c"), seed=1)
    >>> found.is_right, found.is_certain, found.poses
    (True, True, (0,))
    """
    rules = threshold, max_touches, unlisted, opinion, until
    session = naming_session(decider, model, pose_labels, seed, *rules, abstain=False)
    world.reset()
    while (request := _next_request(session, world)) is not None:
        session.tell(world.touch(request.pose, request.rng))
    log_probs, (best, stated) = session.belief.log_probs, likeliest(session.belief)
    touches = tuple(step.touch for step in session.steps if step.touch is not None)
    is_certain = threshold is not None and stated >= threshold
    if not is_certain and len(touches) < max_touches:
        raise BrokenContract(f"a selector must choose poses, and {decider!r:.80} ended the search")
    after = [step.belief.log_probs for step in session.steps[1:]] if touches else []
    rows = np.asarray([*after, log_probs][: len(touches)], np.float32).reshape(len(touches), len(log_probs))
    poses_of = tuple(touch.pose for touch in touches)
    return Identification(world.arrangement[0], best, stated, poses_of, is_certain, touches, rows)


@dataclass(frozen=True)
class _Certain:
    """Stops where a label is probable enough and all else holds, or after a maximum number of touches."""

    threshold: float | None
    max_touches: int
    until: Callable[[int, Sequence[Touch]], bool] | None = None

    def stop(self, info: InformationState) -> Decision | None:
        named, stated = likeliest(info.belief)
        is_probable = self.threshold is not None and stated >= self.threshold
        if is_probable and (named == UNLISTED or self.until is None or self.until(named, info.history)):
            return Decision(Confirm())
        return Decision(Unsure(), {"is_doubtful": 1.0}) if len(info.history) >= self.max_touches else None


@dataclass(frozen=True)
class _Naming:
    """Asks a decider about the most probable label, and names it, or that it is none, unless that is doubtful."""

    decider: Decider
    threshold: float | None
    abstains: bool

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        named, _ = likeliest(info.belief)
        if not self.abstains or named == UNLISTED:
            return self.decider.decide(info, rng)
        from planners.abstaining import Abstaining  # searches do not need it

        return Abstaining(self.decider, promise=self.threshold or 0.0).decide(replace(info, target=named), rng)


@dataclass(frozen=True)
class _ForLikeliest:
    """Asks a decider about the most probable label."""

    decider: Decider

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        return self.decider.decide(replace(info, target=int(info.belief.log_probs.argmax())), rng)
